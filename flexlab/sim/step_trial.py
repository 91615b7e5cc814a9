"""The automatic step: halved until a run's beginning, and what follows discontinuities of its path, are accurate.

A start with a wrong velocity, a discontinuity and each instant of a sampled law excite modes that are faster than the step. How
well a step follows them depends on beam, arms and law together, so it is tried: the first ticks are run with the step and with
half of it. The difference is the error, and modes that ring on accumulate it until they decay. The trial depends on the scenario
alone, so that a run that goes on from a later state takes the same steps.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlab.numerics.elementary import exponentials
from flexlab.numerics.linear_algebra import solve
from flexlab.own.law import OwnController
from flexlab.physics.dynamics import set_momenta
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import ETA, P
from flexlab.scenario import Scenario
from flexlab.sim import accuracy
from flexlab.sim.assembly import Assembly, Unprepared, derive_assembly, with_transition_of
from flexlab.sim.closed_loop import scratch_workspace
from flexlab.sim.integrators.beam_flow import TICKS
from flexlab.sim.motion import Motion, begin_motion
from flexlab.sim.run_warnings import SLOWEST_PACE, bounds, paper_step_time
from flexlab.sim.signals import POSE, TIME
from flexlab.sim.step_levels import DISTURBED_TICKS
from flexlab.sim.step_rates import ring_decay
from flexlab.sim.step_size import SHORTEST_CHOSEN, Count
from flexlab.sim.stepping import move_on

TRIED, TRIED_LONGER = 12, 80
"""Ticks of the short and of the long trial, after the ticks with shorter steps that follow a start. Some errors come from path
and from slow modes and add up from tick to tick, so that only the long trial shows them."""
CLEAR = 0.1
"""Share of the allowed errors below which the short trial needs no long one after it."""
APART = 6
"""Smallest number of ticks between two tried instants."""
HORIZON = 1.0
"""Time after which modes that ring on must still be accurate, s."""
ALLOWED_SHARE = 0.3
"""Share of the bounds of pose and force in `accuracy` that a trial's errors may reach."""
SLOWEST_TRIED = 8.0
"""Processor seconds per simulated second up to which accuracy comes before real time, by the estimate of `paper_step_time`;
where even that is not enough, the step is as short as real time allows."""
RATE_DECAY = 20.0
"""Approximate rate at which a law corrects errors of the pose rate, 1/s; until then they move the pose."""
MOST_ORDER = 4.5
"""Highest order of an error: a halving leaves at least 2 to the minus this of it."""
DISCONTINUITIES_TRIED = 2
"""Discontinuities of the path that are tried besides the start."""


class Trial(NamedTuple):
    """The ticks that were simulated with one step."""

    motion: Motion
    """The motion after the last tick."""
    rows: np.ndarray
    """Samples of the ticks."""
    finer_ticks: int
    """Number of the ticks with shorter steps, which follow a start."""
    ended: bool = False
    """Whether the motion cannot go on after the last tick."""


def build_assembly(
    scenario: Scenario, tick_period: float, known: Sequence[Assembly] = (), at_once: bool = False
) -> Assembly:
    """Derive everything from a scenario and try its automatic step; raises `ScenarioError`.

    Parts of `known` assemblies are shared where they fit. `at_once`: raise `Unprepared` instead of deriving what takes long.
    A transition of the path has no part in the step: a run that begins in one takes the steps of the run before it.
    """
    plain = scenario.anew()
    known = [with_transition_of(each.scenario.anew(), each) for each in known]
    return with_transition_of(scenario, _tried(plain, tick_period, known, at_once))


def _tried(scenario: Scenario, tick_period: float, known: Sequence[Assembly], at_once: bool) -> Assembly:
    assembly = derive_assembly(scenario, tick_period, known, at_once)
    if scenario.simulation.step is not None:
        return assembly
    for old in known:
        if old.scenario == scenario and (old.unrefined or old).steps == assembly.steps:
            return halved(assembly, (old.steps.per_tick // assembly.steps.per_tick).bit_length() - 1)
    return halved(assembly, halvings(assembly, at_once))


def halvings(assembly: Assembly, at_once: bool) -> int:
    """Number of halvings of an assembly's automatic step: as many as needed, and as real time allows.

    `at_once`: raise `Unprepared` instead of trying more than one halving.
    """
    if isinstance(assembly.scenario.controller, OwnController):
        return 0  # A person's own code runs at the run's instants alone: it may count them.
    pace = paper_step_time(assembly) / assembly.steps.step
    most, swift = (_times(assembly, slowest / pace) for slowest in (SLOWEST_TRIED, SLOWEST_PACE))
    needed = 0
    for tick in _instants(assembly) if most > 0 else ():
        needed = _needed(assembly, tick, needed, most, at_once)
    return needed if needed <= most else swift


def _times(assembly: Assembly, ratio: float) -> int:
    """Number of halvings allowed for a step that may become shorter by `ratio`."""
    return max(0, _doublings(min(ratio, assembly.steps.step / SHORTEST_CHOSEN)))


def _doublings(ratio: float) -> int:
    """The whole part of log2(ratio)."""
    return math.frexp(ratio)[1] - 1


def _instants(assembly: Assembly) -> list[int]:
    """Numbers of the ticks from which a trial goes: the start, the first discontinuities, and where the payload is lightest."""
    found = [0]
    for instant in assembly.system.trajectory.discontinuities:
        tick = math.floor(instant / assembly.tick_period - 1e-9)
        if tick > found[-1] + APART:
            found.append(tick)
    mass_change = assembly.scenario.payload.mass_change
    lighter = (
        [math.ceil((mass_change.begin + mass_change.duration) / assembly.tick_period)]
        if mass_change.lightest < 1
        else []
    )
    return found[: 1 + DISCONTINUITIES_TRIED] + lighter


def _needed(assembly: Assembly, tick: int, least: int, most: int, at_once: bool) -> int:
    """As `halvings` for the trial from number `tick` on, at least `least`; more than `most` if that is not enough."""
    found: dict[int, Trial | None] = {}
    level, ticks = least, TRIED
    while level <= most:
        for finer in (level, level + 1):
            trial = found[finer] if finer in found else _begun(assembly, tick, finer)
            found[finer] = trial and _moved(trial, ticks)
        coarse, fine = found[level], found[level + 1]
        if coarse is None or fine is None:
            return level
        excess = _excess(assembly, coarse, fine)
        if excess < CLEAR or (excess <= 1 and ticks == TRIED_LONGER):
            return level
        if excess <= 1:
            ticks = TRIED_LONGER
            continue
        if at_once:
            raise Unprepared(assembly.scenario)
        level += 1 if excess == math.inf else max(1, math.floor(_doublings(excess) / MOST_ORDER))
    return level


def _begun(assembly: Assembly, tick: int, times: int) -> Trial | None:
    """The trial from number `tick` on with a step halved so many times, before its first tick; None if it cannot begin."""
    motion = begin_motion(halved(_without_counts(assembly), times), tick)
    if motion.status.failed:
        return None
    watch, disturbed = assembly.watch, ETA + 2 * len(assembly.beam.modes.omega) + TICKS
    finer_ticks = watch.disturbed * DISTURBED_TICKS
    if tick > 0 and finer_ticks > 0:
        motion.y[disturbed], finer_ticks = finer_ticks, 0  # No shorter steps follow a discontinuity.
    return Trial(motion, np.zeros((0, motion.row_length)), finer_ticks)


def _moved(trial: Trial, ticks: int) -> Trial:
    """The trial continued to so many ticks with long steps, unless it ends before."""
    if trial.ended:
        return trial
    rows = np.zeros((trial.finer_ticks + ticks - len(trial.rows), trial.rows.shape[1]))
    done, code = move_on(trial.motion, rows)
    trial.motion.tick += done
    return trial._replace(rows=np.concatenate([trial.rows, rows[:done]]), ended=done < len(rows) or code != 0)


def _without_counts(assembly: Assembly) -> Assembly:
    """An assembly whose encoders do not round: next to the edge of a count, any difference of two runs is a whole count."""
    plant = assembly.system.plant
    if plant.joints is None:
        return assembly
    exact = plant.joints._replace(count=np.zeros(3))
    return assembly._replace(system=assembly.system._replace(plant=plant._replace(joints=exact)))


def halved(assembly: Assembly, times: int) -> Assembly:
    """An assembly whose step is halved so many times; it keeps the unrefined one."""
    if times == 0:
        return assembly
    steps, levels = assembly.steps, assembly.levels.halved(times)
    return assembly._replace(
        levels=levels,
        watch=levels.watch(False, assembly.scenario.simulation.accuracy),
        steps=Count(steps.per_tick << times, steps.per_control << times, levels.step),
        sampling=assembly.sampling._replace(steps=assembly.sampling.steps << times),
        bound="accuracy",
        unrefined=assembly,
    )


def _rate_error(assembly: Assembly, coarse: Trial, fine: Trial) -> np.ndarray:
    """Difference of the pose's rates at the ends of two trials (3,), without what the beam's vibration adds."""
    system, y, rest = assembly.system, fine.motion.y.copy(), np.zeros(len(assembly.beam.modes.omega))
    workspace, inertia = scratch_workspace(system), np.empty((3, 3))
    find_mass_at(system.plant, fine.rows[-1, TIME], workspace)
    for axis, rate in enumerate(np.eye(3)):
        set_momenta(system.plant, y, rate, rest, workspace)
        inertia[:, axis] = y[P : P + 3]
    return solve(inertia, coarse.motion.y[P : P + 3] - fine.motion.y[P : P + 3])


def _excess(assembly: Assembly, coarse: Trial, fine: Trial) -> float:
    """Difference of two trials over what is allowed, 1; if the finer one ends, only of the ticks that both have."""
    if coarse.ended and not (fine.ended and len(fine.rows) <= len(coarse.rows)):
        return math.inf
    common = min(len(coarse.rows), len(fine.rows))
    if common == 0:
        return 0.0
    rows, finer_rows = coarse.rows[:common], fine.rows[:common]
    forces, finer_forces = (accuracy.forces(each, assembly) for each in (rows, finer_rows))
    peak = float(np.abs(finer_forces).max())
    force = float(np.abs(forces - finer_forces).max())
    poses = np.abs(rows[:, POSE : POSE + 3] - finer_rows[:, POSE : POSE + 3])
    pose, (pose_bound, force_bound) = float(poses.max()), bounds(assembly.scenario, peak)
    if fine.ended:
        return max(force / force_bound, pose / pose_bound) / ALLOWED_SHARE
    pose = max(pose, float((poses[-1] + np.abs(_rate_error(assembly, coarse, fine)) / RATE_DECAY).max()))
    ringing = np.where(
        accuracy.oscillates(assembly), accuracy.mode_forces(assembly, coarse.motion.y - fine.motion.y), 0.0
    )
    # A mode that rings on accumulates the same error in each span as long as the trial.
    decay = np.maximum(ring_decay(assembly.beam), 1e-6 / HORIZON)
    faded, faded_here = (1 - exponentials(-decay * span) for span in (HORIZON, len(coarse.rows) * assembly.tick_period))
    coming = math.sqrt(math.fsum((ringing * faded / faded_here) ** 2))
    return max(max(force, coming) / force_bound, pose / pose_bound) / ALLOWED_SHARE
