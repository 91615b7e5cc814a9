"""Studies for Python users: one way to name a metric, tables that say where they come from, and metrics of one's own."""

import importlib
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab_process import Command

import flexlab
from flexlab.analysis.metrics.metric import METRICS, forget, named, number_names
from flexlab.analysis.metrics.own import DECLARED
from flexlab.analysis.run_summary import note_metrics
from flexlab.analysis.sweep.plan import make_plan
from flexlab.analysis.sweep.result import run_sweep
from flexlab.analysis.tuning import numbers_of, parse_cost
from flexlab.analysis.workers import chosen_workers
from flexlab.errors import RecordingError, StudyError
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.recording.store.notes import read_notes
from flexlab.sim.commands import ChangeScenario, Pull, Tap

EI = "payload.bending_stiffness"


@pytest.fixture(autouse=True)
def as_declared() -> Iterator[None]:
    """Forget the metrics of a test, which are declared for the whole process."""
    yield
    for name in list(DECLARED):
        forget(name)


def test_a_users_study_runs_as_it_is_written(tmp_path: Path):
    # Imported only here: from then on its metrics belong to all runs of the process.
    users_study = importlib.import_module("users_study")
    found = users_study.study(tmp_path)
    assert found["error"] == found["same"] > 0
    assert found["largest work"] > found["work"] > 0
    assert 50 <= found["gain"] <= 500
    assert (found["runs"], found["replayed"]) == (2, 1)
    assert 20 < found["frequency"] < 80
    assert all(value == 1 for name, value in found.items() if name.startswith("says where"))
    assert found["figures"] == 4
    assert (tmp_path / "run.csv").stat().st_size > 1000


def test_a_metric_has_one_name_in_si_and_older_names_still_work(tmp_path: Path):
    run = flexlab.simulate("paper", 0.05)
    assert number_names()[1:4] == ["rms_error.x", "rms_error.y", "rms_error.theta"]
    assert run.metrics["rms_error.y"] == run.metrics.rms_error.y == run.metrics.rms_error[1]
    for old in ("rms-y", "RMS error y [mm]"):
        assert run.metrics[old] == pytest.approx(1e3 * run.metrics.rms_error.y, rel=1e-15)
    cells = flexlab.sweep("paper", {EI: [100.0, 200.0]}, 0.05, folder=tmp_path, progress=False)
    np.testing.assert_array_equal(cells.column("rms-y"), 1e3 * cells.column("rms_error.y"))
    assert cells.table.schema.field("rms_error.y").metadata == {b"title": b"RMS error y", b"unit": b"m"}
    si, shown = parse_cost({"rms_error.y": 1e3}), parse_cost(["rms-y"])
    assert si.of(run.metrics) == pytest.approx(shown.of(run.metrics), rel=1e-12)
    assert numbers_of(run.metrics)["peak_torque"] == run.metrics.peak_torque
    with pytest.raises(StudyError, match=r"rms_error has several numbers: choose one of rms_error\.x, rms_error\.y"):
        named("rms_error")
    with pytest.raises(StudyError, match="'energy' is not a metric: choose one of duration"):
        run.metrics["energy"]


def test_a_metric_of_ones_own_is_in_runs_and_sweeps(tmp_path: Path):
    @flexlab.metric("m", of="peak")
    def farthest(samples: flexlab.Samples) -> np.ndarray:
        return samples.pose[:, 1]

    @flexlab.metric("1")
    def broken(samples: flexlab.Samples) -> float:
        raise ValueError("no such thing")

    run = flexlab.simulate("paper", 0.05)
    with pytest.raises(StudyError, match="The metric broken failed: ValueError: no such thing"):
        _ = run.metrics
    plan = make_plan(flexlab.load_preset("paper"), flexlab.api.parse_axes({EI: [100.0]}, run.scenario), 0.05, 0.001)
    swept = run_sweep(plan, tmp_path / "sweep", chosen_workers(1))
    assert swept.failed == {0: "The metric broken failed: ValueError: no such thing"}
    notes = read_notes(run.save(tmp_path))
    assert not {"Farthest [m]", "Broken [1]"} & set(notes["metrics"])
    assert notes["note"] == "The metric broken failed: ValueError: no such thing"
    forget("broken")
    assert flexlab.simulate("paper", 0.05).metrics.farthest == run.pose[:, 1].max()

    @flexlab.metric("1")
    def leaving(samples: flexlab.Samples) -> float:
        raise SystemExit(3)

    swept = run_sweep(plan, tmp_path / "left", chosen_workers(1))
    assert swept.failed == {0: "The metric leaving failed: SystemExit: 3"}
    forget("leaving")
    before = make_plan(plan.scenario, plan.axes, 0.05, 0.001).key
    flexlab.metric("m", of="rms")(farthest)
    assert make_plan(plan.scenario, plan.axes, 0.05, 0.001).key != before, "another metric is another sweep"
    keys = set()
    for scale in (1.0, 2.0, 1.0):  # The table of a finished sweep was given for a metric that used other values.

        def place(samples: flexlab.Samples, scale: float = scale) -> float:
            return scale * samples.pose[-1, 1]

        @flexlab.metric("m")
        def scaled(samples: flexlab.Samples) -> float:
            return place(samples)

        keys.add(make_plan(plan.scenario, plan.axes, 0.05, 0.001).key)
    assert len(keys) == 2
    forget("scaled")
    with pytest.raises(StudyError, match="give the function or its title another name"):
        flexlab.metric("N")(_named("peak_torque"))
    flexlab.metric("m", of="peak")(_named("two"))
    with pytest.raises(StudyError, match=r"gives an array \(51, 2\): a signal of these samples has \(51,\)"):
        _ = flexlab.simulate("paper", 0.05).metrics
    flexlab.metric("m")(_named("two"))
    with pytest.raises(StudyError, match="gives 102 numbers: one is needed of a run"):
        _ = flexlab.simulate("paper", 0.05).metrics


def test_a_metric_declared_or_changed_later_counts_in_a_run_whose_metrics_were_read():
    """As in a notebook, whose cells run in any order."""
    run = flexlab.simulate("paper", 0.05)
    assert run.metrics is run.metrics
    before = run.metrics
    for scale in (1.0, 2.0):

        @flexlab.metric("m")
        def last_place(samples: flexlab.Samples, scale: float = scale) -> float:
            return scale * samples.pose[-1, 1]

        assert run.metrics["last_place"] == scale * run.pose[-1, 1]
    for _ in METRICS:  # As in another thread of a cluster's worker, where each cell declares it again.
        flexlab.metric("m")(last_place)
    with pytest.raises(StudyError, match="give the function or its title another name"):
        flexlab.metric("N·m", "Peak joint torque")(last_place)
    assert run.metrics["last_place"] == 2.0 * run.pose[-1, 1], "the one before stays"
    with pytest.raises(StudyError, match="last_place was declared after these numbers were computed"):
        before["last_place"]
    forget("last_place")
    with pytest.raises(StudyError, match="'last_place' is not a metric"):
        run.metrics["last_place"]
    assert run.metrics.own == []


def test_results_from_before_a_metric_was_declared_keep_their_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A table that had not been read yet was called "damaged", or ended in a traceback."""
    monkeypatch.chdir(tmp_path)
    runs = [flexlab.simulate(name, 0.05).save(tmp_path / "logs") for name in ("paper", "soft-beam")]
    swept = flexlab.sweep("paper", {EI: [50.0, 100.0]}, duration=0.05, progress=False)
    tuned = flexlab.tune("paper", {"controller.feedback_gain": "50:800"}, duration=0.05, candidates=10, progress=False)
    compared = flexlab.compare(*runs)

    @flexlab.metric("J")
    def late(samples: flexlab.Samples) -> float:
        return float(samples.input_work[-1])

    for result in (swept, tuned, compared):
        assert "peak_torque" in result.table.column_names
        assert "late" not in result.table.column_names
        assert result.plot() is not None
        with pytest.raises(StudyError, match="late"):
            result.plot("late")
    forget("late")


def test_a_metric_of_ones_own_is_read_back_where_it_is_not_declared(flexlab_command: Command, tmp_path: Path):
    @flexlab.metric("m", "Farthest place", of="peak")
    def farthest(samples: flexlab.Samples) -> np.ndarray:
        return samples.pose[:, 1]

    run = flexlab.simulate("paper", 0.05)
    path = run.save(tmp_path / "logs")
    assert flexlab.read(path).metrics.own == ["Farthest place [m]"]
    assert flexlab.read(path).metrics.farthest == run.metrics.farthest, "declared here: computed from the samples"
    computed = run.metrics.farthest
    forget("farthest")
    found = flexlab.read(path)
    assert found.metrics["Farthest place [m]"] == pytest.approx(computed, rel=1e-3)
    assert "Farthest place (m)" in str(found.metrics)
    again = found.save(tmp_path / "again")
    assert read_notes(again)["metrics"]["Farthest place [m]"] == read_notes(path)["metrics"]["Farthest place [m]"]
    note_metrics(path)
    assert flexlab.read(path).metrics.own == ["Farthest place [m]"], "measured again by a process that does not know it"
    told = flexlab_command("logs", path.stem, "--logs", str(tmp_path / "logs")).stdout
    assert "Farthest place (m)" in told


def _named(name: str) -> Callable[[flexlab.Samples], np.ndarray]:
    def function(samples: flexlab.Samples) -> np.ndarray:
        return np.zeros((len(samples), 2))

    function.__name__ = name
    return function


def test_a_run_of_a_changed_scenario_is_named_after_the_change(tmp_path: Path):
    paper = flexlab.load_preset("paper")
    run = flexlab.simulate(paper.replace({EI: 50.0}), 0.02)
    assert run.name == "paper-bending_stiffness-50"
    path = run.save(tmp_path)
    assert path.stem.endswith("-paper-bending_stiffness-50")
    assert read_notes(path)["changes"] == [f"{EI}: 100 → 50"]
    assert flexlab.simulate(paper.replace({"title": "Mine"}), 0.02).name == "run"


def test_an_unknown_format_is_refused_for_presets_and_for_runs(tmp_path: Path):
    """For a preset, the answer was that there is no recording called paper."""
    for what in ("paper", flexlab.simulate("paper", 0.01)):
        for name in ("a", "a.xyz"):
            with pytest.raises(StudyError, match=rf"{name} has no known format: let its name end in \.csv"):
                flexlab.export(what, tmp_path / name)


def test_a_run_is_saved_under_the_file_name_that_is_given(tmp_path: Path):
    """`run.save("squeezed.rrd")` made a folder of that name."""
    run, named = flexlab.simulate("paper", 0.02), tmp_path / "new" / "squeezed.rrd"
    assert run.save(named) == named
    assert flexlab.read(named).result_hash == run.result_hash
    assert read_notes(named)["metrics"]
    with pytest.raises(RecordingError, match=r"squeezed\.rrd already exists: give another name, or a folder"):
        run.save(named)
    assert flexlab.read(named).result_hash == run.result_hash


COMMANDS = [
    (0.03, Tap(0.05, (0.0, 0.3))),
    (0.01, ChangeScenario({EI: 50.0})),
    (0.02, Pull(0.0, (0.0, 0.8), 100.0)),
    (-1.0, ChangeScenario({"gravity": 1.0})),
    (0.06, Tap(0.0, (0.0, 9.0))),
    (5.0, Tap(0.0, (0.0, 9.0))),
]
"""Out of order, before the start, at the end and after it."""


@pytest.mark.parametrize("sample_period", [0.001, 0.0007])
def test_a_run_with_commands_is_recorded_with_them(tmp_path: Path, sample_period: float):
    """Without them its replay differed, and the difference was blamed on versions of flexlab."""
    run = flexlab.simulate("paper", 0.06, sample_period, COMMANDS)
    for one in (run, flexlab.read(run.save(tmp_path))):
        assert flexlab.replay(one).identical
        path = one.save(tmp_path)
        assert flexlab.replay(path).identical
        acted = [event for event in read_recording(path).events if event.command]
        assert [type(event.command) for event in acted] == [ChangeScenario, ChangeScenario, Pull, Tap]
        assert {event.time for event in acted} <= set(run.time)


def test_the_archive_of_a_run_with_commands_holds_them(tmp_path: Path):
    run = flexlab.simulate("paper", 0.06, 0.0007, COMMANDS)
    for name, one in (("made", run), ("read", flexlab.read(run.save(tmp_path)))):
        assert flexlab.replay(flexlab.export(one, tmp_path / f"{name}.zip")).identical


def test_a_run_that_a_command_ends_is_recorded_with_it(tmp_path: Path):
    run = flexlab.simulate("paper", 0.06, commands=[(0.02, Tap(0.0, (0.0, 100.0))), (0.05, Tap(0.0, (0.0, 9.0)))])
    assert run.status == "diverged"
    assert flexlab.replay(run).identical
    assert len([event for event in read_recording(run.save(tmp_path)).events if event.command]) == 1


def test_the_ring_of_a_run_in_memory_begins_after_its_tap():
    run = flexlab.simulate("smooth-start", 1.0, commands=[(0.5, Tap(0.05, (0.0, 0.3)))])
    assert flexlab.fit(run).ring.start == run.time[501]


@pytest.mark.parametrize(
    "path", sorted((Path(__file__).parent / "recording" / "golden").glob("format-*/*.rrd")), ids=str
)
def test_a_recording_that_is_read_into_python_replays_as_its_file_does(path: Path):
    """It keeps its start, commands and sample period, and what computed it."""
    first = flexlab.replay(path)
    again = flexlab.replay(flexlab.read(path))
    assert (again.agrees, again.identical, again.compared) == (first.agrees, first.identical, first.compared)


def test_a_readout_may_have_a_name_that_a_run_uses_internally(tmp_path: Path):
    text = """
from flexlab import OwnLaw, readout

class Noting(OwnLaw):
    \"\"\"It does nothing.\"\"\"

    noted = readout("N")
    period = 0.001

    def act(self, at):
        self.noted = 2.0
        return at.weights
"""
    (tmp_path / "noting.py").write_text(text, encoding="utf-8")
    run = flexlab.simulate("paper", 0.01, law=tmp_path / "noting.py")
    assert run.noted[-1] == 2.0
    assert flexlab.read(run.save(tmp_path)).noted[-1] == 2.0


def test_newest_does_not_mean_the_run_that_a_comparison_made(flexlab_command: Command, tmp_path: Path):
    logs = tmp_path / "logs"
    first = write_run(flexlab.simulate("paper", 0.1), logs, "paper")
    os.utime(first, (0, 0))
    for _ in range(2):
        done = flexlab_command("compare", "newest", "--set", f"{EI}=50", "--json")
        assert done.returncode == 0, done.stderr
        assert f'"run": "{first.stem}"' in done.stdout
        assert f'"{EI}"' in done.stdout
        assert len(list(logs.glob("*.rrd"))) == 2
    assert list(logs.glob("*-paper-bending_stiffness-50.rrd"))


def test_a_run_in_memory_is_replayed_and_results_have_a_repr_of_one_line():
    run, soft = (flexlab.simulate(name, 0.2) for name in ("paper", "soft-beam"))
    replay = flexlab.replay(run)
    assert replay.identical
    assert repr(replay) == "<Replay: All 201 samples came out again, bit for bit.>"
    assert repr(flexlab.compare(run, soft)).startswith(
        "<Comparison of A paper, B soft-beam, of the first 0.2 s of each run"
    )
    assert "paper: f1 = 45.5" in repr(flexlab.fit(run))


def test_bad_arguments_are_one_sentence(tmp_path: Path):
    run = flexlab.simulate("paper", 0.02)
    with pytest.raises(StudyError, match="A comparison needs two runs at least"):
        flexlab.compare(run)
    with pytest.raises(StudyError, match="start and end are for tables"):
        flexlab.export(run, tmp_path / "a.html", start=0.01)
    with pytest.raises(StudyError, match="is made of a run"):
        flexlab.export(run.scenario, tmp_path / "a.csv")
    with pytest.raises(StudyError, match='of = \'mean\' is not usable: give "run", "peak" or "rms"'):
        flexlab.metric("m", of="mean")  # type: ignore[arg-type]


@pytest.mark.parametrize("given", [None, 5, math.nan, 1e300, b"x", np.array([1.0]), object()])
def test_an_argument_of_a_wrong_kind_is_one_sentence(given: Any):
    run = flexlab.simulate("paper", 0.01)
    asked: dict[str, Callable[[], object]] = {
        "is not a path": lambda: run.save(given),
        "to = ": lambda: flexlab.export(run, given),
        "file = ": lambda: flexlab.export_fmu("paper", given),
        "logs = ": lambda: flexlab.read("newest", given),
        "inputs": lambda: flexlab.linearize("paper", inputs=given),
        "outputs": lambda: flexlab.linearize("paper", outputs=given),
        "cost": lambda: flexlab.tune("paper", {EI: "50:60"}, cost=given),
        "is not a run": lambda: flexlab.explain(given),
        "is not a run: ": lambda: flexlab.internal_force_eq_26(given),
        "is not a signal": lambda: run.plot([given]),  # type: ignore[arg-type]
    }
    for says, ask in asked.items():
        with pytest.raises(StudyError) as caught:
            ask()
        assert says in str(caught.value), says
        assert "\n" not in str(caught.value), says


@pytest.mark.parametrize("given", [None, 5, "paper", b"paper", {"gravity": 9.81}])
def test_scenarios_must_be_a_list(given: Any):
    with pytest.raises(StudyError, match=r"scenarios = .* is not a list: give scenarios, as in"):
        flexlab.simulate_many(given, 0.01)
