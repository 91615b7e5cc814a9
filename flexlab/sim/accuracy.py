"""Whether a run's results are still accurate: now and then a tick is redone with a quarter of the step, on copies.

What differs is the error of one tick. Each mode adds up those of its ticks as long as it rings and forgets them as it decays;
the pose does as the law leads it back. Looks are close together after a start, a tap, a change or a jump of the torques beyond
all that were looked at, where errors are largest and fade fastest. The estimate is a function of states at ticks that their
numbers, the commands and the samples choose, so that it is the same live, headless and replayed; it changes no bit of the run.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from flexlab.numerics.elementary import exponentials
from flexlab.numerics.linear_algebra import product
from flexlab.physics.plant import ETA, G, H
from flexlab.scenario import Scenario
from flexlab.sim.assembly import Assembly
from flexlab.sim.closed_loop import scratch_workspace
from flexlab.sim.kinks import advance_in_pieces, next_tick_of_kinks
from flexlab.sim.run_warnings import COUNTED, Survey, amplified, bounds, inaccurate, survey_rows, unled
from flexlab.sim.signals import ARMS, INTERNAL, LOAD_SHARE, MOVING, PER_ARM, POSE, SATURATED, SPIN_SHARE
from flexlab.sim.step_rates import ring_decay
from flexlab.sim.world_state import WorldState

LOOKS = (0, 1, 2, 5, 8, 17, 32, 65)
"""Ticks after a disturbance that are redone, even and odd ones as control instants may be either: fast modes ring for a few
of them only."""

CHECK_TICKS = 1021
"""Then a tick is redone every so many: with 128 the copies that it takes cost a small beam as much as its motion. A prime
number, so that the looks fall on all phases of path and control."""

CLOSE_TICKS, CLOSEST_TICKS = 67, 13
"""The same where errors as large as those just seen would pass their bounds within `CHECK_TICKS`, and within `CLOSE_TICKS`:
most of them fade. So it is while a torque is at its limit: nothing leads errors back, and a law that begins or ends to be limited
many times in a tick does in one of them what no look before has shown. Prime numbers too."""

FIRST_VERDICT, STEADY = 8, 1.1
"""Ticks after a disturbance before which nothing is judged, and up to the last of `LOOKS` nothing but what is at a force that
has not grown by more than this factor since the look before: of a run that starts at rest, the peak is still to come."""

FINER = 2
"""Levels between a tick and the same redone: of modes that are faster than the step, half of it tells little."""

GROWN = 2.0
"""By how much errors outgrow what was said of them before it is said anew."""

AMPLIFIED = 1e-12
"""Error of the pose, m or rad, from which on such a loop is said to make more of it."""

MOTION = 6
"""Errors of the pose and its rate, before those of modes."""

RINGING_SHARE = 0.5
"""What an internal force has at most of the force that a mode puts on both grips: half of how they differ."""

LOOP_DECAY = 5.0
"""Rate at which a law leads pose errors back, 1/s: the slowest that the documented gains give, about."""


class Redone(NamedTuple):
    """A tick with a quarter of the step."""

    row: np.ndarray
    """Its sample."""
    y: np.ndarray
    """The state after it."""


def _parts(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Views of errors (3 + 2 n_m,), what steps did to a run in one tick or what is left of all of them.

    Of the pose (3,), m and rad; of the force as a sample shows it, by mode that makes it, (n_m,), N or N·m; the same by the
    amplitudes of the modes, whatever their phases: where nothing fades, they come together some time.
    """
    n = len(errors) // 2 - 1
    return errors[:3], errors[3 : 3 + n], errors[3 + n :]


def _no_errors(assembly: Assembly) -> np.ndarray:
    return np.zeros(3 + 2 * len(assembly.beam.modes.omega))


def _sizes(errors: np.ndarray) -> tuple[float, float]:
    """Errors of the pose, m or rad, and of the force, N or N·m: amplitudes with no phase in common add up as squares do."""
    pose, force, ringing = _parts(errors)
    return float(np.abs(pose).max()), max(float(force.sum()), math.sqrt(product(ringing, ringing)))


class Estimate(NamedTuple):
    """What is known of a run's accuracy so far."""

    left: np.ndarray
    """Errors at the tick looked at last, as `_parts` has them."""
    rate: np.ndarray
    """Of that tick alone."""
    looked: int
    """Its number."""
    disturbed: int
    """Number of the tick from which `LOOKS` count."""
    pose: float = 0.0
    """Largest error of the pose so far, m or rad."""
    force: float = 0.0
    """Largest error of the force so far, N or N·m."""
    seen: Survey = Survey()
    """Of all samples so far."""
    peak_before: float = 0.0
    """Largest force up to the look before, N or N·m."""
    warning: str = ""
    """Since when and why results are no longer accurate, a sentence; empty: they are."""
    wait: int = CHECK_TICKS
    """Ticks between two looks after `LOOKS`, at most."""
    change: float = 0.0
    """Largest change of a torque in a tick that was looked at, N·m."""
    told: tuple[float, float, float] | None = None
    """What a warning says: since when, s, and by how much `pose` and `force` may be off."""


def _ticks_kept(decay: np.ndarray, ticks: int, tick_period: float) -> np.ndarray:
    """How many ticks' errors are left of those of `ticks` where they decay at these rates, 1/s: all of the last one's."""
    span = max(ticks, 0) * tick_period
    # Slower rates leave the same to six digits.
    rate = np.maximum(decay, 1e-6 / max(span, tick_period))
    return (1 - exponentials(-rate * span)) / (1 - exponentials(-rate * tick_period))


def nothing_yet(assembly: Assembly, tick: int) -> Estimate:
    """The estimate before tick number `tick` of a run that is accurate so far."""
    none = _no_errors(assembly)
    return Estimate(none, none, tick - 1, tick)


def disturbed(estimate: Estimate, assembly: Assembly, tick: int) -> Estimate:
    """The estimate after a tap or a change at `tick`: looks begin anew, but not before those of the last one have ended."""
    fresh = nothing_yet(assembly, tick)
    if len(fresh.left) != len(estimate.left):
        # Modes have another meaning. The peak is the run's.
        estimate = estimate._replace(left=fresh.left, rate=fresh.rate, looked=fresh.looked)
    return estimate._replace(disturbed=tick) if tick - estimate.disturbed > LOOKS[-1] else estimate


def ticks_to_check(estimate: Estimate, tick: int) -> int:
    """Ticks to go in one piece from number `tick` on: one that is redone, or up to it."""
    since = tick - estimate.disturbed
    if since > LOOKS[-1]:
        return (LOOKS[-1] - since) % estimate.wait or 1
    return min(look - since for look in LOOKS if look >= since) or 1


def is_due(estimate: Estimate, tick: int) -> bool:
    """Whether the tick from number `tick` on is to be redone."""
    since = tick - estimate.disturbed
    return since in LOOKS or (since > LOOKS[-1] and (since - LOOKS[-1]) % estimate.wait == 0)


def finer_level(estimate: Estimate, assembly: Assembly, tick: int, level: int) -> int:
    """The level with which the tick from number `tick` on, gone with `level`, is redone.

    The next one, be it finer than any that is chosen; but of modes that are damped faster than the step half of it knows
    little better than the whole, so that just after a jump it is as fine as steps after a start are, or would be if a longer
    one were not given.
    """
    watch = assembly.watch
    if tick - estimate.disturbed not in LOOKS[:3]:
        return level + FINER
    return max(level + FINER, min(watch.disturbed, watch.most or watch.disturbed))


def redo_tick(
    assembly: Assembly, move: Callable[..., Any], finer: int, state: WorldState, tick_period: float, row: np.ndarray
) -> Redone | None:
    """The tick from `state` on with the step of level `finer`; None if it cannot be.

    `move`: `advance`, or its entry point. `row` (1, row length) and `state` are scratch.
    """
    sampling, system = assembly.sampling, assembly.system._replace(held_torque=state.held_torque)
    ws, watch = scratch_workspace(system), assembly.watch._replace(most=0)
    kinked = next_tick_of_kinks(assembly, finer, state.tick, tick_period)
    if kinked is not None and kinked.number == state.tick:
        dt = tick_period / (assembly.step_count << finer)
        code = advance_in_pieces(assembly, move, system, watch, 0, dt, np.inf, kinked.cuts, state.y, ws, row)
        return Redone(row[0], state.y) if code == 0 else None
    _, code = move(
        system,
        sampling._replace(line=state.torque_line, steps=sampling.steps << finer),
        *assembly.levels.scheme(finer),
        watch,
        0,
        np.inf,
        0.0,
        state.tick,
        tick_period,
        assembly.step_count << finer,
        state.y,
        np.empty_like(state.y),
        ws,
        row,
        False,
    )
    return Redone(row[0], state.y) if code == 0 else None


def jumped(estimate: Estimate, tick: int) -> Estimate:
    """The estimate before a jump in the tick from number `tick` on: looks begin anew."""
    return estimate._replace(disturbed=tick)


def survey(estimate: Estimate, assembly: Assembly, rows: np.ndarray) -> tuple[Survey, float, int]:
    """As `survey_rows`, of `rows` (N ≥ 1, row length), the samples after the newest one."""
    return survey_rows(estimate.seen, len(assembly.scenario.arms), rows, estimate.change)


def note_load(old: Estimate, row: np.ndarray) -> Estimate:
    """The estimate with the load along the beam of one more sample seen."""
    seen = old.seen
    pressed, spun = max(seen.load_share, float(row[LOAD_SHARE])), max(seen.spin_share, float(row[SPIN_SHARE]))
    return old._replace(seen=seen._replace(load_share=pressed, spin_share=spun))


def note_survey(old: Estimate, seen: Survey, looked_at: float) -> Estimate:
    """The estimate with more samples seen; `looked_at`: the change of a torque in the tick if it was looked at, else 0, N·m."""
    return old._replace(seen=seen, change=max(old.change, looked_at))


def note(
    old: Estimate, assembly: Assembly, tick: int, row: np.ndarray, y: np.ndarray, again: Redone, tick_period: float
) -> Estimate:
    """The estimate after the tick from number `tick` on, redone as `again`; `row`: its sample, `y`: the state after it."""
    now, limited = _tick_errors(assembly, row, y, again), row[SATURATED] > 0
    led = not limited and assembly.scenario.controller.kind != "none"
    fades = ring_decay(assembly.beam)
    decay = np.concatenate([np.full(3, LOOP_DECAY if led else 0.0), fades, fades])
    # The sample shows what the tick has done itself; in those to come, its phase is not known.
    ringing = _parts(now)[2]
    ringing *= exponentials(-fades * tick_period)
    since, ticks = tick - old.disturbed, tick - old.looked
    # Ticks between two looks did, on average, what the two did; but what a disturbance does, none before it did.
    between = old.rate if since == 0 else (old.rate + now) / 2
    left = old.left * exponentials(-decay * (ticks * tick_period)) + now
    if ticks > 1:
        left += between * exponentials(-decay * tick_period) * _ticks_kept(decay, ticks - 1, tick_period)
    pose, force = map(max, (old.pose, old.force), _sizes(left))
    seen = old._replace(left=left, rate=now, looked=tick, pose=pose, force=force, peak_before=old.seen.peak)
    if old.told is not None:
        return _told_anew(seen, assembly.scenario, old.told)
    if old.warning or since < FIRST_VERDICT:
        return seen
    time = (tick + 1) * tick_period
    if assembly.amplifies and pose > AMPLIFIED:
        return seen._replace(warning=amplified(assembly.scenario))
    if assembly.scenario.joints.encoders.active and pose > AMPLIFIED:
        return seen._replace(warning=COUNTED)
    # Motors that were overloaded a look before as well are so for longer than a moment.
    if limited and old.wait == CLOSEST_TICKS and any(assembly.scenario.joints.motor.stall_torque):
        return seen._replace(warning=unled(time, "stronger motors (joints.motor)"))
    said, told = "", (pose, force)
    if since >= LOOKS[-1]:
        for wait in (CHECK_TICKS, CLOSE_TICKS, CLOSEST_TICKS):
            ahead = left * exponentials(-decay * (wait * tick_period)) + now * _ticks_kept(decay, wait, tick_period)
            told = tuple(map(max, (pose, force), _sizes(ahead)))
            said, seen = (
                inaccurate(assembly.scenario, time, told, (pose, force), seen.seen.peak),
                seen._replace(wait=wait),
            )
            if not said and (wait == CLOSEST_TICKS or not limited):
                break
    elif old.seen.peak <= STEADY * old.peak_before:
        said = inaccurate(assembly.scenario, time, told, (pose, force), seen.seen.peak)
    if said and limited and pose > bounds(assembly.scenario, seen.seen.peak)[0]:
        return seen._replace(warning=unled(time, "a higher torque limit (controller.torque_limit)"))
    return seen._replace(warning=said, told=(time, *told)) if said else seen


def _told_anew(estimate: Estimate, scenario: Scenario, told: tuple[float, float, float]) -> Estimate:
    """The estimate with a warning of the sizes that its errors have grown to, if what it says of them is too little."""
    (time, *sizes), found = told, (estimate.pose, estimate.force)
    least = bounds(scenario, estimate.seen.peak)
    if all(now <= GROWN * max(said, bound) for now, said, bound in zip(found, sizes, least, strict=True)):
        return estimate
    said = inaccurate(scenario, time, found, found, estimate.seen.peak)
    return estimate._replace(warning=said or estimate.warning, told=(time, estimate.pose, estimate.force))


def _tick_errors(assembly: Assembly, row: np.ndarray, y: np.ndarray, again: Redone) -> np.ndarray:
    """How a tick and the same tick redone differ, as `_parts` has it."""
    errors = _no_errors(assembly)
    pose, force, ringing = _parts(errors)
    pose[:] = row[POSE : POSE + 3] - again.row[POSE : POSE + 3]
    difference = float(np.abs(forces(row[None], assembly) - forces(again.row[None], assembly)).max())
    if difference > 0:
        weights = mode_forces(assembly, y - again.y)
        # What creeps back rings in no phase: of it counts what the sample shows.
        ringing[:] = np.where(rings(assembly), weights, 0.0)
        # The force's difference is shared out by what each mode's difference in amplitude weighs in it.
        force[:] = difference / (float(weights.sum()) or 1.0) * weights
    return errors


def _length(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """√(x² + y²), which the C library's hypot rounds in its own way."""
    return np.sqrt(x * x + y * y)


def mode_forces(assembly: Assembly, differs: np.ndarray) -> np.ndarray:
    """Force that each mode's amplitude in a difference of two states puts on the grips, (n_m,), N or N·m."""
    omega, modal = assembly.beam.modes.omega, assembly.system.plant.modal
    n = len(omega)
    # In a free ring, ω times η goes over into η̇ and back.
    amplitude = _length(omega * differs[ETA : ETA + n], differs[ETA + n : ETA + 2 * n])
    return RINGING_SHARE * omega * _length(modal[H], modal[G]) * amplitude


def rings(assembly: Assembly) -> np.ndarray:
    """Which modes oscillate, (n_m,): the others creep back."""
    modes = assembly.beam.modes
    return modes.D.diagonal() < 2 * modes.omega


def forces(rows: np.ndarray, assembly: Assembly) -> np.ndarray:
    """Internal forces in sample rows, (N, arms, 3); of one arm alone, which has none, the moving force (N, 1, 3)."""
    arms = len(assembly.scenario.arms)
    if arms == 1:
        return rows[:, None, MOVING : MOVING + 3]
    own = rows[:, ARMS : ARMS + PER_ARM * arms].reshape(len(rows), arms, PER_ARM)
    return own[:, :, INTERNAL : INTERNAL + 3]
