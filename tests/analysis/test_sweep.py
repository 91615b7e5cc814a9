"""Sweeps: what is varied, which cells follow, and the same table whatever happens during the computation."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest

import flexlab
from flexlab.analysis.metrics.metric import forget
from flexlab.analysis.sweep.axes import parse_axes
from flexlab.analysis.sweep.figures import pareto_front, write_figures
from flexlab.analysis.sweep.plan import BEAMS, Plan, make_plan, measured, run_part
from flexlab.analysis.sweep.result import part_file, run_sweep
from flexlab.analysis.workers import chosen_workers
from flexlab.errors import FlexlabError, ScenarioError, StudyError
from flexlab.presets import load_preset

EI, K = "payload.bending_stiffness", "controller.feedback_gain"


def axes(*texts: str):
    return parse_axes(texts, load_preset("paper"))


def test_ranges_and_lists_are_read():
    stiffness, gain, law, count, pose, several = axes(
        f"{EI}=1:1000:log:4", f"{K}=50:500:10", "controller.kind=pd,none", "payload.element_count=2:5:9",
        "trajectory.center=[0, 0.7, 0], [0, 0.8, 0]", "gravity=0, 9.81",
    )  # fmt: skip
    assert stiffness.values == pytest.approx((1.0, 10.0, 100.0, 1000.0))
    assert (stiffness.at(0.5), stiffness.logarithmic) == (pytest.approx(1000**0.5), True)
    assert gain.values == tuple(np.linspace(50, 500, 10))
    assert (law.values, law.numeric) == (("pd", "none"), False)
    assert count.values == (2.0, 3.0, 4.0, 5.0), "a field of whole numbers takes each once"
    assert (axes("payload.element_count=2:9:5")[0].values, count.at(0.9)) == ((2.0, 4.0, 6.0, 7.0, 9.0), 5.0)
    assert pose.values == ((0, 0.7, 0), (0, 0.8, 0))
    assert several.values == (0, 9.81)
    assert len(axes(f"{EI}=1:2")[0].values) == 10
    (one,) = parse_axes({EI: np.array([1.0, 2.0])}, load_preset("paper"))
    assert one.values == (1.0, 2.0)
    for column in (pd.Series([1.0, 2.0]), pd.Index([1, 2]), pa.array([1, 2])):
        assert parse_axes({EI: column}, load_preset("paper"))[0].values == (1.0, 2.0)
    (two,) = parse_axes({"payload.element_count": [np.int64(2), np.float32(4)]}, load_preset("paper"))
    assert two.values == (2, 4)
    for field, file, kind in (("controller", "laws/pid.py", "pid-control"), ("trajectory", "paths/heart.py", "heart")):
        field, file = f"{field}.kind", Path(__file__).parents[2] / "presets" / file
        for given in ([f"{field}={file}"], {field: [file]}, {field: [str(file)]}, {field: str(file)}):
            assert parse_axes(given, load_preset("paper"))[0].values == (kind,)
    assert axes("controller.kind=pd,tcp://localhost:9000")[0].values == ("pd", "tcp-localhost-9000")
    (three,) = parse_axes({"trajectory.center": [np.array([0.0, 0.7, 0.0])]}, load_preset("paper"))
    assert three.values == ((0.0, 0.7, 0.0),)


@pytest.mark.parametrize("given", [b"50", bytearray(b"50"), pd.DataFrame({"EI": [50, 60]})])
def test_bytes_and_tables_are_no_list_of_values(given: object):
    """The bytes of b"50" were taken for the values 53 and 48."""
    with pytest.raises(
        StudyError, match=r"^payload\.bending_stiffness = .* is not usable: give a range as text, or a list"
    ):
        parse_axes({EI: given}, load_preset("paper"))


def test_a_beam_that_comes_again_gives_the_same_rows_whether_it_was_kept_or_not():
    plan = make_plan(
        load_preset("paper"), axes(f"{K}=100:300:3", f"{EI}=1:900:log:4", "payload.element_count=2,9"), 0.05, 1e-3
    )
    cells = range(plan.cell_count)
    again = [run_part(plan, part) for part in (cells[::-2], cells)][1]
    assert BEAMS.of(plan.cell_scenario(plan.cell_count - 1).payload), "the newest is known"
    kept = [BEAMS.of(plan.cell_scenario(cell).payload) for cell in cells[:8]]
    assert 0 < sum(map(len, kept)) < 8, "those of nine elements are too many to be kept"
    with ThreadPoolExecutor(1) as another:
        assert list(another.map(lambda cell: run_part(plan, [cell])[0], cells)) == again


@pytest.mark.parametrize(
    ("vary", "kind", "says"),
    [
        (["bending_stiffness=1:2"], ScenarioError, "did you mean payload.bending_stiffness?"),
        ([f"{EI}=5:1"], StudyError, "is empty or reversed: write the smaller limit first"),
        ([f"{EI}=1:5:0"], StudyError, "asks for 0 values"),
        ([f"{EI}=-1:5:3"], StudyError, "−1 N·m² is outside the allowed range 0.001 to 10¹² N·m²"),
        (["gravity=0:5:log:3"], StudyError, "is logarithmic and begins at 0"),
        ([f"{EI}=1:nan"], StudyError, "is not a range"),
        (["gravity=-1e308:1e308:5"], StudyError, "is too wide"),
        (["payload.element_count=-1e308:1e308"], StudyError, "is too wide"),
        ([f"{EI}=1:5:cubic:3"], StudyError, "is not a range"),
        ([EI], StudyError, "does not say what to vary"),
        ([f"{EI}="], StudyError, "does not say what to vary"),
        ([f"{EI}=1:2", f"{EI}=2:3"], StudyError, "is varied twice"),
        ([], StudyError, "Nothing is varied"),
        ({EI: []}, StudyError, "zero cells cannot be computed"),
        ({EI: [float("nan")]}, StudyError, "is not usable"),
        ({EI: [object()]}, StudyError, "is not usable"),
        ({EI: [10**400]}, StudyError, "is not usable"),
        (5, StudyError, "vary = 5 is not usable"),
        ("gravity=1:2", StudyError, "is not usable"),
    ],
)
def test_what_cannot_be_varied_is_refused_in_a_sentence(vary: Any, kind: type[FlexlabError], says: str):
    with pytest.raises(kind) as caught:
        flexlab.sweep("paper", vary)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"duration": -1}, "duration = -1 s is not usable"),
        ({"design": "random"}, "choose one of grid, latin-hypercube, sobol"),
        ({"design": "sobol"}, "samples says how many"),
        ({"samples": 5}, "samples says how many"),
        ({"design": "sobol", "samples": 0}, "samples = 0 is not usable"),
        ({"workers": 0}, "workers = 0 is not usable"),
        ({"design": "sobol", "samples": 10_000_000}, "say most_cells=10000000 if you mean it"),
        ({"folder": "/proc/sweep"}, "/proc/sweep cannot be written"),
    ],
)
def test_options_that_cannot_be_used_are_refused_in_a_sentence(options: dict, says: str):
    with pytest.raises(StudyError, match=says):
        flexlab.sweep("paper", [f"{EI}=1:2:2"], **options)


def test_designs_cover_the_ranges():
    paper, ranges = load_preset("paper"), axes(f"{EI}=1:1000:log", f"{K}=50:500")
    grid = make_plan(paper, axes(f"{EI}=1:1000:log:4", f"{K}=50:500:3"), 1.0, 0.001)
    assert [grid.values(cell)[1] for cell in range(4)] == [50.0, 275.0, 500.0, 50.0], "the last axis changes fastest"
    latin = make_plan(paper, ranges, 1.0, 0.001, "latin-hypercube", 20)
    strata = [int(20 * np.log(latin.values(cell)[0]) / np.log(1000)) for cell in range(20)]
    assert sorted(strata) == list(range(20)), "each twentieth of the range once"
    sobol = make_plan(paper, ranges, 1.0, 0.001, "sobol", 64)
    gains = np.array([sobol.values(cell)[1] for cell in range(64)])
    assert np.histogram(gains, 8, (50, 500))[0].tolist() == [8] * 8
    other = make_plan(paper, ranges, 1.0, 0.001, "sobol", 64, seed=1)
    assert other.values(3) != sobol.values(3) == make_plan(paper, ranges, 1.0, 0.001, "sobol", 64).values(3)
    assert len({plan.key for plan in (grid, latin, sobol, other)}) == 4


def test_a_plan_has_the_accuracy_that_cells_need_and_none_of_the_texts():
    paper, gain = load_preset("paper").replace({"simulation.accuracy": 1e-8}), axes(f"{K}=50:500:3")

    def plan(accuracy: float = 1e-8, asked: float | None = 1e-7, varied: tuple = gain, **changes: object) -> Plan:
        return make_plan(
            paper.replace({"simulation.accuracy": accuracy, **changes}), varied, 1.0, 0.001, accuracy=asked
        )

    assert [plan(*each).scenario.simulation.accuracy for each in ((), (1e-5,), (1e-8, None))] == [1e-7, 1e-5, 1e-8]
    assert plan(varied=axes("simulation.integrator=rk4,etdrk4")).scenario.simulation.accuracy == 1e-8
    assert plan(watch="Something else.").key == plan().key != plan(1e-5).key


def test_a_cell_is_the_run_of_its_scenario_and_a_failed_one_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    sweep = flexlab.sweep(
        "paper", [f"{EI}=50:200:2", "trajectory.center=[0,0.75,0],[0,1.6,0]", "controller.kind=pd,adaptive-sliding-mode"],
        0.2, folder=tmp_path / "one",
    )  # fmt: skip
    assert len(sweep) == sweep.table.num_rows == 8
    assert sorted(sweep.failed) == [2, 3, 6, 7]
    assert "reach" in sweep.failed[2]
    run = flexlab.simulate(sweep.scenario(5), 0.2)
    for row in run.metrics.rows:
        np.testing.assert_equal(sweep.column(row.key)[5], row.value)
    monkeypatch.setattr("flexlab.analysis.sweep.plan.BLOCK", 64)
    found = measured(sweep.scenario(5), {}, 0.2, 0.001).metrics
    assert found is not None
    assert found.numbers == pytest.approx(run.metrics.numbers, rel=1e-12, nan_ok=True), (
        "of many samples, block by block"
    )
    assert np.isnan(sweep.column("RMS error x [mm]")[2])
    assert repr(sweep).startswith(
        "<Sweep of 8 cells over payload.bending_stiffness, trajectory.center, controller.kind, 4"
    )
    assert "<th>payload.bending_stiffness</th>" in sweep._repr_html_()
    about = json.loads(sweep.table.schema.metadata[b"flexlab"])
    assert flexlab.parse_scenario(about["sweep"]["scenario"]) == sweep.plan.scenario
    with pytest.raises(StudyError, match="holds another sweep"):
        flexlab.sweep("paper", [f"{EI}=50:200:2"], 0.2, folder=tmp_path / "one")
    with pytest.raises(StudyError, match="cell = 8 is not usable: give a whole number from 0 to 7"):
        sweep.scenario(8)


VARY = [f"{EI}=1:1000:log:12", f"{K}=50:500:11"]
KILLED = f"import flexlab, sys; flexlab.sweep('paper', {VARY}, 0.3, folder=sys.argv[1], workers=2)"


@pytest.mark.parametrize(
    ("vary", "column"),
    [
        ({"controller.control_period": [None, 0.001]}, ["null", "0.001"]),
        ({"trajectory.amplitude": [0.1, [0.1, 0.1, 0.1]]}, ["0.1", "[0.1, 0.1, 0.1]"]),
        (["payload.mode_count=null,2"], ["null", "2"]),
        ({"gravity": ["no", 1]}, ["no", "1"]),
    ],
)
def test_values_of_several_kinds_share_a_column_of_text(tmp_path: Path, vary: object, column: list[str]):
    """A field may be null, for example: a column of text lets the sweep keep what it has computed."""
    sweep = flexlab.sweep("paper", vary, 0.02, folder=tmp_path / "sweep")  # type: ignore[arg-type]  # Any of these.
    (path,) = (axis.path for axis in sweep.axes)
    assert sweep.table.column(path).to_pylist() == column
    assert sweep.table.column("status").to_pylist() == ["invalid" if "no" in column else "finished", "finished"]
    assert sweep.plot("peak_torque").axes[0].get_xticklabels()[1].get_text() == column[1]


def test_a_killed_sweep_is_completed_to_the_same_bytes(tmp_path: Path, computed_parts: list[str]):
    flexlab.sweep("paper", VARY, 0.3, folder=tmp_path / "whole", workers=1)
    computed_parts.clear()
    killed = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path / "killed")])
    parts = tmp_path / "killed" / "parts"
    deadline = time.monotonic() + 120
    while len(list(parts.glob("*.parquet"))) < 5:
        assert time.monotonic() < deadline
        assert killed.poll() is None, "killed in time"
        time.sleep(0.005)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert not (tmp_path / "killed" / "cells.parquet").exists()
    kept = {file.name for file in parts.glob("0*.parquet")}
    sweep = flexlab.sweep("paper", VARY, 0.3, folder=tmp_path / "killed")
    assert set(computed_parts) == {part_file(parts.parent, cells).name for cells in sweep.plan.parts()} - kept
    assert (tmp_path / "killed" / "cells.parquet").read_bytes() == (tmp_path / "whole" / "cells.parquet").read_bytes()
    assert sorted(os.listdir(tmp_path / "killed")) == ["cells.parquet", "sweep.json"]
    assert parquet.read_table(tmp_path / "killed" / "cells.parquet").num_rows == 132


def test_the_same_sweep_is_not_computed_twice_and_needs_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    first = flexlab.sweep("paper", {EI: [50.0, 100.0]}, 0.1)
    stamp = (first.folder / "cells.parquet").stat().st_mtime_ns
    again = flexlab.sweep("paper", {EI: [50.0, 100.0]}, 0.1)
    assert again.folder == first.folder
    assert again.folder.parent == Path("sweeps")
    assert (again.folder / "cells.parquet").stat().st_mtime_ns == stamp


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_sweep_is_kept_in_a_folder_whose_name_is_not_utf_8(tmp_path: Path):
    folder = tmp_path / os.fsdecode(b"b\xfcrste")
    sweep = flexlab.sweep("paper", {"gravity": [0.0, 1.0]}, 0.02, folder=folder)
    assert sweep.table.num_rows == 2
    assert sorted(os.listdir(folder)) == ["cells.parquet", "sweep.json"]


def test_two_computations_of_one_sweep_at_once_both_get_its_table(tmp_path: Path):
    """The slower one failed, as if the folder could not be written, because the other had removed the parts."""
    plan = make_plan(load_preset("paper"), axes("gravity=0,1,2"), 0.02, 0.001)
    others = []

    def meanwhile(done: int, total: int | None) -> None:
        if not others:
            others.append(None)
            others.append(run_sweep(plan, tmp_path, chosen_workers(1)))

    swept = run_sweep(plan, tmp_path, chosen_workers(1), meanwhile)
    assert swept.table.equals(others[1].table)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cells.parquet", "sweep.json"]


def other_table(file: Path) -> None:
    parquet.write_table(pa.table({"a": [1]}), file)


def row_less(file: Path) -> None:
    parquet.write_table(parquet.read_table(file).slice(1), file)


def torn(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-20])


def as_a_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def as_a_folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


@pytest.mark.parametrize("damage", [other_table, row_less, torn, as_a_pipe, as_a_folder])
def test_a_damaged_table_is_reported_and_left_as_it_is(damage: Callable[[Path], None], tmp_path: Path):
    vary, folder = {EI: [50.0, 100.0]}, tmp_path / "K=1"
    file = flexlab.sweep("paper", vary, 0.02, folder=folder).folder / "cells.parquet"
    assert len(flexlab.sweep("paper", vary, 0.02, folder=folder).table) == 2
    damage(file)
    with pytest.raises(
        StudyError, match=r"cells\.parquet is damaged \((?!\[Errno).*\): move it away, and the same sweep"
    ):
        flexlab.sweep("paper", vary, 0.02, folder=folder).column("rms_error.y")
    assert file.exists()


@pytest.mark.parametrize("damage", [other_table, row_less, torn, as_a_pipe])
def test_a_damaged_part_is_computed_again(damage: Callable[[Path], None], tmp_path: Path):
    vary, folder = {EI: [50.0, 100.0]}, tmp_path / "sweep"
    file = flexlab.sweep("paper", vary, 0.02, folder=folder).folder / "cells.parquet"
    whole, parts = file.read_bytes(), folder / "parts"
    parts.mkdir()
    part = parts / f"{0:09d}.parquet"
    parquet.write_table(parquet.read_table(file).slice(0, 1), part)
    file.unlink()
    damage(part)
    flexlab.sweep("paper", vary, 0.02, folder=folder)
    assert file.read_bytes() == whole


@pytest.mark.parametrize("text", ["[" * 100_000, "[1]", '{"key": {}}', "\udcff"])
def test_a_folder_with_a_plan_of_something_else_is_refused(text: str, tmp_path: Path):
    (tmp_path / "sweep.json").write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(StudyError, match="holds another sweep"):
        flexlab.sweep("paper", {EI: [50.0, 100.0]}, 0.02, folder=tmp_path)


@pytest.mark.parametrize(("name", "other"), [("engine", lambda: "kernels-0"), ("__version__", "0.0.1")])
def test_a_sweep_of_another_version_is_refused_and_left_as_it_is(
    name: str, other: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Versions may differ in a metric's definition alone: the earlier numbers once passed for those of this one."""
    vary = {EI: [50.0, 100.0]}
    with monkeypatch.context() as changed:
        changed.setattr(f"flexlab.analysis.sweep.plan.{name}", other)
        flexlab.sweep("paper", vary, 0.02, folder=tmp_path)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(StudyError, match="holds a sweep of another version of flexlab"):
        flexlab.sweep("paper", vary, 0.02, folder=tmp_path)
    assert sorted(tmp_path.iterdir()) == before


def test_a_folder_whose_plan_is_a_pipe_is_refused(tmp_path: Path):
    os.mkfifo(tmp_path / "sweep.json")
    with pytest.raises(StudyError, match="holds another sweep"):
        flexlab.sweep("paper", {EI: [50.0, 100.0]}, 0.02, folder=tmp_path)


def test_a_users_own_metrics_cannot_spoil_the_table_or_the_figures(tmp_path: Path):
    @flexlab.metric("1")
    def beyond(samples: flexlab.Samples) -> float:
        return 1e308 * np.cos(samples.time[-1])

    @flexlab.metric("1")
    def fails_oddly(samples: flexlab.Samples) -> float:
        if samples.desired_pose[0, 0] > 0:
            raise ValueError("half \ud800 of it")
        return -1e308

    try:
        sweep = flexlab.sweep(
            "paper", {"trajectory.center": [[0.0, 0.75, 0.0], [0.1, 0.75, 0.0]]}, 0.01, folder=tmp_path
        )
        assert "half \N{REPLACEMENT CHARACTER} of it" in sweep.failed[1]
        write_figures(sweep.plan, sweep.table, tmp_path, ["beyond", "fails_oddly"], ("beyond", "fails_oddly"))
    finally:
        forget("beyond")
        forget("fails_oddly")


def test_the_pareto_front_holds_the_cells_that_no_other_betters():
    x = np.array([1.0, 2.0, 2.0, 3.0, np.nan, 4.0, 0.5])
    y = np.array([5.0, 4.0, 3.0, 3.0, 0.0, 1.0, 9.0])
    assert pareto_front(x, y).tolist() == [6, 0, 2, 5]
    assert pareto_front(np.array([np.nan]), np.array([1.0])).tolist() == []


def test_figures_state_units_and_mark_failed_cells(tmp_path: Path):
    sweep = flexlab.sweep(
        "paper", [f"{EI}=1:1000:log:4", "trajectory.frequency=0.5:3:3", "trajectory.center=[0,0.75,0],[0,1.6,0]"], 0.1,
        folder=tmp_path / "map",
    )  # fmt: skip
    paths = write_figures(sweep.plan, sweep.table, sweep.folder, ("rms-y", "settled"))
    assert [path.name for path in paths] == ["rms-y.svg", "settled.svg", "pareto.svg"]
    drawn = paths[0].read_text(encoding="utf-8")
    for words in ("RMS error y (mm)", "Bending stiffness, EI (N·m²)", "failed"):
        assert words in drawn
    assert re.findall(r">(10+)<", drawn)[:3] == ["10", "100", "1000"], "not 10¹, 10² and 10³"
    assert "of 12 cells are Pareto-optimal" in paths[2].read_text(encoding="utf-8"), "without those that failed"
    for vary in ([f"{EI}=10,1,3"], ["controller.kind=pd,none"], ["gravity=9.81"]):
        curve = flexlab.sweep("paper", vary, 0.1, folder=tmp_path / vary[0][:9])
        (part,) = curve.plot("force").axes
        (line,) = part.lines
        if EI in vary[0]:
            np.testing.assert_array_equal(line.get_xydata().T, [[1, 3, 10], curve.column("force")[[1, 2, 0]]])
    drawn_cells = flexlab.sweep(
        "paper", [f"{EI}=1:10", f"{K}=1:10"], 0.1, design="sobol", samples=4, folder=tmp_path / "sobol"
    )
    assert len(drawn_cells.plot("force").axes) == 2
    with pytest.raises(StudyError, match=r"'forc' is not a metric: choose one of duration, rms_error\.x"):
        sweep.plot("forc")
    trade_off = drawn_cells.plot_pareto("rms_error.y", "peak_torque").axes[0]
    assert [trade_off.get_xlabel(), trade_off.get_ylabel()] == ["RMS error y (mm)", "Peak joint torque (N·m)"]
    assert len(trade_off.lines[0].get_xdata()) == len(drawn_cells)


def test_a_figure_shows_every_cell_or_says_how_many_it_leaves_out(tmp_path: Path):
    """A third numeric field gets a panel per value: in one map the cells would overlap, and only the last would be seen."""
    third = "gravity=0:8:3"
    grid = flexlab.sweep("paper", [f"{EI}=10:1000:log:2", f"{K}=100:300:2", third], 0.02, folder=tmp_path / "grid")
    maps = [part for part in grid.plot("peak_torque").axes if part.get_title()]
    assert [part.get_title() for part in maps] == ["gravity = 0", "gravity = 4", "gravity = 8"]
    torque = grid.table.column("peak_torque").to_numpy().reshape(2, 2, 3)
    for number, part in enumerate(maps):
        np.testing.assert_array_equal(part.collections[0].get_array(), torque[:, :, number].T)
        assert [*part.get_xlim(), *part.get_ylim()] == pytest.approx([1, 10_000, 0, 400]), (
            "values are in the cells' middles"
        )
    many = flexlab.sweep(
        "paper", [f"{EI}=50:100:2", "gravity=0:8:2", "title=a,b,c,d,e,f,g,h"], 0.0, folder=tmp_path / "many"
    )
    title = many.plot("peak_torque").get_suptitle()
    assert title == "Peak joint torque (N·m), 6 of 8 combinations"
