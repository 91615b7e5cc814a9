"""An importer that calls a unit's functions in the wrong order or with invalid arguments gets an error and a sentence."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave
from units_in_fmpy import enter, fresh, get, instance, put

from flexlab.presets import load_preset

Export = Callable[..., Path]
REFUSED = 3
OUTPUTS = ["pose_x", "pose_y", "joint_torque_left_1", "internal_force_left_x", "kinetic_energy"]


def assert_refused(call: Callable[..., Any], *given: Any) -> None:
    with pytest.raises(fmpy.fmi1.FMICallException):
        call(*given)


@pytest.mark.parametrize("version", [2, 3])
def test_calls_in_the_wrong_order_are_refused(
    export: Export, tmp_path: Path, capfd: pytest.CaptureFixture[str], version: int
):
    unit = fresh(export(load_preset("composite"), "loop", version), tmp_path)
    for call in (lambda: unit.doStep(0.0, 0.01), unit.exitInitializationMode, unit.terminate):
        assert_refused(call)
    enter(unit)
    for call in (lambda: unit.doStep(0.0, 0.01), lambda: enter(unit), unit.terminate):
        assert_refused(call)
    unit.exitInitializationMode()
    unit.doStep(0.0, 0.05)
    there = get(unit, OUTPUTS)
    for call in (lambda: enter(unit), unit.exitInitializationMode):
        assert_refused(call)
    np.testing.assert_array_equal(get(unit, OUTPUTS), there)
    unit.terminate()
    np.testing.assert_array_equal(get(unit, OUTPUTS), there)
    for call in (lambda: unit.doStep(0.05, 0.01), lambda: enter(unit), unit.terminate):
        assert_refused(call)
    unit.reset()
    enter(unit)
    unit.exitInitializationMode()
    unit.doStep(0.0, 0.05)
    np.testing.assert_array_equal(get(unit, OUTPUTS), there)
    unit.freeInstance()
    said = capfd.readouterr().out
    for sentence in (
        "This unit is not initialized: enter and exit initialization mode before the first step.",
        "This unit is not being initialized: enter initialization mode first.",
        "This unit has begun: reset it before it is ",
        "This unit was terminated: reset it.",
        "This unit does not run: there is nothing to terminate.",
    ):
        assert sentence in said


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("preset", ["paper", "fast-adaptation"])
def test_outputs_are_right_before_the_run_begins(export: Export, tmp_path: Path, preset: str, version: int):
    """Connected units read one another's outputs during initialization, so these must follow from what was set by then."""
    file = export(load_preset(preset), "loop", version)
    unit = fresh(file, tmp_path / "one")
    usual = get(unit, OUTPUTS)
    put(unit, ["feedback_gain_1"], [100.0])
    before = get(unit, OUTPUTS)
    enter(unit)
    during = get(unit, OUTPUTS)
    unit.exitInitializationMode()
    other = fresh(file, tmp_path / "other")
    put(other, ["feedback_gain_1"], [100.0])
    enter(other)
    other.exitInitializationMode()
    there = get(other, OUTPUTS)
    assert there[1] == 0.75
    assert usual[2] != there[2]
    for found in (before, during, get(unit, OUTPUTS)):
        np.testing.assert_array_equal(found, there)
    for each in (unit, other):
        each.doStep(0.0, 0.05)
    np.testing.assert_array_equal(get(unit, OUTPUTS), get(other, OUTPUTS))
    unit.freeInstance()
    other.freeInstance()


@pytest.mark.parametrize("version", [2, 3])
def test_foreign_or_damaged_bytes_of_a_state_are_refused(
    export: Export, tmp_path: Path, capfd: pytest.CaptureFixture[str], version: int
):
    scenario = load_preset("paper")
    stiffer = scenario.replace({"payload.bending_stiffness": 200.0})
    with (
        instance(export(scenario, "law", version), tmp_path / "one") as unit,
        instance(export(stiffer, "law", version), tmp_path / "other") as other,
    ):
        capital = "State" if isinstance(unit, FMU3Slave) else "state"
        keep, read = (
            getattr(unit, f"getFMU{capital}"),
            (unit.deserializeFMUState if isinstance(unit, FMU3Slave) else unit.deSerializeFMUstate),
        )
        kept = getattr(unit, f"serializeFMU{capital}")(keep())
        other_state = getattr(other, f"getFMU{capital}")()
        foreign = getattr(other, f"serializeFMU{capital}")(other_state)
        assert len(foreign) == len(kept)
        assert_refused(read, foreign)
        for place in (len(kept) - 1, len(kept) // 2, 80):
            damaged = bytearray(kept)
            damaged[place] ^= 1
            assert_refused(read, bytes(damaged))
        read(kept)
    said = capfd.readouterr().out
    assert "These bytes are no state of this unit." in said
    assert "The bytes of this state are damaged." in said


def test_a_null_instance_is_refused(export: Export, tmp_path: Path):
    """A null pointer once crashed the importer."""
    units = [fresh(export(load_preset("paper"), "loop", version), tmp_path / str(version)) for version in (2, 3)]
    second, third = (unit.dll for unit in units)
    assert second.fmi2DoStep(None, 0.0, 0.001, 0) == REFUSED
    assert second.fmi2GetReal(None, None, 0, None) == REFUSED
    assert second.fmi2Reset(None) == third.fmi3Reset(None) == third.fmi3Terminate(None) == REFUSED
    assert second.fmi2ExitInitializationMode(None) == third.fmi3ExitInitializationMode(None) == REFUSED
    for unit in units:
        unit.freeInstance()
