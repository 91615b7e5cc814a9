"""Moving a `Motion` from tick to tick with the step that each tick wants, and checks of its accuracy.

Whatever the integrator, a step across a jump of the desired velocity, acceleration or jerk is of first order: these
discontinuities have to lie on steps. Those on whole ticks do; a tick with one elsewhere is split there, and each part gets
steps of its own. A sampled controller sees its target at its instants only, so that its ticks are not split.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexlab.compiled import entry_point
from flexlab.control.law import laws
from flexlab.own.law import OwnController
from flexlab.physics.dynamics import velocities_at
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import DISSIPATED, ETA
from flexlab.sim import accuracy, loss_error
from flexlab.sim.advance import INTERRUPTED, OTHER_STEP, SAME_INSTANT, advance
from flexlab.sim.assembly import Assembly
from flexlab.sim.closed_loop import scratch_workspace
from flexlab.sim.integrators.beam_flow import TICKS
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.motion import Motion, restore, state_of
from flexlab.sim.run_warnings import peaks_of, with_model_shares
from flexlab.sim.samples import WorldState
from flexlab.sim.signals import POSE, TIME
from flexlab.sim.step_levels import StepWatch
from flexlab.sim.step_size import build_scheme
from flexlab.sim.termination import DEFLECTION_LIMIT, runtime_fault

ANSWER_TICKS = 64
"""Ticks in which a law's answer to errors of the vibration is seen."""


class SplitTick(NamedTuple):
    """A tick that is split at discontinuities of the desired motion."""

    number: int
    cuts: tuple[float, ...]
    """Where its parts begin and end, the tick's own ends included, s."""


def next_split_tick(assembly: Assembly, level: int, tick: int) -> SplitTick | None:
    """The first tick from number `tick` on with a discontinuity that lies on no step of this level; None if there is none."""
    instants, tick_period = assembly.system.trajectory.discontinuities, assembly.tick_period
    if assembly.system.control.sampled or not len(instants) or instants[-1] <= tick * tick_period:
        return None
    dt = tick_period / (assembly.step_count << level)
    ahead = instants[instants > tick * tick_period + SAME_INSTANT]
    off = ahead[np.abs(ahead - np.round(ahead / dt) * dt) > SAME_INSTANT]
    if not len(off):
        return None
    number = int(np.floor(off[0] / tick_period))
    begin, end = number * tick_period, (number + 1) * tick_period
    cuts = [begin]
    for instant in ahead:
        if cuts[-1] + SAME_INSTANT < instant < end - SAME_INSTANT:
            cuts.append(float(instant))
    return SplitTick(number, (*cuts, end))


def steps_in(length: float, dt: float) -> int:
    """Number of equal steps, none longer than `dt`, into which a part of this length is divided, s."""
    return max(1, int(np.ceil(length / dt - 1e-9)))


def observe(motion: Motion, row: np.ndarray) -> None:
    """Write the sample of the present instant to `row`, which holds zeros; after a failed start, the pose alone."""
    move_on(motion, row[None], first_is_present=True)
    row[TIME] = motion.time
    row[POSE : POSE + 3] = motion.y[:3]
    if motion.estimate.peaks.torque is None:  # Nothing has moved: later samples say the rest.
        peaks = with_model_shares(motion.estimate.peaks, motion.scenario, row[None])
        motion.estimate = motion.estimate._replace(peaks=peaks)


def fill(motion: Motion, rows: np.ndarray) -> int:
    """Move by one tick per row of rows (ticks, row length), writing the samples there; returns the ticks done.

    Fewer than rows: the motion has stopped, and its status says why, or it was interrupted.
    """
    if motion.status.failed:
        return 0
    if motion.estimate.peaks.torque is None:
        observe(motion, np.zeros(motion.row_length))
    before, estimate, done, code = state_of(motion), motion.estimate, 0, 0
    while done < len(rows) and code == 0:
        until_check = accuracy.ticks_until_check(motion.estimate, motion.tick)
        part, checked = rows[done : done + max(until_check, 1)], until_check == 0
        start = state_of(motion)
        ticks, code = move_on(motion, part)
        if code == INTERRUPTED:
            _go_back(motion, before, estimate)
            return 0
        if ticks == 0:
            continue
        peaks, change, jump = peaks_of(
            motion.estimate.peaks, motion.scenario, part[:ticks], motion.estimate.torque_change
        )
        if jump >= 0 and not checked:  # The tick with the jump has to be checked, and so have those after it.
            _go_back(motion, start, motion.estimate._replace(disturbed=motion.tick + jump))
            code = 0
            continue
        motion.tick, done = motion.tick + ticks, done + ticks
        motion.estimate = motion.estimate._replace(peaks=peaks)
        if checked:
            largest = max(motion.estimate.torque_change, change)
            motion.estimate = motion.estimate._replace(torque_change=largest, newest_change=change)
            _check(motion, part[ticks - 1], start)
    if code != 0 or (done > 0 and _law_failed(motion, rows[done - 1])):
        find_mass_at(motion.assembly.system.plant, motion.time, motion.workspace)
        velocities_at(motion.assembly.system.plant, motion.y, motion.workspace)
        motion.status = runtime_fault(motion.assembly, code, motion.y, motion.workspace.velocity, motion.time)
    return done


def _law_failed(motion: Motion, row: np.ndarray) -> bool:
    """Whether the law failed in its call for the newest sample `row`: a step that notices it may not follow."""
    law = motion.scenario.controller
    return not np.isfinite(row).all() and bool(laws()[law.kind].problem(law))


def _go_back(motion: Motion, state: WorldState, estimate: accuracy.Estimate) -> None:
    """Return to an earlier state of this run, with what was known of its accuracy then."""
    restore(motion, state)
    motion.estimate = estimate


def _check(motion: Motion, row: np.ndarray, start: WorldState) -> None:
    """Compare the tick from `start` on, whose sample is `row`, with the same tick in finer steps."""
    finer = accuracy.finer_level(motion.estimate, motion.assembly, motion.tick - 1, motion.level)
    begun, again = float(start.y[DISSIPATED]), repeat_tick(motion, start, finer)
    if again is None:
        return
    since = motion.tick - 1 - motion.estimate.disturbed
    energies = (begun, float(motion.y[DISSIPATED]), float(again[1][DISSIPATED]))
    loss = loss_error.noted(motion.estimate.loss, motion.scenario, motion.time, since, energies)
    motion.estimate = motion.estimate._replace(loss=loss)
    before, checked = motion.estimate, (motion.assembly, motion.tick - 1, row, motion.y, *again)
    motion.estimate = accuracy.note(before, *checked)
    if accuracy.unanswered(motion.estimate):
        answer = max(before.answer, _find_answer(motion, motion.y - again[1]))
        answered = accuracy.ring_force(motion.estimate.newest)
        motion.estimate = accuracy.note(before._replace(answer=answer, answered=answered), *checked)


def repeat_tick(motion: Motion, start: WorldState, level: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Sample and state at the end of the tick from `start` on, simulated with the steps of `level`; None if it fails.

    `motion` is not changed; the arrays of `start` are overwritten.
    """
    again, row = _copy_from(motion, start, level), np.zeros((1, motion.row_length))
    again.assembly = again.assembly._replace(watch=again.assembly.watch._replace(most=0))
    _, code = move_on(again, row, np.inf)
    return (row[0], again.y) if code == 0 else None


def _copy_from(motion: Motion, start: WorldState, level: int) -> Motion:
    """A copy of a motion at the state `start`, whose arrays it overwrites, with steps of `level`."""
    system = motion.assembly.system._replace(held_torque=start.held_torque)
    sampling = motion.assembly.sampling._replace(line=start.torque_line)
    assembly = motion.assembly._replace(system=system, sampling=sampling)
    workspace = scratch_workspace(system)._replace(interrupt=motion.workspace.interrupt)
    return replace(motion, assembly=assembly, y=start.y, workspace=workspace, tick=start.tick, level=level)


def _find_answer(motion: Motion, difference: np.ndarray) -> float:
    """`Estimate.answer` for the difference of two states that a tick's errors make: how far it moves the pose from now on.

    It is given the size of all errors so far. 0 where the next ticks would not tell: an encoder's count is a matter of its own,
    and a person's code runs at the run's instants alone.
    """
    scenario, size = motion.scenario, accuracy.ring_force(motion.estimate.accumulated)
    if size == 0 or scenario.joints.encoders.active or isinstance(scenario.controller, OwnController):
        return 0.0
    share, end = (
        size / accuracy.ring_force(motion.estimate.newest),
        ETA + 2 * motion.assembly.system.plant.modal.shape[1],
    )
    poses = []
    for added in (0.0, share):
        start, rows = state_of(motion), np.zeros((ANSWER_TICKS, motion.row_length))
        start.y[:end] += added * difference[:end]
        done, _ = move_on(_copy_from(motion, start, motion.level), rows, np.inf)
        poses.append(rows[:done, POSE : POSE + 3])
    both = min(map(len, poses))
    return float(np.abs(poses[0][:both] - poses[1][:both]).max(initial=0.0)) / size


def move_on(
    motion: Motion, rows: np.ndarray, limit: float | None = None, first_is_present: bool = False
) -> tuple[int, int]:
    """Move by one tick per row with the step that each wants; returns the ticks done and the code of `advance`.

    `limit`: deflection at which the motion stops, m; None for `DEFLECTION_LIMIT`. Nothing is checked, and motion.tick stays.
    """
    assembly, done = motion.assembly, 0
    if limit is None:
        limit = DEFLECTION_LIMIT * motion.scenario.payload.length
    while True:
        here = motion.tick + done
        split = None if first_is_present else next_split_tick(assembly, motion.level, here)
        if split is not None and split.number == here and done < len(rows):
            code = _move_in_parts(motion, split.cuts, rows[done : done + 1], limit)
            ticks = int(code == 0)
        else:
            end = len(rows) if split is None else min(len(rows), done + split.number - here)
            ticks, code = _run(
                motion, assembly.levels.scheme(motion.level), assembly.watch, limit, 0.0, here, assembly.tick_period,
                assembly.step_count << motion.level, rows[done:end], first_is_present,
            )  # fmt: skip
        done += ticks
        if code >= OTHER_STEP:
            motion.level = code - OTHER_STEP
        elif code != 0 or done >= len(rows) or first_is_present:
            return done, code


def _move_in_parts(motion: Motion, cuts: tuple[float, ...], row: np.ndarray, limit: float) -> int:
    """Move by a split tick; fills `row` (1, row length) and returns the code of `advance`: with any but 0, y stays."""
    assembly, start = motion.assembly, motion.y.copy()
    since, watch = ETA + 2 * assembly.system.plant.modal.shape[1] + TICKS, assembly.watch
    dt = assembly.tick_period / (assembly.step_count << motion.level)
    for begin, end in zip(cuts[:-1], cuts[1:], strict=True):
        if assembly.levels.integrator == "etdrk4":  # Another one may keep an acceleration there.
            motion.y[since] = start[since]
        length = end - begin
        count = steps_in(length, dt)
        scheme = build_scheme(assembly.levels.integrator, assembly.beam, length / count)
        _, code = _run(motion, scheme, watch, limit, begin, 0, length, count, row, False)
        if code != 0:
            motion.y[:] = start
            return code
        # The whole tick keeps the step that its beginning wanted.
        watch = watch._replace(most=0)
    row[0, TIME] = cuts[-1]
    return 0


def _run(
    motion: Motion, scheme: Scheme, watch: StepWatch, limit: float, origin: float, tick: int, period: float, steps: int,
    rows: np.ndarray, first_is_present: bool,
) -> tuple[int, int]:  # fmt: skip
    """Call `advance` for a motion; for a watch that chooses no level, the level given to it is 0."""
    sampling = motion.assembly.sampling
    arguments = (
        motion.assembly.system,
        sampling._replace(steps=sampling.steps << motion.level),
        *scheme,
        watch,
        motion.level if watch.most > 0 else 0,
        limit,
        origin,
        tick,
        period,
        steps,
        motion.y,
        np.empty_like(motion.y),
        motion.workspace,
        rows,
        first_is_present,
    )
    if motion.move is None:
        motion.move = entry_point(advance, *arguments)
    return motion.move(*arguments)
