"""`flexlab logs`: the table of runs, the notes on them, and which of them are deleted."""

import io
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from lab_process import Command, refused

from flexlab.analysis.metrics.metric import label_of
from flexlab.analysis.run_summary import note_metrics
from flexlab.cli.console import agreed
from flexlab.cli.logs_command import COLUMNS
from flexlab.errors import RecordingError, StudyError
from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.recording.store.notes import write_notes
from flexlab.recording.store.run_files import list_runs, remove_run
from flexlab.recording.store.run_index import annotate_run, read_row
from flexlab.sim.simulate import simulate

DAY = 86400


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two measured runs."""
    logs = tmp_path_factory.mktemp("made") / "logs"
    for preset in ("paper", "soft-beam"):
        scenario = load_preset(preset).replace({"gravity": 1.0})
        note_metrics(write_run(simulate(scenario, duration=0.3), logs, preset))
    return logs


@pytest.fixture
def logs(made: Path, tmp_path: Path) -> Path:
    """A copy of that folder with three bad files added; the paper's run is two days old, the soft beam's is new."""
    logs = tmp_path / "logs"
    shutil.copytree(made, logs)
    (logs / "garbage.rrd").write_bytes(b"junk" * 100)
    (logs / "empty.rrd").touch()
    (logs / "torn.rrd").write_bytes(run_of(logs, "paper").read_bytes()[:-20_000])
    for days, name in ((1, "garbage"), (2, "paper"), (3, "empty"), (4, "torn")):
        when = time.time() - days * DAY
        os.utime(run_of(logs, name), (when, when))
    return logs


def run_of(logs: Path, preset: str) -> Path:
    (path,) = logs.glob(f"*{preset}.rrd")
    return path


def good(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_table_has_a_line_of_numbers_for_each_run(flexlab_command: Command, logs: Path):
    write_notes(run_of(logs, "paper"), note="my [b]best[/b]", tags=["thesis"], keep=True)
    done = flexlab_command("logs")
    heading, units, soft, below, *others = good(done).splitlines()
    assert heading.split()[:4] == ["run", "duration", "size", "state"]
    assert [units.split()[i] for i in (0, -1)] == ["mm", "N"]
    assert soft.split()[1:4:2] == ["0.3", f"{run_of(logs, 'soft-beam').stat().st_size / 1000:.3g}"]
    assert "complete" in soft
    assert len(soft) == len(heading)
    assert "–" not in soft
    assert "not settled" in soft
    assert below == "  gravity: 0 → 1"
    assert "  kept #thesis · my [b]best[/b] · gravity: 0 → 1" in others
    states = {line.split()[0]: line.split()[5 if line.split()[1] != "–" else 4] for line in others if line[0] != " "}
    assert {name: states[name] for name in ("garbage", "empty", "torn")} == {
        "garbage": "damaged",
        "empty": "damaged",
        "torn": "unfinished",
    }
    assert "5 runs, " in done.stderr
    assert "Without metrics: 3. flexlab logs --measure" in done.stderr


def test_the_table_shows_a_few_of_many_changes(flexlab_command: Command, logs: Path):
    write_notes(run_of(logs, "paper"), changes=[f"change {number}" for number in range(64)])
    assert "  change 0; change 1; change 2; 61 more" in good(flexlab_command("logs")).splitlines()
    assert "change 63" in good(flexlab_command("logs", run_of(logs, "paper").stem))


def test_runs_are_searched_by_words_and_sorted_by_fields(flexlab_command: Command, logs: Path):
    def names(*words: str) -> list[str]:
        return [row["preset"] for row in json.loads(good(flexlab_command("logs", "--json", *words)))]

    assert names()[0] == "soft-beam"
    assert names("--reverse")[-1] == "soft-beam"
    assert names("--search", "SOFT complete") == ["soft-beam"]
    assert names("--search", "gravity: 0", "--sort", "torque") == ["soft-beam", "paper"]
    assert names("--search", "gravity: 0", "--sort", "torque", "--reverse") == ["paper", "soft-beam"]
    assert names("--search", "nothing like it") == []
    both = [run_of(logs, preset).stem for preset in ("paper", "soft-beam")]
    assert both[0] not in good(flexlab_command("logs", *both, "--search", "soft")), "it listed whatever was named"
    assert "No run of these has the words" in flexlab_command("logs", both[0], "--search", "soft").stderr


def test_runs_that_have_not_settled_come_last_in_either_order(flexlab_command: Command, logs: Path):
    write_notes(run_of(logs, "soft-beam"), metrics={"Vibration below 1 % after [s]": 0.25})
    for words in ([], ["--reverse"]):
        done = flexlab_command("logs", "--sort", "settled", "--search", "gravity: 0", *words)
        assert [line.split()[0] for line in good(done).splitlines() if "complete" in line] == [
            run_of(logs, "soft-beam").stem,
            run_of(logs, "paper").stem,
        ]
    assert "has the words 'zzz'" in flexlab_command("logs", "--search", "zzz").stderr


def test_a_run_that_is_named_is_shown_with_all_its_metrics(flexlab_command: Command, logs: Path):
    path = run_of(logs, "paper")
    (row,) = json.loads(good(flexlab_command("logs", path.stem, "--json")))
    assert row["duration [s]"] == 0.3
    assert row["size [B]"] == path.stat().st_size
    assert row["changes"] == ["gravity: 0 → 1"]
    assert {column.key for column in COLUMNS.values()} == set(row["metrics"])
    text = good(flexlab_command("logs", path.stem))
    for title, value in row["metrics"].items():
        assert label_of(title) in text or value is None
    assert "gravity: 0 → 1" in text


def test_a_run_is_found_by_its_name_its_beginning_its_file_or_newest(flexlab_command: Command, logs: Path):
    soft = run_of(logs, "soft-beam")
    for name in (soft.stem, soft.name, soft.stem[:-3], f"logs/{soft.name}", str(soft), "newest"):
        assert good(flexlab_command("logs", name)).splitlines()[0] == soft.stem, name
    assert good(flexlab_command("logs", "gar")).splitlines()[0] == "garbage"


def test_notes_tags_and_the_mark_to_keep_are_written(flexlab_command: Command, logs: Path):
    words = ["--note", "look at [this]", "--tags", "a, b,a", "--keep"]
    text = good(flexlab_command("logs", "newest", *words))
    assert "look at [this]" in text
    (row,) = json.loads(good(flexlab_command("logs", "newest", "--json")))
    assert (row["note"], row["tags"], row["kept"]) == ("look at [this]", ["a", "b"], True)
    (row,) = json.loads(good(flexlab_command("logs", "newest", "--note", "seen", "--json")))
    assert (row["note"], row["tags"], row["kept"]) == ("seen", ["a", "b"], True), "what is not named stays"
    (row,) = json.loads(good(flexlab_command("logs", "newest", "--unkeep", "--tags", "", "--json")))
    assert (row["note"], row["tags"], row["kept"]) == ("seen", [], False)
    assert row["metrics"]


@pytest.mark.parametrize("answers", [None, io.TextIOWrapper(io.BytesIO(b"\xff\n"), encoding="utf-8")])
def test_a_question_that_nobody_can_answer_is_refused(
    monkeypatch: pytest.MonkeyPatch, answers: io.TextIOWrapper | None
):
    """A service has no standard input."""
    monkeypatch.setattr(sys, "stdin", answers)
    with pytest.raises(StudyError, match=r"Nobody answered, so nothing was done: --yes answers\."):
        agreed("Delete it?", "--yes answers")


def test_deleting_asks_and_spares_what_is_kept(flexlab_command: Command, logs: Path):
    soft = run_of(logs, "soft-beam")
    nobody = flexlab_command("logs", "newest", "--delete")
    assert nobody.returncode == 2
    assert "--yes deletes without asking" in nobody.stderr
    good(flexlab_command("logs", "newest", "--keep"))
    assert soft.stem in good(flexlab_command("logs", "--search", "kept"))
    kept = flexlab_command("logs", "newest", "garbage", "--delete", "--yes")
    assert kept.returncode == 2
    assert "is marked to be kept" in kept.stderr
    assert soft.exists()
    assert (logs / "garbage.rrd").exists()
    good(flexlab_command("logs", "newest", "--unkeep"))
    assert "Deleted 1 run" in good(flexlab_command("logs", "newest", "--delete", "--yes"))
    assert not soft.exists()
    assert not soft.with_suffix(".json").exists()


@pytest.mark.parametrize("meanwhile", ["marked", "deleted"])
def test_what_happens_to_a_run_while_the_question_waits_counts(logs: Path, meanwhile: str):
    soft = run_of(logs, "soft-beam")
    command = [sys.executable, "-m", "flexlab", "logs", "newest", "--delete"]
    with subprocess.Popen(
        command, cwd=logs.parent, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as asking:
        assert asking.stderr is not None
        said = ""
        while not said.endswith("[y/N] "):
            said += asking.stderr.read(1)
            assert asking.poll() is None, said
        if meanwhile == "marked":
            annotate_run(read_row(soft), kept=True)
        else:
            remove_run(soft)
        complained = asking.communicate("y\n")[1]
    assert soft.exists() == (meanwhile == "marked")
    assert (asking.returncode, "is marked to be kept" in complained) == ((2, True) if soft.exists() else (0, False))


@pytest.mark.parametrize("words", [("--note", "x"), ("--keep",), ("--delete", "--yes")])
def test_a_file_that_is_no_recording_is_neither_noted_nor_deleted(flexlab_command: Command, tmp_path: Path, words):
    """A note on mine.json was written into it, and --delete removed any file."""
    mine = tmp_path / "mine.json"
    mine.write_text("{}")
    said = refused(flexlab_command("logs", "mine.json", *words, "--logs", "."))
    assert "mine.json does not end in .rrd" in said
    assert mine.read_text() == "{}"


def test_a_note_leaves_a_mark_that_was_set_since_the_run_was_listed(logs: Path):
    row = read_row(run_of(logs, "soft-beam"))
    annotate_run(row, kept=True)
    annotate_run(row, note="rings")
    annotate_run(row, tags="a, b")
    found = read_row(row.path)
    assert (found.note, found.tags, found.kept) == ("rings", ("a", "b"), True)


def test_limits_delete_the_oldest_runs_first_and_never_kept_ones(flexlab_command: Command, logs: Path):
    paper, soft = run_of(logs, "paper"), run_of(logs, "soft-beam")
    good(flexlab_command("logs", "torn", "--keep"))
    asked = flexlab_command("logs", "--max-age", "1.5")
    assert asked.returncode == 2
    assert [line.split()[0] for line in asked.stdout.splitlines()] == ["empty", paper.stem]
    assert "Delete 2 runs" in asked.stderr
    assert len(list_runs(logs)) == 5
    good(flexlab_command("logs", "--max-age", "1.5", "--yes"))
    assert {path.name for path in list_runs(logs)} == {"torn.rrd", "garbage.rrd", soft.name}
    gigabytes = 1e-9 * (soft.stat().st_size + (logs / "torn.rrd").stat().st_size + 100)
    good(flexlab_command("logs", "--max-size", str(gigabytes), "--yes"))
    assert {path.name for path in list_runs(logs)} == {"torn.rrd", soft.name}
    good(flexlab_command("logs", "--max-size", "1e-6", "--yes"))
    assert [path.name for path in list_runs(logs)] == ["torn.rrd"]
    assert "No run is over the limits" in good(flexlab_command("logs", "--max-size", "1e-6", "--yes"))


def test_measuring_repairs_and_measures_what_can_be_read(flexlab_command: Command, logs: Path):
    good(flexlab_command("logs", "--measure"))
    rows = {row["run"]: row for row in json.loads(good(flexlab_command("logs", "--json")))}
    assert rows["torn"]["state"] == "recovered"
    assert rows["torn"]["metrics"]["Peak joint torque [N·m]"] > 600
    assert rows["garbage"]["metrics"] == {}


def test_runs_are_listed_without_reading_them(flexlab_command: Command, logs: Path):
    """So many long runs are listed at once. What is wrong in the middle of a recording is noticed only when it is read."""
    listed = good(flexlab_command("logs", "--json"))
    file = run_of(logs, "paper")
    data, stat = bytearray(file.read_bytes()), file.stat()
    data[len(data) // 8 : len(data) // 2] = bytes(len(data) // 2 - len(data) // 8)
    file.write_bytes(data)
    os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    assert good(flexlab_command("logs", "--json")) == listed
    with pytest.raises(RecordingError, match="damaged"):
        read_recording(file)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--sort", "colour"], "--sort colour is not a field: choose one of started, preset,"),
        (["--keep"], "needs a RUN"),
        (["--delete"], "needs a RUN"),
        (["newest", "--keep", "--unkeep"], "contradict"),
        (["newest", "--delete", "--note", "x"], "contradict"),
        (["newest", "--max-age", "3"], "give no RUN"),
        (["--max-size", "0"], "--max-size 0 is not usable: give a number of GB above 0"),
        (["--max-age", "nan"], "--max-age nan is not usable"),
        (["nonsense"], "no recording nonsense, nor one in logs with such a name"),
        (["20"], "2 runs in logs begin with 20"),
        (["newest", "--note", "x" * 2001], "2001 characters: at most 2000"),
        (["--logs", "nowhere"], "no folder nowhere"),
        (["--logs", "file"], "file cannot be read (Not a directory): choose a folder with --logs."),
        (["--max-age", "3", "--logs", "file"], "file cannot be read (Not a directory): choose a folder with --logs."),
        (["newest", "--logs", "nowhere"], "no recording in nowhere"),
        (["--logs", "x" * 300], "x… cannot be read (File name too long): choose a folder with --logs."),
    ],
)
def test_bad_input_is_one_sentence(flexlab_command: Command, made: Path, tmp_path: Path, words: list[str], says: str):
    (tmp_path / "logs").symlink_to(made)
    (tmp_path / "file").touch()
    assert says in refused(flexlab_command("logs", *words))


def test_an_empty_folder_is_no_error(flexlab_command: Command, tmp_path: Path):
    (tmp_path / "logs").mkdir()
    done = flexlab_command("logs")
    assert (done.returncode, done.stdout) == (0, "")
    assert "There is no run in logs yet." in done.stderr
    assert json.loads(good(flexlab_command("logs", "--json"))) == []
