"""What a control law remembers: where it begins, and what passes on when the law or its gains change in motion."""

import math
from functools import cache
from typing import Any

import numpy as np

from flexlab.compiled import attributes
from flexlab.control.law import Start, law_of
from flexlab.physics.arm import arm_velocity_terms, task_input
from flexlab.physics.dynamics import arms_at, velocities_at
from flexlab.physics.grips import measured_motion
from flexlab.physics.mass_change import believed_mass, find_mass_at
from flexlab.physics.plant import Workspace
from flexlab.quantities import Part, parts_of
from flexlab.scenario import Scenario
from flexlab.sim.closed_loop import System, memory_slice, own_states_of
from flexlab.sim.target import desired_at

LATE = 1e-9
"""Part of a control period by which an instant may seem to lie after itself."""


def memory_parts(scenario: Scenario, system: System, y: np.ndarray) -> dict[str, np.ndarray]:
    """Views of the named parts of the memory in y."""
    memory = y[memory_slice(system)]
    slices = law_of(scenario.controller).memory_slices(len(scenario.arms))
    return {name: memory[part] for name, part in slices.items()}


def complete_input(system: System, x: np.ndarray, v: np.ndarray, desired: np.ndarray, ws: Workspace) -> Any:
    """The `LAW_INPUT` record of `ws` whose arms are configured at the pose x, with all else that a law is given but q̇.

    After `find_mass_at`.
    """
    plant, payload, now = system.plant, system.control.payload, ws.truth[0]
    c, s = ws.arm.trig
    for i in range(len(plant.arms)):
        arm_velocity_terms(plant.arms[i], c, s, *v, ws.arm.J[i], ws.arm.direction[i], ws.arm.C[i])
    now.x[:], now.v[:], now.desired[:] = x, v, desired
    factor, now.growth = believed_mass(plant.mass_change, payload.change, ws)
    now.gravity, now.m, now.I = plant.gravity, factor * payload.m, factor * payload.I
    now.kappa[:], now.share[:] = factor * payload.kappa, system.control.share
    return now


def same_law(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios have the same law, and its memory and own signals mean the same."""
    if one.controller is other.controller and len(one.arms) == len(other.arms):
        return True
    laws = law_of(one.controller), law_of(other.controller)
    slices = [law.memory_slices(len(scenario.arms)) for law, scenario in zip(laws, (one, other), strict=True)]
    same = slices[0] == slices[1] and laws[0].signals == laws[1].signals
    return same and _kinds(one.controller) == _kinds(other.controller)


def _kinds(part: Part) -> list[str]:
    """The kinds of a controller and of its parts."""
    fields = vars(part)
    own = [fields["kind"]] if "kind" in fields else []
    inner = (fields[name] for name in _fields_of_parts(type(part)))
    return own + [kind for value in inner if isinstance(value, Part) for kind in _kinds(value)]


@cache
def _fields_of_parts(model: type[Part]) -> tuple[str, ...]:
    """Names of the fields that may hold parts of their own."""
    return tuple(name for name, field in model.model_fields.items() if parts_of(field.annotation))


def outlook(
    scenario: Scenario, system: System, time: float, y: np.ndarray, ws: Workspace, acts_now: bool
) -> Start | None:
    """What the law sees at the state y, None if it never asks; `acts_now`: whether a sampled one acts at this instant."""
    law = law_of(scenario.controller)
    if law.start is None and law.carry is None:
        return None
    control, period = system.control, scenario.controller.control_period
    find_mass_at(system.plant, time, ws)
    velocities_at(system.plant, y, ws)
    x, v = y[:3], ws.velocity
    if system.plant.grips is not None:
        x, v = measured_motion(system.plant, y, own_states_of(system, y)["grips"], v.copy())
        arms_at(system.plant, x, ws)
    for i in range(len(system.plant.arms)):
        task_input(ws.arm.J[i], system.held_torque[i], ws.u[i])
    now = complete_input(system, x, v, desired_at(system.trajectory, time), ws)
    gains = attributes(control.gains, law.gains_type)
    wait = 0.0
    if period is not None and not acts_now:
        wait = (math.floor(time / period + LATE) + 1) * period - time
    return Start(now.copy(), gains, wait)


def start_memory(
    scenario: Scenario, system: System, begin: Start | None, y: np.ndarray, kept: tuple[str, ...] = ()
) -> None:
    """Give the memory in y the values with which the law begins, where they are not zero; not the parts that are `kept`."""
    law = law_of(scenario.controller)
    if law.start is None or begin is None:
        return
    parts = memory_parts(scenario, system, y)
    for name, values in law.start(begin).items():
        if name not in kept:
            parts[name][:] = values


def carry_memory(
    old: Scenario, old_system: System, old_y: np.ndarray, new: Scenario, system: System, y: np.ndarray
) -> tuple[str, ...]:
    """Copy the parts of the memory that both laws have by name and length, and name them; the others stay zero."""
    before, kept = memory_parts(old, old_system, old_y), []
    for name, part in memory_parts(new, system, y).items():
        if name in before and len(before[name]) == len(part):
            part[:] = before[name]
            kept.append(name)
    return tuple(kept)


def adjust_memory(scenario: Scenario, system: System, before: Start | None, begin: Start | None, y: np.ndarray) -> None:
    """Let the law follow what has changed from `before` to `begin`, with the memory in y."""
    law = law_of(scenario.controller)
    if law.carry is not None and before is not None and begin is not None:
        parts = memory_parts(scenario, system, y)
        for name, values in law.carry(before, begin, parts).items():
            parts[name][:] = values
