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
from flexlab.sim.step_rates import control_rate

INSTANTS, MOST_PERIODS = 32, 8
"""Instants of the path's fastest period at which arms and law are evaluated, and most periods that are followed so closely."""
FINE, LEAST, MOST = 64, 2000, 20000
"""Instants of the fastest period for the desired motion and the law's rates on it alone, and least and most of all."""
JUMPS, ROUNDING = 1.5, 1e-9
"""Growth of the largest slope with twice the instants from which on a signal jumps, as a jump doubles it; least jump, N."""


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
    late = motion.smooth_start + system.trajectory.impulses[:, 1].max(initial=0.0)
    begin, whole = motion.window[0], motion.slowest_period + late
    count = INSTANTS * int(np.clip(np.ceil(whole / motion.fastest_period), 1, MOST_PERIODS))
    times = begin + np.arange(count) * (whole / count)
    ws, seen, reached = new_workspace(system), [], []
    find_mass_at(system.plant, 0.0, ws)
    for t, desired in zip(times, poses(system.trajectory, times), strict=True):
        if arms_at(system.plant, desired[0], ws) == 0:
            seen.append(law_input_at(system, desired[0], desired[1], desired, ws).copy())
            reached.append(t)
    path = np.array(seen, LAW_INPUT).view(np.recarray)
    m, inertia = beam.matrices.m, beam.matrices.I
    modes = beam.modes
    rigid = system._replace(plant=system.plant._replace(kappa=np.zeros(3)))
    after = max(whole, motion.span - begin + late)
    every = begin + np.linspace(0, after, int(np.clip(FINE * after / motion.fastest_period, LEAST, MOST)))
    desired = poses(system.trajectory, every)
    reaction, asked = _reaction(path, desired, m, inertia), np.ascontiguousarray(desired[:, 0])
    return Circumstances(
        scenario=scenario, instants=np.array(reached), path=path, reaction=_reaction(path, path.desired, m, inertia),
        largest_reaction=float(np.linalg.norm(reaction, axis=1).max(initial=0.0)),
        largest_reaction_rate=_steepest(reaction, every), omega=modes.omega, damping=np.diag(modes.D),
        loads=np.stack([modes.V.T @ beam.matrices.h, modes.V.T @ beam.matrices.g]),
        fastest_rate=control_rate(system, asked), slow_rate=control_rate(rigid, asked),
    )  # fmt: skip


def _reaction(path: np.recarray, desired: np.ndarray, m: float, inertia: float) -> np.ndarray:
    """Ψ (N, 3) on a desired motion (N, 3, 3), for what the law of the records `path` believes; m, inertia: the true payload."""
    if len(path) == 0:
        return np.zeros((0, 3))
    now, angle, asked = path[0], desired[:, 0, 2], desired[:, 2]
    (hh, hg, gg), lateral = now.kappa, np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    a_lat, turn = np.sum(lateral * asked[:, :2], axis=1), asked[:, 2]
    force = (now.m - m) * (asked[:, :2] + [0.0, now.gravity]) - (hh * a_lat + hg * turn)[:, None] * lateral
    return np.column_stack([force, (now.I - inertia - gg) * turn - hg * a_lat])


def _steepest(signal: np.ndarray, times: np.ndarray) -> float:
    """Largest ‖slope‖ of a signal (N, columns) at equally spaced times (N,); infinite if it jumps."""
    if len(signal) == 0:
        return 0.0
    coarse, fine = (np.linalg.norm(np.diff(signal[::skip], axis=0), axis=1).max() for skip in (2, 1))
    if fine > ROUNDING and 2 * fine > JUMPS * coarse:
        return np.inf
    return float(fine / (times[1] - times[0]))
