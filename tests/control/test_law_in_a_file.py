"""A law in one file outside the package: simulated, recorded, plotted, exported, replayed, continued, refused when incomplete."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exported import export_run

from flexlab.analysis.replay import replay
from flexlab.control.law import Law, add_law, add_law_file, forget_law
from flexlab.errors import RecordingError, ScenarioError
from flexlab.lab.panel.sections import entries
from flexlab.lab.plots import tabs
from flexlab.own.files import law_kind
from flexlab.presets import load_preset
from flexlab.recording.export import import_run
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World
from flexlab.views import views

FILE = Path(__file__).parent / "own_laws" / "leaky_integral.py"


@pytest.fixture(scope="module")
def law() -> Iterator[Law]:
    """The law of the file, known to flexlab."""
    yield add_law_file(FILE)
    forget_law("leaky-integral")


@pytest.fixture(scope="module")
def scenario(law: Law) -> Scenario:
    """The paper's scenario under that law."""
    return load_preset("paper").replace({"controller.kind": law.kind, "controller.velocity_gain": 900.0})


def test_it_drives_the_payload_and_its_signal_tells_the_work_of_the_motors(scenario: Scenario):
    run = simulate(scenario, 0.5)
    assert run.status == "finished"
    assert np.abs(run.tracking_error[-1]).max() < 0.05
    np.testing.assert_allclose(run["asked_work"], run.input_work, rtol=1e-7, atol=1e-9)
    assert np.isnan(run.bound_estimates).all(), "it estimates no bounds"


def test_a_second_process_can_run_it_with_the_machine_code_of_the_first(scenario: Scenario):
    assert len(World(scenario).advance(2)) == 2
    script = (
        f"from flexlab.control.law import add_law_file; from pathlib import Path; law = add_law_file(Path({str(FILE)!r}))\n"
        "from flexlab.presets import load_preset; from flexlab.sim.world import World\n"
        'print(len(World(load_preset("paper").replace({"controller.kind": "leaky-integral"})).advance(2)))\n'
        "stats = [kernel.stats for kernel in (law.kernel, law.fastest_rate)]\n"
        "print([(sum(each.cache_hits.values()), sum(each.cache_misses.values())) for each in stats])\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout == "2\n[(1, 0), (1, 0)]\n", done.stderr


@pytest.mark.parametrize("period", [None, 0.002])
def test_it_continues_bit_for_bit_from_a_saved_state(scenario: Scenario, period: float | None):
    one, other = (World(scenario.replace({"controller.control_period": period})) for _ in range(2))
    one.advance(37)
    other.restore(one.state())
    first, second = one.advance_rows(20), other.advance_rows(20)
    assert first.tobytes() == second.tobytes()


def test_it_takes_over_and_gives_back_in_motion(scenario: Scenario):
    world = World(load_preset("paper"))
    world.advance(20)
    world.apply(ChangeScenario({"controller.kind": "leaky-integral"}))
    assert len(world.advance(20)["asked_work"]) == 20
    world.apply(ChangeScenario({"controller.kind": "adaptive-sliding-mode"}))
    assert len(world.advance(20)) == 20
    assert "asked_work" not in world.observe().own


def test_it_is_recorded_plotted_exported_and_replayed(scenario: Scenario, tmp_path: Path):
    run = simulate(scenario, 0.1)
    path = write_run(run, tmp_path, "own law")
    recording = read_recording(path)
    assert recording.samples["asked_work"].tobytes() == run["asked_work"].tobytes()
    assert replay(recording).identical
    assert "own/asked_work" in [plot.entity for plot in views(scenario)]
    export_run(run, tmp_path / "run.csv")
    np.testing.assert_array_equal(import_run(tmp_path / "run.csv")[0]["asked_work"], run["asked_work"])


def test_a_recording_says_how_to_read_it_without_the_file(law: Law, scenario: Scenario, tmp_path: Path):
    """Recordings hold no kernels. The error used to list flexlab's own laws, which did not help."""
    path = write_run(simulate(scenario, 0.1), tmp_path, "own law")
    forget_law(law.kind)
    try:
        with pytest.raises(
            RecordingError,
            match=r"'leaky-integral'\. If a file of yours .* flexlab\.control\.law\.add_law_file\(Path\(FILE\)\)",
        ):
            read_recording(path)
    finally:
        add_law(law)
    assert replay(read_recording(path)).identical


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("    limits=", "    carry=None, limits=", "'carry' is called 'bumpless_transfer' now"),
        (
            "from flexlab.signal import Signal",
            "from flexlab.signal import Signal\nfrom flexlab.control.load_sharing import drive_arms",
            "flexlab.control.load_sharing is called flexlab.control.law_kernels now",
        ),
    ],
)
def test_an_earlier_name_is_refused_with_the_new_one(tmp_path: Path, old: str, new: str, says: str):
    (tmp_path / "earlier.py").write_text(FILE.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ScenarioError, match=says):
        law_kind(str(tmp_path / "earlier.py"))


def test_the_screen_has_its_sliders_and_its_plot(scenario: Scenario):
    names = [entry.name for entry in entries(scenario, "controller")]
    assert names[:2] == ["Velocity gain D", "Largest integral I_max"]
    assert [name.split()[0] for name in names[2:]] == ["Load", "Wanted"], "what all laws share"
    plot = next(plot for plot in tabs(scenario)["Control"] if "W_u" in plot.title)
    assert plot.limits[0].label == "none (J)"


def test_a_law_that_does_not_say_its_fastest_rate_is_refused(law: Law):
    with pytest.raises(ImportError, match="does not say its fastest rate"):
        add_law(replace(law, fastest_rate=None))


def test_two_laws_of_one_name_are_refused(law: Law):
    with pytest.raises(ImportError, match="Two control laws are called"):
        add_law(replace(law, place=1))


def test_a_file_without_a_law_is_refused(tmp_path: Path):
    (tmp_path / "empty.py").write_text("pass\n")
    with pytest.raises(ImportError, match="defines no control law"):
        add_law_file(tmp_path / "empty.py")


def test_its_gains_are_checked_like_all_others(law: Law):
    with pytest.raises(ScenarioError, match=r"controller\.velocity_gain = -1 N·s/m is outside .* 0 to 1000000 N·s/m"):
        parse_scenario({"controller": {"kind": law.kind, "velocity_gain": -1.0}})
