"""A path in one file outside the package: simulated, recorded, exported, replayed, chosen in motion, drawn, shared, refused."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest
from exported import export_run

from flexlab.analysis.replay import replay
from flexlab.control.path import Path, add_path, add_path_file, forget_path
from flexlab.errors import ScenarioError
from flexlab.lab.panel.sections import GROUPS, entries, present
from flexlab.lab.scene.overlays import path_points
from flexlab.presets import load_preset, load_scenario_file, save_scenario
from flexlab.recording.export import import_run
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.scenario import Scenario, parse_scenario
from flexlab.scenario.field_text import options
from flexlab.server.scenario_links import decode_scenario, encode_scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

FILE = FilePath(__file__).parent / "own_paths" / "spiral.py"


@pytest.fixture(scope="module")
def path() -> Iterator[Path]:
    """The path of the file, known to flexlab."""
    yield add_path_file(FILE)
    forget_path("spiral")


@pytest.fixture(scope="module")
def scenario(path: Path) -> Scenario:
    """The paper's scenario on that path."""
    return load_preset("paper").replace({"trajectory.kind": path.kind, "trajectory.duration": 0.2})


def test_the_payload_follows_it_and_holds_its_end(scenario: Scenario):
    run = simulate(scenario, 1.0)
    assert run.status == "finished"
    np.testing.assert_allclose(run.desired_pose[200:], np.tile((0.1, 0.75, 0.0), (801, 1)), rtol=0, atol=1e-12)
    assert np.abs(run.tracking_error[-1]).max() < 1e-4


def test_extent_and_acceleration_that_it_does_not_declare_are_sampled(scenario: Scenario):
    assert scenario.trajectory.middle == pytest.approx((0.0125, 0.75, 0), abs=0.02)
    assert scenario.trajectory.reach[0] == pytest.approx(0.0875, abs=0.01)
    assert scenario.trajectory.peak_acceleration[1] > 10
    np.testing.assert_allclose(path_points(scenario)[-1], (0.1, 0.75), rtol=0, atol=1e-12)


def test_a_path_out_of_reach_is_reported_before_the_run(scenario: Scenario):
    assert (
        "cannot reach the desired pose" in World(scenario.replace({"trajectory.center": (0.0, 1.7, 0.0)})).status.text
    )


def test_it_is_recorded_exported_and_replayed(scenario: Scenario, tmp_path: FilePath):
    run = simulate(scenario, 0.3)
    recording = read_recording(write_run(run, tmp_path, "own path"))
    assert recording.scenario == scenario
    assert replay(recording).identical
    export_run(run, tmp_path / "run.csv")
    np.testing.assert_array_equal(import_run(tmp_path / "run.csv")[0].desired_pose, run.desired_pose)


def test_files_and_links_keep_it(scenario: Scenario, tmp_path: FilePath):
    save_scenario(scenario, tmp_path / "spiral.json")
    assert load_scenario_file(tmp_path / "spiral.json") == scenario
    assert decode_scenario(encode_scenario(scenario)) == scenario


def test_the_screen_has_its_sliders_its_boxes_and_its_name(scenario: Scenario):
    names = [entry.name for entry in entries(scenario, "trajectory")]
    assert names[:3] == ["Largest radius R", "Turns N", "Duration T_m"]
    assert "trajectory.center" in {field for group in GROUPS for field in present(scenario, group)}
    assert "spiral" in options("trajectory.kind")


def test_a_change_to_it_in_motion_does_not_make_the_target_jump(scenario: Scenario):
    world = World(load_preset("paper"))
    world.advance(60)
    before = world.observe().desired_pose
    world.apply(ChangeScenario({"trajectory.kind": "spiral"}))
    np.testing.assert_allclose(world.observe().desired_pose, before, rtol=0, atol=1e-12)
    assert len(world.advance(50)) == 50


def test_its_numbers_are_checked_like_all_others(path: Path):
    with pytest.raises(ScenarioError, match=r"trajectory\.largest_radius = 2 m is outside .* 0 to 1 m"):
        parse_scenario({"trajectory": {"kind": path.kind, "largest_radius": 2.0}})


def test_two_paths_of_one_name_are_refused(path: Path):
    with pytest.raises(ImportError, match="Two paths are called"):
        add_path(replace(path, place=1))


def test_a_file_without_a_path_is_refused(tmp_path: FilePath):
    (tmp_path / "empty.py").write_text("pass\n")
    with pytest.raises(ImportError, match="defines no path"):
        add_path_file(tmp_path / "empty.py")


def test_a_path_with_a_property_under_its_former_name_is_refused(path: Path):
    class Old(path.model):  # type: ignore[name-defined, misc]
        @property
        def kinks(self) -> tuple[float, ...]:
            return (0.1,)

    with pytest.raises(ImportError, match="'spiral' has a property 'kinks', which nothing asks for any more: call it"):
        add_path(replace(path, model=Old))
