"""Moving a `Motion` from tick to tick, with the step that each wants, and looking at how accurate it is."""

import numpy as np

from flexlab.compiled import entry_point
from flexlab.physics.dynamics import velocities_at
from flexlab.physics.mass_change import find_mass_at
from flexlab.sim import accuracy, samples
from flexlab.sim.advance import INTERRUPTED, OTHER_STEP, advance
from flexlab.sim.kinks import advance_in_pieces, next_tick_of_kinks
from flexlab.sim.motion import Motion, restore, state_of
from flexlab.sim.termination import DEFLECTION_LIMIT, runtime_fault
from flexlab.sim.world_state import WorldState


def observe(motion: Motion, row: np.ndarray) -> None:
    """Write the sample of the present instant; of a failed start the pose alone, the rest zero."""
    _advance(motion, row[None], first_is_present=True)
    row[samples.TIME] = motion.time
    row[samples.POSE : samples.POSE + 3] = motion.y[:3]


def fill(motion: Motion, rows: np.ndarray) -> int:
    """Move by one tick per row of rows (ticks, row length), writing the samples there; returns the ticks done.

    Fewer than rows: the motion has stopped, and its status says why, or it was interrupted.
    """
    if motion.status.failed:
        return 0
    if motion.estimate.seen.torque is None:
        _note_present_load(motion)
    before, estimate, done, code = state_of(motion), motion.estimate, 0, 0
    while done < len(rows) and code == 0:
        part = rows[done : done + accuracy.ticks_to_check(motion.estimate, motion.tick)]
        start, looks = state_of(motion), accuracy.is_due(motion.estimate, motion.tick)
        ticks, code = _advance(motion, part, first_is_present=False)
        if code == INTERRUPTED:
            _go_back(motion, before, estimate)
            return 0
        if ticks == 0:
            continue
        seen, change, jump = accuracy.survey(motion.estimate, motion.assembly, part[:ticks])
        if jump >= 0 and not looks:  # It is to be looked at, and so are the ticks after it.
            _go_back(motion, start, accuracy.jumped(motion.estimate, motion.tick + jump))
            code = 0
            continue
        motion.tick, done = motion.tick + ticks, done + ticks
        motion.estimate = accuracy.note_survey(motion.estimate, seen, change if looks else 0.0)
        if looks:
            _look(motion, part[ticks - 1], start)
    if code != 0:
        find_mass_at(motion.assembly.system.plant, motion.time, motion.workspace)
        velocities_at(motion.assembly.system.plant, motion.y, motion.workspace)
        rate = motion.workspace.velocity
        motion.status = runtime_fault(motion.assembly, code, motion.y, rate, motion.time, motion.tick_period)
    return done


def _note_present_load(motion: Motion) -> None:
    """Note how the beam is pressed and spun where the motion begins: samples to come say the rest."""
    row = np.zeros(motion.row_length)
    observe(motion, row)
    motion.estimate = accuracy.note_load(motion.estimate, row)


def move_on(motion: Motion, rows: np.ndarray) -> tuple[int, int]:
    """Move by one tick per row without a look at how accurate it is; returns the ticks done and the code of `advance`."""
    return _advance(motion, rows, first_is_present=False)


def _go_back(motion: Motion, state: WorldState, estimate: accuracy.Estimate) -> None:
    """Stand again at an earlier state of this run, with what is known of its accuracy."""
    restore(motion, state)
    motion.estimate = estimate


def _look(motion: Motion, row: np.ndarray, start: WorldState) -> None:
    """Compare the tick from `start` on, whose sample is `row`, with the same tick redone with half the step."""
    assembly, tick, period = motion.assembly, motion.tick - 1, motion.tick_period
    finer = accuracy.finer_level(motion.estimate, assembly, tick, motion.level)
    scratch = np.zeros((1, motion.row_length))
    again = accuracy.redo_tick(assembly, motion.move or advance, finer, start, period, scratch)
    if again is not None:
        motion.estimate = accuracy.note(motion.estimate, assembly, tick, row, motion.y, again, period)


def _advance(motion: Motion, rows: np.ndarray, first_is_present: bool) -> tuple[int, int]:
    """As `advance.advance`, from tick to tick with the step that each wants."""
    assembly, period, done = motion.assembly, motion.tick_period, 0
    limit = DEFLECTION_LIMIT * motion.scenario.payload.length
    while True:
        here = motion.tick + done
        kinked = None if first_is_present else next_tick_of_kinks(assembly, motion.level, here, period)
        if kinked is not None and kinked.number == here and done < len(rows):
            dt = period / (assembly.step_count << motion.level)
            code = advance_in_pieces(
                assembly, motion.move or advance, assembly.system, assembly.watch, motion.level, dt, limit,
                kinked.cuts, motion.y, motion.workspace, rows[done : done + 1],
            )  # fmt: skip
            if code == 0:
                done += 1
            elif code >= OTHER_STEP:
                motion.level = code - OTHER_STEP
            else:
                return done, code
            continue
        end = len(rows) if kinked is None else min(len(rows), done + kinked.number - here)
        arguments = (
            assembly.system,
            assembly.sampling._replace(steps=assembly.sampling.steps << motion.level),
            *assembly.levels.scheme(motion.level),
            assembly.watch,
            motion.level,
            limit,
            0.0,
            here,
            period,
            assembly.step_count << motion.level,
            motion.y,
            np.empty_like(motion.y),
            motion.workspace,
            rows[done:end],
            first_is_present,
        )
        if motion.move is None:
            motion.move = entry_point(advance, *arguments)
        ticks, code = motion.move(*arguments)
        done += ticks
        if code >= OTHER_STEP:
            motion.level = code - OTHER_STEP
        elif code != 0 or done >= len(rows) or first_is_present:
            return done, code
