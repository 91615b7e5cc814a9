"""Functional mock-up units in FMPy, an independent importer: they are valid, give the engine's bits and keep whole states."""

import math
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from own_law_text import PD, forget_own_laws
from units_in_fmpy import apart, get, instance, put

import flexlab
from flexlab.errors import StudyError
from flexlab.fmi import write_fmu
from flexlab.fmi.description import law_signals
from flexlab.fmi.parts import make_part
from flexlab.own.law import add_own_law
from flexlab.presets import load_preset, preset_names
from flexlab.recording.table_columns import table_columns, to_columns
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.target import build_trajectory, desired_at
from flexlab.sim.world import World

TICK = 0.001
BANG_BANG = {"trajectory": {"kind": "bang-bang", "duration": 0.1513}}
"""A path whose acceleration jumps within ticks."""
FRICTION = {"joints.friction.viscous": (5.0, 5.0, 2.0), "joints.friction.coulomb": (8.0, 6.0, 2.0)}
COMPLIANT = {"grips.model": "compliant", "gravity": 9.81}
FILLED = {
    "payload.mass_change.factor": 2.0,
    "payload.mass_change.begin": 0.05,
    "payload.mass_change.duration": 0.1,
    "controller.model.mass_change_factor": 1.0,
}
MOTORS = {"joints.motor.time_constant": 0.004, "joints.motor.stall_torque": (450.0, 250.0, 90.0)}
ENCODERS = {"joints.encoders.counts": (2e5, 2e5, 1e5), "controller.control_period": 0.001}
GIVEN = [f"desired_{name}_{axis}" for name in ("pose", "rate", "acceleration") for axis in ("x", "y", "theta")]
RESTING = {"trajectory": {"kind": "hold"}, "initial.pose": (0.02, 0.74, 0.05)}
Export = Callable[..., Path]


def outputs(unit: Any) -> np.ndarray:
    return get(unit, list(unit.numbers))


def assert_same_bits(result: np.ndarray, samples: Samples, scenario: Scenario, every: int = 1) -> None:
    names = set(result.dtype.names or ())
    columns = to_columns(samples, table_columns(scenario))
    found = {name.partition(" [")[0]: values for name, values in columns.items()}
    assert names <= set(found)
    assert len(names) > 40
    for name in names:
        np.testing.assert_array_equal(result[name], found[name][::every], err_msg=name)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("part", ["plant", "law", "loop", "follower"])
def test_fmpy_finds_nothing_wrong(export: Export, part: str, version: int):
    file = export(load_preset("paper"), part, version)
    assert validate_fmu(str(file)) == []
    about = fmpy.read_model_description(str(file))
    assert about.fmiVersion == f"{version}.0"
    assert about.defaultExperiment.stepSize == str(TICK)
    inputs = [variable.name for variable in about.modelVariables if variable.causality == "input"]
    motors = [f"motor_torque_{side}_{joint}" for side in ("left", "right") for joint in (1, 2, 3)]
    assert inputs[:6] == {"plant": motors, "loop": []}.get(part, inputs[:6])
    if part == "follower":
        assert inputs == GIVEN
    outputs = {variable.name for variable in about.modelVariables if variable.causality == "output"}
    if part == "law":
        assert set(motors) <= outputs
        assert set(inputs) <= {
            variable.name
            for variable in fmpy.read_model_description(str(export(load_preset("paper"), "plant"))).modelVariables
        }
        return
    units = {variable.name: variable.unit for variable in about.modelVariables}
    assert (units["pose_theta"], units["joint_torque_left_1"], units["kinetic_energy"]) == ("rad", "N·m", "J")
    with zipfile.ZipFile(file) as archive:
        assert {"documentation/index.html", "documentation/licenses/license.txt"} <= set(archive.namelist())


@pytest.mark.parametrize(
    ("preset", "changes", "version", "ticks"),
    [
        ("paper", {}, 3, 1),
        ("paper", {}, 2, 5),
        *((preset, {}, 3, 25) for preset in preset_names()),
        ("paper", {"simulation.integrator": "rk4", "payload.element_count": 2}, 3, 4),
        ("paper", {"simulation.integrator": "generalized-alpha"}, 3, 4),
        ("paper", BANG_BANG, 3, 1),
        ("paper", {**BANG_BANG, "simulation.integrator": "generalized-alpha", "simulation.step": 1e-4}, 3, 1),
        ("paper", FRICTION, 3, 1),
        ("paper", ENCODERS, 3, 1),
        ("paper", MOTORS, 3, 1),
        ("paper", FILLED, 3, 1),
        ("paper", COMPLIANT, 3, 1),
    ],
)
def test_the_loop_gives_the_engines_bits(
    export: Export, preset: str, changes: dict[str, Any], version: int, ticks: int
):
    scenario = load_preset(preset).replace(changes)
    file, duration = export(scenario, "loop", version), 0.3
    names = [each.name for each in fmpy.read_model_description(str(file)).modelVariables if each.causality == "output"]
    step = ticks * TICK
    result = fmpy.simulate_fmu(str(file), stop_time=duration, step_size=step, output_interval=step, output=names)
    run = simulate(scenario, duration, TICK)
    assert len(run) == 301
    assert_same_bits(result[names], run, scenario, ticks)


def test_ticks_with_a_discontinuity_of_the_path_are_split_into_pieces():
    loop = make_part(load_preset("paper").replace(BANG_BANG), "loop", TICK)
    assert {piece.tick for piece in loop.memory.pieces} == {75, 151}


def test_the_plant_with_the_engines_torques_moves_as_the_engine_does(export: Export, tmp_path: Path):
    scenario = load_preset("paper").replace({"controller.control_period": TICK, **FRICTION})
    world = World(scenario)
    moving = ["pose_x", "pose_rate_y", "pose_theta", "midspan_deflection", "elastic_energy", "input_work"]
    moving += ["right_joint_friction_2", "friction_loss"]
    with instance(export(scenario, "plant"), tmp_path) as unit:
        motors = [number for name, number in unit.numbers.items() if name.startswith("motor_torque")]
        for tick in range(200):
            unit.setFloat64(motors, world.state().held_torque.ravel().tolist())
            unit.doStep(tick * TICK, TICK)
            samples = world.advance(1)
            columns = to_columns(samples, table_columns(scenario))
            expected = {name.partition(" [")[0]: float(values[0]) for name, values in columns.items()}
            assert unit.getFloat64([unit.numbers[name] for name in moving]) == [expected[name] for name in moving]


@pytest.mark.parametrize(
    ("preset", "changes"),
    [
        ("paper", {}),
        ("paper", FRICTION),
        ("paper", ENCODERS),
        ("paper", MOTORS),
        ("paper", FILLED),
        ("gravity", {"controller.control_period": TICK, "controller.input_delay": 2}),
        ("composite", {"controller.control_period": TICK, "controller.observer.kind": "kalman"}),
        (
            "fast-adaptation",
            {
                "controller.control_period": TICK,
                "controller.sensor_noise": {"pose": (1e-5, 1e-5, 1e-5), "strain": 1e-7, "seed": 3},
            },
        ),
    ],
)
def test_plant_and_law_make_the_loop(export: Export, tmp_path: Path, preset: str, changes: dict[str, Any]):
    scenario = load_preset(preset).replace(changes)
    sampled = scenario.replace({"controller.control_period": TICK})
    run = simulate(sampled, 0.1, TICK)
    with (
        instance(export(scenario, "plant"), tmp_path / "plant") as plant,
        instance(export(scenario, "law"), tmp_path / "law") as law,
    ):
        motors = [name for name in law.numbers if name.startswith("motor_torque")]
        sensors = [name for name in law.numbers if name.startswith(("pose", "beam_moment", "strain"))]
        for tick in range(100):
            plant.setFloat64([plant.numbers[n] for n in motors], law.getFloat64([law.numbers[n] for n in motors]))
            plant.doStep(tick * TICK, TICK)
            law.setFloat64([law.numbers[n] for n in sensors], plant.getFloat64([plant.numbers[n] for n in sensors]))
            law.doStep(tick * TICK, TICK)
            pose = plant.getFloat64([plant.numbers[f"pose_{axis}"] for axis in ("x", "y", "theta")])
            assert pose == run.pose[tick + 1].tolist()


@pytest.mark.parametrize("version", [2, 3])
def test_coupling_plant_and_law_once_a_step_has_an_error_of_first_order(export: Export, tmp_path: Path, version: int):
    scenario = load_preset("paper")
    files = export(scenario, "plant", version), export(scenario, "law", version)
    worst = [apart(scenario, files, step, 1.0, tmp_path) for step in (4 * TICK, 2 * TICK, TICK)]
    np.testing.assert_allclose(np.divide(worst[:-1], worst[1:]), 2.0, rtol=0.2)


@pytest.mark.parametrize("preset", ["paper", "fast-adaptation", "composite", "single-arm"])
def test_a_follower_of_a_resting_pose_gives_the_engines_bits(export: Export, preset: str):
    scenario = load_preset(preset).replace(RESTING)
    file = str(export(scenario, "follower"))
    names = [each.name for each in fmpy.read_model_description(file).modelVariables if each.causality == "output"]
    result = fmpy.simulate_fmu(file, stop_time=0.2, step_size=TICK, output_interval=TICK, output=names)
    assert_same_bits(result[names], simulate(scenario, 0.2, TICK), scenario)


@pytest.mark.parametrize(
    ("preset", "version", "period"), [("paper", 2, 0.0), ("paper", 3, 0.0), ("fast-adaptation", 3, 0.001)]
)
def test_a_follower_that_is_given_the_path_moves_as_the_loop_does(
    export: Export, tmp_path: Path, preset: str, version: int, period: float
):
    """The given acceleration is held over a step, and a sampled law reads it at its instants: on average half a step late."""
    scenario, worst = load_preset(preset), []
    path, steps = build_trajectory(scenario), np.array([4 * TICK, 2 * TICK, TICK])
    for step in steps:
        run, apart = simulate(scenario, 0.4, step), 0.0
        with instance(export(scenario, "follower", version), tmp_path) as unit:
            for number in range(1, len(run)):
                put(unit, GIVEN, desired_at(path, run.time[number - 1]).ravel())
                unit.doStep(run.time[number - 1], step)
                apart = max(apart, np.abs(get(unit, ["pose_x", "pose_y", "pose_theta"]) - run.pose[number]).max())
        worst.append(apart)
    age = 0.5 * (steps + period)
    np.testing.assert_allclose(np.array(worst) / worst[-1], age / age[-1], rtol=0.1)
    assert worst[-1] < 8e-5


def test_a_follower_goes_where_it_is_told(export: Export):
    given = np.zeros(2, [("time", float), *((name, float) for name in GIVEN)])
    given["time"], given["desired_pose_x"], given["desired_pose_y"] = (0.0, 1.0), 0.05, 0.7
    result = fmpy.simulate_fmu(
        str(export(load_preset("smooth-start"), "follower")), stop_time=1.0, step_size=TICK, input=given,
        output=["pose_x", "pose_y", "pose_theta"],
    )  # fmt: skip
    np.testing.assert_allclose([result[-1][k] for k in (1, 2, 3)], (0.05, 0.7, 0.0), atol=1e-4)


@pytest.mark.parametrize(
    ("preset", "changes", "start"),
    [
        ("gravity", {"gravity": 3.7}, {"gravity": 3.7}),
        (
            "paper",
            {"controller.feedback_gain": (210.0, 205.0, 195.0)},
            {"feedback_gain_1": 210.0, "feedback_gain_2": 205.0, "feedback_gain_3": 195.0},
        ),
        (
            "fast-adaptation",
            {"controller.boundary_layer": 0.05, "gravity": 1.0},
            {"boundary_layer": 0.05, "gravity": 1.0},
        ),
        ("composite", {"controller.sensor_noise.seed": 7}, {"noise_seed": 7.0}),
        (
            "composite",
            {"controller.lateral_vibration_gain": 40.0, "controller.slow.feedback_gain": (210.0, 205.0, 195.0)},
            {
                "lateral_vibration_gain": 40.0,
                "slow_feedback_gain_1": 210.0,
                "slow_feedback_gain_2": 205.0,
                "slow_feedback_gain_3": 195.0,
            },
        ),
    ],
)
def test_a_tuned_parameter_gives_the_run_of_a_scenario_with_that_value(
    export: Export, preset: str, changes: dict[str, Any], start: dict[str, float]
):
    scenario, names = load_preset(preset), ["pose_x", "pose_y", "pose_theta", "joint_torque_left_1"]
    file = str(export(scenario))
    tuned = fmpy.simulate_fmu(
        file, stop_time=0.2, step_size=TICK, output_interval=TICK, output=names, start_values=start
    )
    run, before = simulate(scenario.replace(changes), 0.2, TICK), simulate(scenario, 0.2, TICK)
    np.testing.assert_array_equal(tuned["pose_y"], run.pose[:, 1])
    np.testing.assert_array_equal(tuned["joint_torque_left_1"], run.joint_torque[:, 0, 0])
    assert not np.array_equal(before.pose, run.pose)


@pytest.mark.parametrize(
    ("kind", "changes", "start"),
    [
        ("disturbance-observer", {"observer_gain": 25.0}, {"observer_gain": 25.0}),
        (
            "regressor-adaptive",
            {"feedback_gain": 210.0, "adaptation_gain_links": 3.0},
            {**{f"feedback_gain_{axis}": 210.0 for axis in "123"}, "adaptation_gain_links": 3.0},
        ),
    ],
)
def test_a_tuned_parameter_also_holds_for_a_law_with_an_initial_memory(
    export: Export, kind: str, changes: dict[str, float], start: dict[str, float]
):
    scenario = load_preset("paper").replace({"controller.kind": kind})
    run = simulate(scenario.replace({f"controller.{name}": value for name, value in changes.items()}), 0.2, TICK)
    file = str(export(scenario))
    tuned = fmpy.simulate_fmu(file, stop_time=0.2, step_size=TICK, output=["pose_y"], start_values=start)
    np.testing.assert_array_equal(tuned["pose_y"], run.pose[:, 1])
    assert not np.array_equal(simulate(scenario, 0.2, TICK).pose, run.pose)


def test_a_law_tells_its_own_signals_and_none_of_the_joints_and_the_payload():
    """Their values are part of a plant's state: a law's memory has no place for them."""
    told = law_signals(load_preset("paper").replace({**FRICTION, **FILLED, "controller.kind": "super-twisting"}), 0)
    assert [(each.name, each.place) for each in told] == [
        ("twisting_force_x", 0), ("twisting_force_y", 8), ("twisting_force_theta", 16),
    ]  # fmt: skip


def test_gains_that_are_computed_at_export_cannot_be_tuned(export: Export):
    clocked = load_preset("paper").replace({"controller.control_period": TICK})
    gains = {f"{name}_gain_{axis}" for name in ("position", "velocity") for axis in "123"}
    for kind, tunable in (("lqr", set()), ("joint-pd", gains)):
        about = fmpy.read_model_description(str(export(clocked.replace({"controller.kind": kind}), "law")))
        assert {each.name for each in about.modelVariables if each.causality == "parameter"} == tunable


def test_a_parameter_out_of_range_is_refused(export: Export, tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    with instance(export(load_preset("paper"), "law"), tmp_path / "one") as unit:
        with pytest.raises(fmpy.fmi1.FMICallException):
            put(unit, ["boundary_layer"], [-1.0])
        put(unit, ["boundary_layer"], [0.2])
    assert "out of its range: see min and max" in capfd.readouterr().out
    with instance(export(load_preset("composite"), "law"), tmp_path / "two") as unit:
        with pytest.raises(fmpy.fmi1.FMICallException):
            put(unit, ["noise_seed"], [0.5])
    assert "A seed is a whole number." in capfd.readouterr().out


def test_an_instance_continues_from_a_saved_state_bit_for_bit(export: Export, tmp_path: Path):
    file = export(load_preset("composite"))
    with instance(file, tmp_path / "one") as one, instance(file, tmp_path / "two") as two:
        one.doStep(0.0, 0.05)
        state = one.getFMUState()
        kept = one.serializeFMUState(state)
        there = outputs(one)
        one.doStep(0.05, 0.05)
        after = outputs(one)
        one.setFMUState(state)
        np.testing.assert_array_equal(outputs(one), there)
        one.doStep(0.05, 0.05)
        np.testing.assert_array_equal(outputs(one), after)
        one.freeFMUState(state)
        other = two.deserializeFMUState(kept)
        two.setFMUState(other)
        two.doStep(0.05, 0.05)
        np.testing.assert_array_equal(outputs(two), after)
        two.freeFMUState(other)
        two.reset()
        two.enterInitializationMode()
        two.exitInitializationMode()
        two.doStep(0.0, 0.05)
        np.testing.assert_array_equal(outputs(two), there)


@pytest.mark.parametrize(("preset", "version"), [("paper", 2), ("paper", 3), ("fast-adaptation", 3)])
def test_the_state_of_a_follower_contains_the_desired_motion(export: Export, tmp_path: Path, preset: str, version: int):
    """After a return to a state, or in another instance, the desired motion need not be given again."""
    scenario = load_preset(preset)
    file, path = export(scenario, "follower", version), build_trajectory(scenario)
    with instance(file, tmp_path / "one") as one, instance(file, tmp_path / "two") as two:
        put(one, GIVEN, desired_at(path, 0.3).ravel())
        one.doStep(0.0, 0.05)
        state, there = one.getFMUState(), outputs(one)
        kept = one.serializeFMUState(state)
        one.doStep(0.05, 0.05)
        after = outputs(one)
        put(one, GIVEN, desired_at(path, 0.9).ravel())
        one.doStep(0.1, 0.05)
        one.setFMUState(state)
        np.testing.assert_array_equal(get(one, GIVEN), desired_at(path, 0.3).ravel())
        np.testing.assert_array_equal(outputs(one), there)
        one.doStep(0.05, 0.05)
        np.testing.assert_array_equal(outputs(one), after)
        one.freeFMUState(state)
        other = two.deserializeFMUState(kept)
        two.setFMUState(other)
        two.freeFMUState(other)
        two.doStep(0.05, 0.05)
        np.testing.assert_array_equal(outputs(two), after)
        assert not np.array_equal(there, after)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_a_thousand_instances_and_their_states_leave_no_memory_behind(export: Export, tmp_path: Path):
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    with instance(export(load_preset("paper")), tmp_path) as unit:
        first, before = unit.component, 0
        for number in range(1100):
            unit.instantiate()
            unit.enterInitializationMode()
            unit.exitInitializationMode()
            unit.doStep(0.0, 0.01)
            for _ in range(10):
                state = unit.getFMUState()
                copy = unit.deserializeFMUState(unit.serializeFMUState(state))
                unit.setFMUState(copy)
                unit.freeFMUState(copy)
                unit.freeFMUState(state)
            unit.terminate()
            unit.fmi3FreeInstance(unit.component)
            if number == 99:
                before = resident()
        # An instance takes 2 kB, a state more than 1 kB.
        assert resident() - before < 1_000_000
        unit.component = first


@pytest.mark.parametrize(
    ("time", "step", "says"),
    [
        (0.0, 0.0015, "The communication step 0.0015 s is not a whole number of this unit's ticks of 0.001 s"),
        (0.0, 0.0, "The communication step 0 s is not a whole number"),
        (0.0, math.inf, "The communication step inf s is not a whole number"),
        (0.0, 1e20, "The communication step 1e+20 s is not a whole number"),
        (math.nan, 0.001, "The communication point t = nan s is not this unit's present time, t = 0 s."),
        (0.5, 0.001, "The communication point t = 0.5 s is not this unit's present time, t = 0 s."),
    ],
)
@pytest.mark.parametrize("version", [2, 3])
def test_an_impossible_step_is_refused_with_a_sentence(
    export: Export, tmp_path: Path, capfd: pytest.CaptureFixture[str], version: int, time: float, step: float, says: str
):
    with instance(export(load_preset("paper"), "loop", version), tmp_path) as unit:
        with pytest.raises(fmpy.fmi1.FMICallException):
            unit.doStep(time, step)
        unit.doStep(0.0, TICK)
    assert says in capfd.readouterr().out


@pytest.mark.parametrize("version", [2, 3])
def test_a_step_as_small_as_a_rounding_error_does_nothing(export: Export, tmp_path: Path, version: int):
    """OMSimulator adds up its steps, and at the end asks for the rounding error that is left."""
    with instance(export(load_preset("paper"), "plant", version), tmp_path) as unit:
        unit.doStep(0.0, 3 * TICK)
        before = outputs(unit)
        unit.doStep(3 * TICK - 2.2e-13, 2.2e-13)
        np.testing.assert_array_equal(outputs(unit), before)
        unit.doStep(3 * TICK, TICK)


@pytest.mark.parametrize("version", [2, 3])
def test_units_that_feed_each_other_form_no_algebraic_loop(export: Export, version: int):
    for part in ("plant", "law"):
        about = fmpy.read_model_description(str(export(load_preset("paper"), part, version)))
        assert about.outputs
        assert all(output.dependencies == [] for output in about.outputs)


def test_a_plant_without_torques_stops_with_a_sentence(
    export: Export, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    with instance(export(load_preset("gravity"), "plant"), tmp_path) as unit:
        unit.setFloat64([number for name, number in unit.numbers.items() if name.startswith("motor")], [0.0] * 6)
        with pytest.raises(fmpy.fmi1.FMICallException):
            unit.doStep(0.0, 10.0)
        assert np.isfinite(outputs(unit)).all()
    said = capfd.readouterr().out
    assert "The run stopped just after t = " in said
    assert "The last good state is kept." in said


def test_the_binary_needs_only_the_c_library(export: Export, tmp_path: Path):
    folder = Path(fmpy.extract(str(export(load_preset("composite"))), str(tmp_path)))
    (binary,) = folder.glob("binaries/*/*")
    code = (
        "import ctypes, sys\n"
        f"unit = ctypes.CDLL({str(binary)!r})\n"
        "unit.fmi3GetVersion.restype = ctypes.c_char_p\n"
        "assert unit.fmi3GetVersion() == b'3.0'\n"
        "assert not {'numba', 'llvmlite', 'flexlab', 'numpy'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-I", "-S", "-c", code], check=True)
    if sys.platform == "linux":
        listed = subprocess.run(["objdump", "-p", binary], capture_output=True, text=True, check=True).stdout
        needed = {line.split()[1].split(".")[0] for line in listed.splitlines() if "NEEDED" in line}
        assert needed <= {"libc", "libm"}
        undefined = subprocess.run(["nm", "-Du", binary], capture_output=True, text=True, check=True).stdout
        assert "Py" not in undefined
        assert "numba" not in undefined


def test_the_same_scenario_gives_the_same_bytes(tmp_path: Path):
    files = [flexlab.export_fmu("paper", tmp_path / f"{k}.fmu", "loop") for k in range(2)]
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"part": "arms"}, "part = 'arms' is not a part of a scenario: choose plant, law, loop, follower."),
        ({"version": 1}, "fmi = 1 is not a version that can be written: choose 2 or 3."),
    ],
)
def test_an_unknown_part_or_version_is_refused(tmp_path: Path, given: dict[str, Any], says: str):
    with pytest.raises(StudyError, match=says):
        flexlab.export_fmu("paper", tmp_path / "none.fmu", **given)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_compiler_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(StudyError, match="linked by a C compiler, and no-such-compiler was not found: install one"):
        flexlab.export_fmu("paper", tmp_path / "none.fmu")
    assert list(tmp_path.iterdir()) == []


def test_a_law_in_python_is_refused(tmp_path: Path):
    try:
        scenario = load_preset("paper").replace({"controller.kind": add_own_law(PD, "own_pd.py").kind})
        for part in ("loop", "law"):
            with pytest.raises(StudyError, match="runs in Python, which a unit cannot hold: export --part plant"):
                write_fmu(scenario, tmp_path / "none.fmu", part=part)
    finally:
        forget_own_laws()


def test_a_start_pose_out_of_reach_is_refused(tmp_path: Path):
    scenario = load_preset("paper").replace({"initial.pose": (5.0, 5.0, 0.0)})
    with pytest.raises(StudyError, match="cannot reach the start pose"):
        flexlab.export_fmu(scenario, tmp_path / "none.fmu")
