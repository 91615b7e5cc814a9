"""Every signal of `Samples` as named columns with units, for tables, and back."""

from dataclasses import dataclass

import numpy as np

from flexlab.scenario import Scenario
from flexlab.sim.geometry import held_columns
from flexlab.sim.samples import Samples

POSE, RATE, ACCELERATION = ("m", "m", "rad"), ("m/s", "m/s", "rad/s"), ("m/s²", "m/s²", "rad/s²")
FORCE = ("N", "N", "N·m")
AXES = ("x", "y", "theta")
SIDES = ("left", "right")

_BY_AXIS = {
    "pose": POSE,
    "pose_rate": RATE,
    "pose_acceleration": ACCELERATION,
    "desired_pose": POSE,
    "tracking_error": POSE,
    "sliding_variable": RATE,
    "moving_force": FORCE,
}
_BY_ARM_AND_AXIS = {"arm_input": FORCE, "internal_force": FORCE}
_BY_ARM_AND_JOINT = {"joint_angle": "rad", "joint_torque": "N·m"}
_BY_NODE = {"beam_coordinates": ("m", "rad"), "beam_rates": ("m/s", "rad/s")}
_SINGLE = {
    "time": "s",
    "midspan_deflection": "m",
    "quasi_static_deflection": "m",
    "kinetic_energy": "J",
    "elastic_energy": "J",
    "gravity_energy": "J",
    "input_work": "J",
    "dissipated_energy": "J",
    "saturated": "1",
}


@dataclass(frozen=True)
class Column:
    """One number per sample."""

    name: str
    """Signal, part and unit: "joint_torque_left_2 [N·m]"."""
    signal: str
    """Field of `Samples`."""
    index: tuple[int, ...]
    """Which entry of one row of that field; () if it is a number."""


def table_columns(scenario: Scenario) -> tuple[Column, ...]:
    """All columns of a run of `scenario`, in the order of the fields of `Samples`."""
    return tuple(
        Column(f"{'_'.join([signal, *part])} [{unit}]", signal, index)
        for signal in Samples.__dataclass_fields__
        for part, unit, index in _parts(signal, scenario)
    )


def _parts(signal: str, scenario: Scenario) -> list[tuple[list[str], str, tuple[int, ...]]]:
    """(words, unit, index) of each entry of a signal."""
    sides = list(enumerate(SIDES[: len(scenario.arms)]))
    if signal in _SINGLE:
        return [([], _SINGLE[signal], ())]
    if signal in _BY_AXIS:
        return [([axis], unit, (i,)) for i, (axis, unit) in enumerate(zip(AXES, _BY_AXIS[signal], strict=True))]
    if signal == "bound_estimates":
        return [([str(i)], unit, (i,)) for i, unit in enumerate(("N", "N/m", "N·s²/m²"))]
    if signal in _BY_ARM_AND_AXIS:
        units = _BY_ARM_AND_AXIS[signal]
        return [([side, axis], units[i], (arm, i)) for arm, side in sides for i, axis in enumerate(AXES)]
    if signal in _BY_ARM_AND_JOINT:
        unit = _BY_ARM_AND_JOINT[signal]
        return [([side, str(joint + 1)], unit, (arm, joint)) for arm, side in sides for joint in range(3)]
    units = _BY_NODE[signal]
    nodal = range(2 * (scenario.payload.element_count + 1))
    free = [coordinate for coordinate in nodal if coordinate not in held_columns(scenario.payload)]
    kinds = ("deflection", "slope")
    return [([f"node{c // 2}", kinds[c % 2]], units[c % 2], (i,)) for i, c in enumerate(free)]


def to_columns(samples: Samples, scenario: Scenario) -> dict[str, np.ndarray]:
    """Name → values (N,) of every column."""
    return {
        column.name: np.ascontiguousarray(getattr(samples, column.signal)[(slice(None), *column.index)])
        for column in table_columns(scenario)
    }


def from_columns(values: dict[str, np.ndarray], scenario: Scenario) -> Samples:
    """The samples that `to_columns` was given, read-only. Raises KeyError for a column that is missing."""
    columns = table_columns(scenario)
    count = len(values[columns[0].name])
    signals: dict[str, np.ndarray] = {}
    for column in columns:
        shape = [
            1 + max(c.index[axis] for c in columns if c.signal == column.signal) for axis in range(len(column.index))
        ]
        signal = signals.setdefault(column.signal, np.empty((count, *shape)))
        signal[(slice(None), *column.index)] = values[column.name]
    for signal in signals.values():
        signal.flags.writeable = False
    return Samples(**signals)
