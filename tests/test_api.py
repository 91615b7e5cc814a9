"""The Python interface: names, files and values; what a run can do; what type checkers and `dir` see."""

import gc
import json
import os
import pickle
import subprocess
import sys
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from exported import export_run

import flexlab
from flexlab.errors import FlexlabError, PresetError, RecordingError, ScenarioError, StudyError
from flexlab.presets import scenario_text
from flexlab.recording.rerun_internals.chunks import new_stream
from flexlab.sim.commands import Tap


def test_a_scenario_may_be_a_name_a_file_an_object_or_plain_data(tmp_path: Path):
    paper = flexlab.load_preset("paper")
    file = tmp_path / "mine.json"
    file.write_text(scenario_text(paper), encoding="utf-8")
    runs = [flexlab.simulate(given, 0.05) for given in ("paper", file, str(file), paper, json.loads(file.read_text()))]
    assert [run.name for run in runs] == ["paper", "mine", "mine", "paper", "paper"]
    for run in runs:
        assert run.scenario == paper
        np.testing.assert_array_equal(run.pose, runs[0].pose)
    many = flexlab.simulate_many(["paper", paper, {"gravity": 99.0}], 0.05, progress=False)
    assert [(run.name, str(run.status), len(run)) for run in many] == [
        ("paper", "finished", 51),
        ("paper", "finished", 51),
        ("run", "invalid", 0),
    ]


@pytest.mark.parametrize(
    ("given", "kind", "says"),
    [
        ("papier", PresetError, "did you mean paper"),
        ("no/such.json", PresetError, "no scenario file"),
        ({"gravty": 1}, ScenarioError, "gravty is not a scenario field"),
        (None, StudyError, "NoneType is not a scenario: give a Scenario, the name of a preset"),
        (3.0, StudyError, "float is not a scenario"),
        (["paper"], StudyError, "list is not a scenario"),
    ],
)
def test_a_wrong_scenario_is_refused_in_one_line(given: object, kind: type[FlexlabError], says: str):
    with pytest.raises(kind, match=says) as caught:
        flexlab.simulate(given)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_a_run_has_metrics_and_a_repr_of_one_line():
    run = flexlab.simulate("paper", 1.0)
    assert run.metrics.settling_time == pytest.approx(0.44, abs=0.005)
    assert run.metrics.window == (0.0, 1.0)
    assert repr(run) == "<Run of paper: finished, 1001 samples, t = 0 s to 1 s>"
    assert repr(run.scenario) == str(run.scenario)
    modes = flexlab.modes(run.scenario)
    assert repr(modes).startswith("<Modes: 4, the first at 44.6 Hz; 14 poles, a stable loop>")
    assert not any(part.flags.writeable for part in (modes.shape, pickle.loads(pickle.dumps(modes)).shape))
    for words in (repr(run), repr(run.scenario), repr(run.metrics), repr(modes)):
        assert len(words) < 300
        assert "\n" not in words
    assert "<th>Vibration below 1\xa0% after (s)</th>" in run.metrics._repr_html_()
    refused = repr(flexlab.simulate_many([{"gravity": 99}], progress=False)[0])
    assert refused.startswith("<Run of run: did not finish (invalid: ")
    assert refused.endswith("), 0 samples>")


def test_a_run_becomes_an_arrow_table_a_data_frame_and_a_figure():
    run = flexlab.simulate("paper", 0.1)
    table = run.to_arrow()
    assert table.num_rows == 101
    np.testing.assert_array_equal(table["joint_torque_left_2 [N·m]"].to_numpy(), run.joint_torque[:, 0, 1])
    frame = run.to_pandas()
    assert list(frame.columns) == table.column_names
    np.testing.assert_array_equal(frame["pose_theta [rad]"], run.pose[:, 2])
    assert [(part.get_ylabel(), len(part.lines)) for part in run.plot("joint_torque", "tracking_error").axes] == [
        (r"τ$_{\mathrm{i}}$ (N·m)", 6), ("e (m)", 2), ("e (rad)", 1),
    ]  # fmt: skip
    legends = [part.get_legend() for part in run.plot("pose", "midspan_deflection").axes]
    assert [each and [text.get_text() for text in each.get_texts()] for each in legends] == [
        ["x", "y"],
        ["theta"],
        None,
    ]
    beam = run.plot("beam_coordinates").axes[0].lines  # Pinned ends have slopes alone.
    assert [(line.get_label(), line.get_ydata()[-1]) for line in beam] == [
        ("node1 deflection", run.midspan_deflection[-1])
    ]
    assert [part.get_ylabel() for part in run.plot().axes] == ["mm", "mrad", "mm", "N", "N·m"]
    np.testing.assert_allclose(run.plot().axes[1].lines[0].get_ydata(), 1e3 * run.tracking_error[:, 2])
    with pytest.raises(StudyError, match="'torque' is not a signal of this run: choose from time, pose"):
        run.plot("torque")
    with pytest.raises(StudyError, match="nothing to draw"):
        flexlab.simulate_many([{"gravity": 99}], progress=False)[0].plot()


def test_tables_in_notebooks_escape_the_markup_of_a_title():
    scenario = flexlab.load_preset("paper").replace({"title": "<script>alert(1)</script>"})
    run = flexlab.simulate(scenario, 0.05)
    for shown in (scenario, run, run.metrics, flexlab.modes(scenario)):
        html = shown._repr_html_()
        assert "<script" not in html
        assert html.count("<table") == html.count("</table>")
    assert "<td>payload.bending_stiffness</td><td>100.0</td><td>N·m²</td>" in scenario._repr_html_()
    assert "RMS internal force (N)" in run._repr_html_()


def test_pandas_and_numpy_read_an_exported_csv(tmp_path: Path):
    """The documentation shows both calls."""
    run = flexlab.simulate("paper", 0.05)
    file = export_run(run, tmp_path / "run.csv")
    frame = pandas.read_csv(file, comment="#")
    np.testing.assert_array_equal(frame["pose_x [m]"], run.pose[:, 0])
    table = np.genfromtxt(file, delimiter=",", skip_header=2)
    np.testing.assert_array_equal(table[:, 0], run.time)
    assert table.shape == frame.shape


def test_a_saved_run_is_read_again_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    run = flexlab.simulate("soft-beam", 0.1)
    path = run.save()
    assert path.parent == Path("logs")
    for found in (flexlab.read(path), flexlab.read("newest"), flexlab.read(path.stem), flexlab.read(path, "elsewhere")):
        assert (found.name, found.scenario, str(found.status)) == ("soft-beam", run.scenario, "finished")
        np.testing.assert_array_equal(found.joint_torque, run.joint_torque)
        assert repr(found.metrics) == repr(run.metrics)
    with pytest.raises(
        RecordingError, match=r"^table\.csv is no recording \(\.rrd\): flexlab\.export\(run, 'table\.csv'\)"
    ):
        run.save("table.csv")
    assert not Path("table.csv").exists()
    with pytest.raises(RecordingError, match="no recording nothing"):
        flexlab.read("nothing")
    with pytest.raises(StudyError, match="names no recording"):
        flexlab.read(7)  # type: ignore[arg-type]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork processes")
def test_forked_processes_save_runs_too(tmp_path: Path):
    """As `multiprocessing.Pool` on Linux does: rerun refused, as its streams of the first process could not be ended."""
    run = flexlab.simulate("paper", 0.02)
    run.save(tmp_path)
    dropped: list[Any] = [new_stream("flexlab", "dropped")]
    dropped.append(dropped)  # Only a collection of garbage ends it, which may come after the fork.
    gc.disable()
    del dropped
    with get_context("fork").Pool(1) as pool:
        gc.enable()
        pool.apply_async(gc.collect).get(60)
        saved = [pool.apply_async(run.save, [tmp_path]).get(60) for _ in range(2)]
    assert len(set(saved)) == 2
    assert {flexlab.read(path).result_hash for path in saved} == {run.result_hash}


def test_dir_and_all_list_every_public_name():
    assert set(flexlab.__all__) == {"__version__", *flexlab._HOMES}
    assert set(flexlab.__all__) <= set(dir(flexlab))
    for name in flexlab.__all__:
        assert getattr(flexlab, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = flexlab.simulat  # type: ignore[attr-defined]


def test_tab_completion_offers_no_names_of_other_modules():
    others = {name for name in dir(flexlab) if not name.startswith("_")} - set(flexlab.__all__)
    assert {name for name in others if f"flexlab.{name}" not in sys.modules} == set()


@pytest.mark.parametrize(
    ("package", "now"), [("own_laws", "flexlab.Measurement and"), ("own_paths", "flexlab.OwnPath")]
)
def test_a_removed_package_is_answered_with_its_replacement(package: str, now: str):
    with pytest.raises(AttributeError, match=f"no attribute '{package}': since 0.3.0 take {now}"):
        getattr(flexlab, package)


def test_results_can_be_compared_and_put_in_a_set():
    """`==` raised "the truth value of an array is ambiguous", and no result could be put in a set."""
    run = flexlab.simulate("paper", 0.3)
    tapped = flexlab.simulate("paper", 0.6, commands=[(0.1, Tap(0.0, (0.0, 0.05)))])
    for first, second in (
        (flexlab.modes("paper"), flexlab.modes("paper")),
        (flexlab.compare(run, tapped), flexlab.compare(run, tapped)),
        (flexlab.fit(tapped), flexlab.fit(tapped)),
    ):
        assert first == first
        assert first != second
        assert len({first, second, first}) == 2


def test_type_checkers_see_the_public_names(root: Path, tmp_path: Path):
    """In a user's own file beside the installed package: py.typed is there, and names have types."""
    assert (root / "flexlab" / "py.typed").exists()
    own = tmp_path / "own.py"
    own.write_text(
        "import flexlab\n"
        'run = flexlab.simulate("paper", 1.0)\n'
        "reveal_type(run.pose)\n"
        "reveal_type(run.metrics)\n"
        'reveal_type(flexlab.read("newest").save())\n'
        'reveal_type(flexlab.modes(flexlab.load_preset("paper")).frequency)\n'
    )
    done = subprocess.run(
        [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, str(own)],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    types = [line.split('" is ')[1] for line in done.stdout.splitlines() if '" is ' in line]
    assert [name.split("[")[0].strip('"') for name in types] == ["ndarray", "RunMetrics", "Path", "ndarray"], (
        done.stdout
    )
    assert "0 errors" in done.stdout


def test_importing_flexlab_loads_no_heavy_library():
    """`dir` knows the public names before the libraries behind them are loaded."""
    code = (
        "import flexlab, sys; dir(flexlab); print(*sorted({'numba', 'numpy', 'pydantic', 'rerun'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_a_run_becomes_an_xarray_dataset_with_named_axes():
    run = flexlab.simulate("paper", 0.05)
    data = run.to_xarray()
    torque = data.joint_torque.sel(arm="right", joint="2")
    np.testing.assert_array_equal(torque, run.joint_torque[:, 1, 1])
    assert (torque.attrs["units"], torque.dims) == ("N·m", ("time",))
    assert list(data.tracking_error.axis.values) == ["x", "y", "theta"]
    assert list(data.beam_coordinates.coordinate.values) == [
        "node0_slope",
        "node1_deflection",
        "node1_slope",
        "node2_slope",
    ]
    np.testing.assert_array_equal(data.time, run.time)
    assert set(data.variables) >= set(run.signals())
    assert flexlab.parse_scenario(json.loads(data.attrs["scenario"])) == run.scenario
