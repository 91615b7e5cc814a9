"""Notes on runs (metrics, and changes from the preset), and which old runs may be removed."""

import os
from pathlib import Path

import pytest
from recording_helpers import wait_until

from flexlab.analysis.comparison import compare
from flexlab.analysis.metrics.run_metrics import noted_texts, results
from flexlab.analysis.run_summary import MetricNotes, note_metrics, note_missing_metrics, scenario_differences
from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.course import changed_scenario
from flexlab.recording.headless import HeadlessRecording, write_run
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store import people
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.people import names_told_apart
from flexlab.recording.store.run_files import list_runs, removable_runs, remove_run, run_state
from flexlab.recording.store.run_index import read_row, state_word
from flexlab.sim.commands import ChangeScenario, LoadScenario
from flexlab.sim.samples import Origin, Run, Status
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import Event
from flexlab.sim.world import World


def test_notes_hold_metrics_and_changes_and_leave_a_persons_own_alone(tmp_path: Path) -> None:
    scenario = load_preset("paper").replace({"payload.bending_stiffness": 60.0})
    with HeadlessRecording(tmp_path, RunInfo("paper", scenario)) as recording:
        recording.write(simulate(scenario, duration=0.5))
        recording.note(Event(0.2, "Gravity 0 → 9.81 m/s²", ChangeScenario({"gravity": 9.81})))
        recording.note(Event(0.3, "Gravity = 99 m/s² is outside", ChangeScenario({"gravity": 99.0}), level="error"))
        recording.end(Status("finished"))
    write_notes(recording.path, note="my best", tags=["soft"], keep=True)
    notes = note_metrics(recording.path)
    assert notes["changes"] == ["payload.bending_stiffness: 100 → 60", "t = 0.200 s: Gravity 0 → 9.81 m/s²"]
    assert notes["metrics"]["Duration [s]"] == 0.5
    events = read_recording(recording.path).events
    gravity = {time: changed_scenario(scenario, events, time).gravity for time in (0.2, 0.21, 1.0)}
    assert gravity == {0.2: 0.0, 0.21: 9.81, 1.0: 9.81}
    stored = read_notes(recording.path)
    assert (stored["note"], stored["tags"], stored["keep"], stored["ended"]) == ("my best", ["soft"], True, True)
    assert stored["metrics"] == notes["metrics"]


def test_missing_metrics_are_added_and_bad_files_are_skipped(run: Run, tmp_path: Path) -> None:
    for _ in range(2):
        write_run(run, tmp_path, "paper")
    (tmp_path / "bad.rrd").write_text("nonsense")
    data = write_run(run, tmp_path / "whole", "paper").read_bytes()
    tenth = len(data) // 10
    (tmp_path / "torn.rrd").write_bytes(data[: 4 * tenth] + bytes(tenth) + data[5 * tenth :])
    with HeadlessRecording(tmp_path / "whole", RunInfo("paper", run.scenario)) as going_on:
        going_on.write(run)
        assert note_metrics(going_on.path) == {}
    assert run_state(tmp_path / "torn.rrd") == "complete"
    assert note_missing_metrics(tmp_path) == 2
    assert note_missing_metrics(tmp_path) == 0


def test_metrics_that_an_earlier_version_noted_are_measured_again(run: Run, tmp_path: Path) -> None:
    path = write_run(run, tmp_path, "paper")
    write_notes(path, metrics={"Free vibration gone after [s]": 0.3, "Duration [s]": 1.0})
    assert note_missing_metrics(tmp_path) == 1
    assert "Free vibration gone after [s]" not in read_notes(path)["metrics"]
    assert read_notes(path)["metrics"]["Vibration below 1 % after [s]"] == pytest.approx(0.44, abs=0.005)


def test_another_file_under_a_runs_name_is_measured_anew_but_a_mended_or_copied_one_is_not(tmp_path: Path) -> None:
    """The library once showed the metrics, the changes and the duration of the file that had the name before."""
    old, new = (simulate(load_preset(name), duration=0.2 + k) for k, name in enumerate(("paper", "soft-beam")))
    path, other = write_run(old, tmp_path, "paper"), write_run(new, tmp_path, "soft-beam")
    note_missing_metrics(tmp_path)
    write_notes(path, note="the first", keep=True)
    before, expected = read_row(path), read_row(other)
    os.utime(path, (1e9, 1e9))
    assert read_row(path).metrics == before.metrics, "a copy is younger"
    os.utime(other, (1.5e9, 1.5e9))
    other.replace(path)
    row = read_row(path)
    assert (row.metrics, row.duration, row.changes, row.status) == ({}, None, (), "")
    assert (row.note, row.kept) == ("the first", True)
    assert note_missing_metrics(tmp_path) == 1
    assert (read_row(path).metrics, read_row(path).duration) == (expected.metrics, expected.duration)
    assert read_row(path).note == "the first"
    path.write_bytes(path.read_bytes() + bytes(8))
    os.utime(path, (1.5e9, 1.5e9))
    assert read_row(path).metrics == expected.metrics, "a mended file keeps its time"


def test_a_run_that_has_not_settled_is_noted_as_such(tmp_path: Path) -> None:
    short = simulate(load_preset("paper"), duration=0.2)
    noted = note_metrics(write_run(short, tmp_path, "paper"))["metrics"]
    assert noted["Vibration below 1 % after [s]"] is None
    shown = noted_texts(noted)
    assert shown["Vibration below 1 % after (s)"] == "not settled"
    assert not any("Residual vibration" in label for label in shown), "its path has no stop"


def test_a_run_that_never_left_its_first_instant_has_no_metrics(tmp_path: Path) -> None:
    """Runs sent to a lab that nobody watched were listed with the errors and torques of t = 0."""
    noted = note_metrics(write_run(simulate(load_preset("paper"), duration=0.0), tmp_path, "paper"))["metrics"]
    assert noted_texts(noted) == {"Duration (s)": "0"}
    assert noted.pop("Duration [s]") == 0.0
    assert set(noted.values()) == {None}


def test_a_run_that_stopped_before_its_end_has_no_metrics_but_its_duration(run: Run, tmp_path: Path) -> None:
    """This holds even if an earlier version noted numbers, and in a comparison too."""
    with HeadlessRecording(tmp_path, RunInfo("paper", run.scenario), MetricNotes("paper", run.scenario)) as recording:
        recording.write(run.slice(0, 301))
        recording.end(Status("diverged", "The run diverged.", 0.3))
    whole = write_run(run, tmp_path, "paper")
    written = read_notes(recording.path)["metrics"]
    assert written == note_metrics(recording.path)["metrics"]
    assert {key for key, value in written.items() if value is not None} == {"Duration [s]"}
    for noted in (written, note_metrics(whole)["metrics"]):
        write_notes(recording.path, metrics=noted)
        row = read_row(recording.path)
        assert (state_word(row), row.why_stopped) == ("stopped", "The run diverged.")
        texts = noted_texts(row.metrics, row.is_stopped)
        assert texts.pop("Duration (s)") not in ("did not finish", "–")
        assert set(texts.values()) == {"did not finish"}
        others = {key: value for key, value in results(row.metrics, row.is_stopped).items() if key != "Duration [s]"}
        assert set(others.values()) == {None}
    for rows in compare([recording.path, whole]).metrics:
        assert rows[1].text != "did not finish"
        assert (rows[0].text == "did not finish") == (rows[0].key != "Duration [s]")
    brief = write_run(simulate(run.scenario, 0.2), tmp_path, "brief")
    reached = compare([recording.path, brief]).metrics
    assert "did not finish" not in {rows[0].text for rows in reached}, "it ran for as long as is compared"
    assert not read_row(whole).is_stopped


def test_a_recorder_notes_metrics_and_changes_as_a_run_ends(tmp_path: Path) -> None:
    world = World(load_preset("paper").replace({"gravity": 1.0}))
    recorder = Recorder(tmp_path, start_notes=MetricNotes)
    recorder.begin_run(1, "paper", world.scenario, world.state())
    for _ in range(3):
        recorder.take_samples(1, world.advance(100), 1.0)
    recorder.take_event(1, Event(0.3, "Gravity 1 → 2 m/s²", ChangeScenario({"gravity": 2.0})))
    other = LoadScenario(world.scenario, "paper", Origin("other", 0.3, world.state()))
    recorder.take_event(1, Event(0.3, "Leaves for another run", other))
    recorder.close()
    (path,) = list_runs(tmp_path)
    noted = {name: read_notes(path)[name] for name in ("metrics", "changes", "begins", "duration", "status")}
    assert noted["changes"] == ["gravity: 0 → 1", "t = 0.300 s: Gravity 1 → 2 m/s²"]
    assert (noted["begins"], noted["duration"]) == pytest.approx((0.001, 0.299))
    assert noted == note_metrics(path)


def test_differences_name_fields_by_path() -> None:
    paper = load_preset("paper")
    other = paper.replace({"title": "x", "gravity": 9.81, "controller.kind": "pd", "payload.damping.kind": "modal"})
    assert scenario_differences(paper, paper) == []
    found = {path: (old, new) for path, old, new in scenario_differences(paper, other)}
    assert found["gravity"] == ("0", "9.81")
    assert found["controller.kind"] == ("adaptive-sliding-mode", "pd")
    assert found["payload.damping.kind"] == ("nodal", "modal")
    assert "title" not in found


@pytest.fixture
def runs(recording_file: Path) -> list[Path]:
    """Five recordings of the same size, a day apart, newest first."""
    made = []
    for day in range(5):
        path = recording_file.with_name(f"run-{day}.rrd")
        path.write_bytes(recording_file.read_bytes())
        os.utime(path, (1e9 - day * 86400, 1e9 - day * 86400))
        made.append(path)
    recording_file.unlink()
    recording_file.with_suffix(".json").unlink()
    return made


def test_no_run_is_removable_without_a_limit(runs: list[Path]) -> None:
    assert removable_runs(runs[0].parent, now=2e9) == []


def test_limits_of_age_and_size_remove_the_oldest_runs_but_never_a_kept_one(runs: list[Path]) -> None:
    logs, size = runs[0].parent, runs[0].stat().st_size
    assert removable_runs(logs, most_days=2.5, now=1e9) == [runs[4], runs[3]]
    assert removable_runs(logs, most_bytes=3.5 * size, now=1e9) == [runs[4], runs[3]]
    assert removable_runs(logs, most_bytes=5 * size, now=1e9) == []
    write_notes(runs[4], keep=True)
    assert removable_runs(logs, most_days=2.5, now=1e9) == [runs[3]]
    assert removable_runs(logs, most_bytes=3.5 * size, now=1e9) == [runs[3], runs[2]]
    for path in removable_runs(logs, most_days=2.5, now=1e9):
        remove_run(path)
    assert list_runs(logs) == [runs[0], runs[1], runs[2], runs[4]]
    assert read_recording(runs[4]).state == "complete"


def test_a_run_being_written_is_never_removable(tmp_path: Path) -> None:
    world = World(load_preset("paper"))
    recorder = Recorder(tmp_path)
    recorder.begin_run(1, "paper", world.scenario, world.state())
    wait_until(lambda: recorder.path, "there is a file")
    assert removable_runs(tmp_path, most_bytes=1, most_days=1, now=1e12) == []
    recorder.close()


@pytest.mark.parametrize("limit", [0, -1, float("nan")])
def test_a_limit_that_is_not_positive_is_refused(tmp_path: Path, limit: float) -> None:
    with pytest.raises(RecordingError, match=r"most_bytes = .* is not a limit"):
        removable_runs(tmp_path, most_bytes=limit)


def test_a_run_whose_notes_name_is_too_long_and_a_link_are_removed_alone(tmp_path: Path) -> None:
    kept = tmp_path / "elsewhere.rrd"
    kept.write_bytes(b"kept")
    logs = tmp_path / "logs"
    logs.mkdir()
    longest, link = logs / f"{'y' * 251}.rrd", logs / "link.rrd"
    longest.write_bytes(b"")
    link.symlink_to(kept)
    for path in (longest, link):
        remove_run(path)
    assert list(logs.iterdir()) == []
    assert kept.read_bytes() == b"kept"


def test_notes_are_read_once_for_the_names_of_a_class(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With 10,000 runs, the teacher's page kept the server busy: whenever a run began or ended, all notes were read anew."""
    looks: list[Path] = []
    monkeypatch.setattr(people, "read_notes", lambda path: looks.append(path) or read_notes(path))
    for number, who in enumerate(("Anna", "Anna", "Carl", "Ben")):
        run = tmp_path / f"{number % 3}.rrd"
        run.touch()
        write_notes(run, visitor=who, owner=str(number))
        for changed in (run.with_suffix(".json"), tmp_path):  # Two changes may fall into one tick of the disk's clock.
            os.utime(changed, ns=(number, number))
        names = names_told_apart([], tmp_path)
    assert (len(looks), sorted(filter(any, names))) == (4, [("Anna", "1"), ("Ben", "3"), ("Carl", "2")])
