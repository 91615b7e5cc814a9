"""Units as control laws: a law that flexlab exported gives the same run, and a unit that cannot drive the arms is refused."""

import re
import shutil
import sys
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_law_text import allow_no_own_laws, forget_own_laws
from waiting import wait_until

import flexlab
from flexlab.errors import ScenarioError, StudyError
from flexlab.lab.session import Session
from flexlab.own import hosts
from flexlab.own.files import LAW_FILES, law_kind
from flexlab.own.unit import unit_in
from flexlab.presets import load_preset
from flexlab.quantities import base_exponents
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import options
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.world import World

TICK = 0.001
Exported = Callable[..., Path]


@pytest.fixture
def exported(export: Exported) -> Exported:
    """`export` for the part law."""
    return partial(export, part="law")


def changed(file: Path, folder: Path, old: str, new: str) -> Path:
    """A copy of a unit, with `old` replaced by `new` in its model description."""
    other = folder / "changed.fmu"
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(other, "w") as target:
        for name in source.namelist():
            data = source.read(name)
            if name == "modelDescription.xml":
                text = data.decode()
                assert old in text
                data = text.replace(old, new).encode()
            target.writestr(name, data)
    return other


QUIET = {"controller.sensor_noise.strain": 0.0}
PLAIN = {"controller.wanted_internal_force": 0.0}


@pytest.mark.parametrize(
    ("preset", "law", "version", "off"),
    [
        ("paper", "adaptive-sliding-mode", 3, {}),
        ("paper", "pd", 2, {}),
        ("gravity", "super-twisting", 3, {}),
        ("composite", "composite", 3, QUIET),
        ("lqr", "lqr", 2, QUIET),
        ("squeeze-until-it-buckles", "disturbance-observer", 3, PLAIN),
    ],
)
def test_an_exported_law_used_as_a_law_gives_the_same_run_bit_for_bit(
    exported: Exported, preset: str, law: str, version: int, off: dict[str, Any]
):
    scenario = load_preset(preset)
    scenario = scenario.replace({"controller.kind": law} if law != scenario.controller.kind else {})
    scenario = scenario.replace({"controller.control_period": TICK})
    wanted = flexlab.simulate(scenario, 0.1)
    run = flexlab.simulate(scenario.replace(off), 0.1, law=exported(scenario, version=version))
    assert run.status == "finished"
    for name in ("pose", "pose_rate", "joint_torque", "internal_force", "midspan_deflection"):
        np.testing.assert_array_equal(run[name], wanted[name], err_msg=name)


def test_outputs_and_parameters_of_a_unit_become_signals_and_gains(exported: Exported):
    scenario = load_preset("gravity").replace({"controller.kind": "super-twisting"})
    scenario = scenario.replace({"controller.control_period": TICK})
    chosen = scenario.replace({"controller.kind": law_kind(exported(scenario))})
    assert chosen.controller.proportional_gain_1 == 120.0
    with pytest.raises(ScenarioError, match=r"proportional_gain_1.*-1"):
        chosen.replace({"controller.proportional_gain_1": -1.0})
    tuned = {f"controller.proportional_gain_{k}": 150.0 for k in (1, 2, 3)}
    wanted = flexlab.simulate(scenario.replace({"controller.proportional_gain": 150.0}), 0.05)
    run = flexlab.simulate(chosen.replace(tuned), 0.05)
    np.testing.assert_array_equal(run.pose, wanted.pose)
    np.testing.assert_array_equal(run["twisting_force_x"], wanted["twisting_force"][:, 0])


def test_a_world_returns_to_a_state_and_continues_with_another_gain(exported: Exported):
    scenario = load_preset("paper").replace({"controller.control_period": TICK})
    chosen = scenario.replace({"controller.kind": law_kind(exported(scenario))})
    world = World(chosen)
    world.advance(20)
    there = world.state()
    first = world.advance(20).pose
    world.restore(there)
    np.testing.assert_array_equal(world.advance(20).pose, first)
    world.restore(there)
    world.apply(ChangeScenario({"controller.feedback_gain_1": 500.0}))
    assert not np.array_equal(world.advance(20).pose, first)
    np.testing.assert_array_equal(World(chosen).run(40).pose[21:], first)


def test_a_unit_that_cannot_save_its_state_gives_the_same_run(exported: Exported, tmp_path: Path):
    scenario = load_preset("paper").replace({"controller.control_period": TICK})
    whole = 'canGetAndSetFMUState="true"'
    file = changed(exported(scenario), tmp_path, whole, whole.replace("true", "false"))
    wanted, run = flexlab.simulate(scenario, 0.1), flexlab.simulate(scenario, 0.1, law=file)
    np.testing.assert_array_equal(run.pose, wanted.pose)
    # The beginning is alike: the unit's earlier answers would fit, and be wrong later.
    softer = scenario.replace({"payload.bending_stiffness": 50.0})
    np.testing.assert_array_equal(
        flexlab.simulate(softer, 0.1, law=file).pose, flexlab.simulate(softer, 0.1).pose, err_msg="the second run"
    )
    chosen = [scenario.replace({"controller.kind": law_kind(one)}) for one in (exported(scenario), file)]
    saving, computing = map(back_with_another_gain, chosen)
    np.testing.assert_array_equal(computing, saving)
    np.testing.assert_array_equal(World(chosen[1]).run(40).pose, wanted.pose[:41])


def back_with_another_gain(scenario: Scenario) -> np.ndarray:
    """Poses of a world that goes back, first as it was, then with another gain, and at last where it had been."""
    world = World(scenario)
    there = world.state()
    first = world.advance(20).pose
    later = world.state()
    world.restore(there)
    np.testing.assert_array_equal(world.advance(5).pose, first[:5])
    world.apply(ChangeScenario({"controller.feedback_gain_1": 500.0}))
    other = world.advance(5).pose
    world.restore(later)
    return np.concatenate([first, other, world.advance(5).pose])


def test_units_of_measure_are_reduced_to_base_units():
    assert base_exponents("kg·m²/s") == {"kg": 1, "m": 2, "s": -1}
    assert base_exponents("N·m") == {"kg": 1, "m": 2, "s": -2}
    assert base_exponents("rad/s") == {"rad": 1, "s": -1}
    assert base_exponents("1") == {}


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('name="motor_torque_left_2"', 'name="torque"', "has no output motor_torque_left_2: a law needs motor_torque_left_1"),
        ('name="pose_y"', 'name="height"', "has an input height that flexlab does not have: it gives pose_x"),
        ('<BaseUnit m="1" />', '<BaseUnit m="1" factor="0.001" />', "has an input pose_x in m: it has to be in m"),
        ('unit="rad/s"', 'unit="m/s"', "has an input pose_rate_theta in m/s: it has to be in rad/s"),
        ('fmiVersion="3.0"', 'fmiVersion="1.0"', "is not a unit that can be read"),
        ("<CoSimulation", "<Other", "is not made for co-simulation: export it for that."),
        ('start="0.0" />', 'start="" />', "has a step size, or a start or limit of a parameter, that is not a finite number"),
        ('start="0.0" />', 'start="NaN" />', "has a step size, or a start or limit of a parameter, that is not a finite"),
        ('stepSize="0.001"', 'stepSize="fast"', "has a step size, or a start or limit of a parameter, that is not a finite"),
    ],
)  # fmt: skip
def test_a_unit_unable_to_drive_the_arms_is_refused(exported: Exported, tmp_path: Path, old: str, new: str, says: str):
    with pytest.raises(ScenarioError, match=re.escape(f"changed.fmu {says}")):
        law_kind(changed(without_grips(exported, tmp_path), tmp_path, old, new))


def without_grips(exported: Exported, folder: Path) -> Path:
    """A law's unit as another tool would make it: of its outputs, flexlab knows only the motor torques."""
    file = changed(exported(load_preset("paper")), folder, 'name="input_', 'name="u_')
    return Path(shutil.move(file, folder / "motors.fmu"))


def test_a_unit_with_only_motor_torques_drives_the_arms(exported: Exported, tmp_path: Path):
    scenario = load_preset("paper").replace({"controller.control_period": TICK})
    run = flexlab.simulate(scenario, 0.1, law=without_grips(exported, tmp_path))
    np.testing.assert_allclose(run.pose, flexlab.simulate(scenario, 0.1).pose, rtol=0, atol=1e-12)


def test_broken_missing_and_unsuitable_units_are_refused(exported: Exported, tmp_path: Path):
    (tmp_path / "text.fmu").write_text("no archive")
    with pytest.raises(ScenarioError, match=r"text\.fmu is not a unit that can be read \(File is not a zip file\)"):
        law_kind(tmp_path / "text.fmu")
    with pytest.raises(ScenarioError, match=r"none\.fmu cannot be read: there is no such file\."):
        law_kind(str(tmp_path / "none.fmu"))
    says = "it drives 1 arm, and the scenario has 2."
    assert says in flexlab.simulate("paper", 0.01, law=exported(load_preset("single-arm"))).status.text


def test_a_missing_fmpy_is_reported(exported: Exported, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(ScenarioError, match=r'needs FMPy, which is not installed: pip install "flexlab\[fmu\]"'):
        law_kind(exported(load_preset("paper")))


def test_a_unit_of_another_tool_drives_the_arms(tmp_path: Path):
    builder = pytest.importorskip("pythonfmu.builder")
    source = Path(__file__).with_name("pd_of_another_tool.py")
    file = builder.FmuBuilder.build_FMU(source, dest=tmp_path)
    run = flexlab.simulate("gravity", 0.1, law=file)
    assert run.status == "finished"
    assert np.abs(run["effort"]).max() > 1
    np.testing.assert_allclose(run.pose, flexlab.simulate("gravity", 0.1, law=SamePD).pose, rtol=0, atol=1e-13)


class SamePD(flexlab.OwnLaw):
    """The law that the unit of another tool computes."""

    position_gain = flexlab.gain(2e4, "N/m, N·m/rad", low=0, high=1e6)
    velocity_gain = flexlab.gain(800.0, "N·s/m, N·m·s/rad", low=0, high=1e5)

    def act(self, at):
        e, e_dot = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        return at.weights + at.shared(-self.position_gain * e - self.velocity_gain * e_dot)


def test_a_unit_that_fails_stops_the_run_with_its_own_sentence(exported: Exported, tmp_path: Path):
    file = changed(exported(load_preset("paper")), tmp_path, 'instantiationToken="', 'instantiationToken="0')
    with pytest.raises(
        ScenarioError, match=r"changed\.fmu: The model description and the binary .* different exports\."
    ):
        flexlab.simulate("paper", 0.1, law=file)
    scenario = load_preset("paper").replace({"controller.kind": law_kind(exported(load_preset("paper")))})
    world = World(scenario)
    world.advance(5)
    assert world.apply(ChangeScenario({"controller.control_period": 0.0015})) is False
    world.advance(20)
    assert "The communication step 0.0015 s is not a whole number of this unit's ticks of 0.001 s" in world.status.text


def test_a_recording_names_the_file_and_a_replay_needs_it(
    exported: Exported, flexlab_command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    file = Path(shutil.copy(exported(load_preset("paper")), tmp_path / "mine.fmu"))
    done = flexlab_command("run", "paper", "--law", "mine.fmu", "--duration", "0.05")
    assert done.returncode == 0, done.stderr
    allow_no_own_laws()
    source = flexlab.read(next((tmp_path / "logs").glob("*.rrd"))).scenario.controller.source
    assert unit_in(source, [tmp_path]) == ("mine.fmu", str(file))
    assert unit_in(source + "#", [tmp_path]) == ("mine.fmu", "")
    asked = flexlab_command("replay")
    assert asked.returncode == 2
    assert f"by the unit {file}, machine code that a replay needs. Let it run here?" in " ".join(asked.stderr.split())
    assert "bit for bit" in flexlab_command("replay", "--run-own-law").stdout
    hosts.close_all()
    hosts._allowed.clear()
    own = tmp_path / LAW_FILES.own / file.name
    own.parent.mkdir(parents=True)
    file.rename(own)
    with pytest.raises(StudyError, match="let it run by run_own_law=True"):
        flexlab.replay("newest")
    assert flexlab.replay("newest", run_own_law=True).agrees, "Python finds it, too"
    hosts.close_all()
    hosts._allowed.clear()
    own.rename(tmp_path / "gone.fmu")
    gone = flexlab_command("replay", "--run-own-law")
    assert gone.returncode == 2
    assert "was controlled by the unit mine.fmu, machine code that recordings do not hold" in " ".join(
        gone.stderr.split()
    )


def test_a_unit_in_the_folder_of_laws_is_added_to_the_menu(
    exported: Exported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "presets/laws").mkdir(parents=True)
    shutil.copy(exported(load_preset("paper")), tmp_path / "presets/laws/mine.fmu")
    assert LAW_FILES.add_all() == []
    assert "fmu-mine" in options("controller.kind")
    assert flexlab.simulate("paper", 0.01, law="fmu-mine").status == "finished"


def test_a_unit_put_into_the_folder_of_laws_while_a_lab_runs_is_taken_up(
    exported: Exported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    file = exported(load_preset("paper"))
    with Session(load_preset("paper"), shadows=False) as lab:
        LAW_FILES.own.mkdir(parents=True)
        shutil.copy(file, LAW_FILES.own / "later.fmu")
        said = "later.fmu was saved: choose the control law fmu-later in the menu to use it."
        wait_until(lambda: lab.lab_state.notice.text == said, "the lab says so")
        lab.lab_state.change({"controller.kind": "fmu-later"})
        wait_until(lambda: lab.runner.snapshot.scenario.controller.kind == "fmu-later", "it drives the arms")
    forget_own_laws()
