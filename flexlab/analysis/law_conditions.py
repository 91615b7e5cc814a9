"""The conditions of a scenario's control law, its own and those common to all laws, and whether they are met."""

import numpy as np

from flexlab.control.conditions import Circumstances, Condition, sampled_in_time, slower_than_the_beam
from flexlab.control.law import law_of
from flexlab.control.motion import poses
from flexlab.physics.dynamics import arms_at
from flexlab.physics.law_input import LAW_INPUT
from flexlab.physics.mass_change import find_mass_at
from flexlab.scenario import Scenario
from flexlab.sim.assembly import build_system
from flexlab.sim.build import build_beam
from flexlab.sim.closed_loop import law_input_at, new_workspace
from flexlab.sim.step_rates import control_rate, desired_poses

INSTANTS = 32
"""Number of instants of the slowest period at which the desired motion is evaluated."""


def law_conditions(scenario: Scenario) -> tuple[Condition, ...]:
    """The conditions of a scenario's law; none if motors are off or no desired pose can be reached."""
    return conditions_in(circumstances(scenario))


def conditions_in(around: Circumstances) -> tuple[Condition, ...]:
    """The `law_conditions` in known circumstances."""
    law = law_of(around.scenario.controller)
    if not law.drives or not len(around.path):
        return ()
    stated = around.fastest_rate > 0  # Laws in Python state no rate.
    of_rates = (slower_than_the_beam(around), *sampled_in_time(around)) if stated else ()
    return *law.conditions(around), *of_rates


def circumstances(scenario: Scenario) -> Circumstances:
    """The circumstances by which the conditions of a scenario's law are judged."""
    beam = build_beam(scenario.payload)
    system = build_system(scenario, beam)
    motion = scenario.trajectory
    times = motion.window[0] + np.arange(INSTANTS) * (motion.slowest_period / INSTANTS)
    ws, seen, reached = new_workspace(system), [], []
    find_mass_at(system.plant, 0.0, ws)
    for t, desired in zip(times, poses(system.trajectory, times), strict=True):
        if arms_at(system.plant, desired[0], ws) == 0:
            seen.append(law_input_at(system, desired[0], desired[1], desired, ws).copy())
            reached.append(t)
    path = np.array(seen, LAW_INPUT).view(np.recarray)
    m, inertia = beam.matrices.m, beam.matrices.I
    modes, asked = beam.modes, desired_poses(system, motion)
    rigid = system._replace(plant=system.plant._replace(kappa=np.zeros(3)))
    around = Circumstances(
        scenario=scenario, instants=np.array(reached), path=path, reaction=np.zeros((len(path), 3)), omega=modes.omega,
        damping=np.diag(modes.D), loads=np.stack([modes.V.T @ beam.matrices.h, modes.V.T @ beam.matrices.g]),
        fastest_rate=control_rate(system, asked), slow_rate=control_rate(rigid, asked),
    )  # fmt: skip
    for k, (now, B) in enumerate(zip(path, around.inertias(), strict=True)):
        unknown = B - now.M[: now.arm_count].sum(axis=0) - np.diag([m, m, inertia])
        around.reaction[k] = unknown @ now.desired[2] + [0.0, (now.m - m) * now.gravity, 0.0]
    return around
