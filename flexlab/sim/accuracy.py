"""The estimate of a run's accuracy: now and then a tick is repeated, on copies of the state, with a quarter of the step.

The difference is the error of that tick. Each mode accumulates the errors of its ticks while it rings and loses them as it
decays; errors of the pose decay as the law corrects them. Checks are frequent where errors are largest and decay fastest: after
a start, a tap, a change, or a jump of the torques larger than any in a checked tick. What arms and law make of errors of the
beam's vibration is seen once errors are reported: the run is then simulated ahead with and without them. The estimate depends
only on states at ticks chosen by number, commands and samples: it is the same live, headless and replayed, and it changes no bit
of the run.
"""

import math
from typing import NamedTuple

import numpy as np

from flexlab.numerics.elementary import exponentials
from flexlab.numerics.linear_algebra import product
from flexlab.physics.plant import ETA, G, H
from flexlab.scenario import Scenario
from flexlab.sim.assembly import Assembly
from flexlab.sim.loss_error import LossError
from flexlab.sim.run_warnings import (
    COUNTED,
    Largest,
    Peaks,
    Sizes,
    amplified,
    bounds,
    inaccurate,
    model_warning,
    saturated,
)
from flexlab.sim.signals import ARMS, INTERNAL, MOVING, PER_ARM, POSE, SATURATED
from flexlab.sim.step_rates import ring_decay

CHECKED_TICKS, SLOW_TICKS = (0, 1, 2, 5, 8, 17, 32, 65), (131, 257, 521)
"""Ticks after a disturbance that are checked: even and odd ones, as control instants may lie on either. Fast modes ring for a
few ticks only; and a smooth start makes its largest errors late."""
INTERVAL = 1021
"""Ticks between later checks: at 128, the copies would cost as much as the motion of a small beam. It is prime, so that
checks fall on all phases of path and control."""
SHORT_INTERVAL, SHORTEST_INTERVAL = 67, 13
"""Ticks between checks if errors as large as the newest would exceed their bounds within `INTERVAL`, and `SHORT_INTERVAL`: most
decay before. The shortest also applies while a torque is at its limit: nothing corrects errors then, and a law that reaches
and leaves its limit many times in a tick makes errors that no earlier check has shown. Both are prime."""
FIRST_VERDICT, STEADY = 8, 1.1
"""Ticks after a disturbance in which nothing is judged; and the factor by which the largest force may grow between two of the
`CHECKED_TICKS` of a run that is judged: the peak of a run that starts at rest is still to come."""
FINER = 2
"""Levels by which a repetition is finer than its tick: for modes faster than the step, half the step tells little."""
GROWN = 2.0
"""Factor by which errors must exceed the reported ones to be reported again."""
AMPLIFIED = 1e-12
"""Smallest error of the pose, m or rad, with which a loop that amplifies errors is reported."""
LOOSER = "a higher torque limit (controller.torque_limit)"
SWING = 1.9
"""Change of a torque in a tick over the largest limit, from which it swings from limit to limit."""
RINGING_SHARE = 0.5
"""Largest share of a mode's force on both grips that is internal: half of the difference between the grips."""
LOOP_DECAY = 5.0
"""Rate at which a law corrects pose errors, 1/s: about the slowest with the documented gains."""


def _parts(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Views of the parts of errors (3 + 2 n_m,), of one tick or accumulated.

    Errors of the pose, (3,), m and rad; of the force in a sample, by the mode that causes them, (n_m,), N or N·m; and of the
    force by the modes' amplitudes, whatever their phases: without decay, all phases coincide at some time.
    """
    n = len(errors) // 2 - 1
    return errors[:3], errors[3 : 3 + n], errors[3 + n :]


def _no_errors(assembly: Assembly) -> np.ndarray:
    return np.zeros(3 + 2 * len(assembly.beam.modes.omega))


def _sizes(errors: np.ndarray, answer: float) -> Sizes:
    """Return errors of the pose, m or rad, and the force, N or N·m; amplitudes of unrelated phases add in quadrature.

    `answer`: as of `Estimate`.
    """
    pose, force, ringing = _parts(errors)
    ring = math.sqrt(product(ringing, ringing))
    return float(np.abs(pose).max()) + answer * ring, max(float(force.sum()), ring)


def _largest_sizes(errors: np.ndarray, answer: float) -> Sizes:
    """As `_sizes`, with all phases alike: what a warning states."""
    pose, force, _ = _parts(errors)
    ring = ring_force(errors)
    return float(np.abs(pose).max()) + answer * ring, max(float(force.sum()), ring)


def ring_force(errors: np.ndarray) -> float:
    """The force of all errors of the vibration with their phases alike, N or N·m."""
    return float(_parts(errors)[2].sum())


class Estimate(NamedTuple):
    """What is known of a run's accuracy so far."""

    accumulated: np.ndarray
    """Errors at the newest checked tick, as in `_parts`."""
    newest: np.ndarray
    """Errors of that tick alone."""
    checked: int
    """Number of that tick."""
    disturbed: int
    """Number of the tick from which `CHECKED_TICKS` are counted."""
    pose: float = 0.0
    """Largest error of the pose so far, m or rad."""
    force: float = 0.0
    """Largest error of the force so far, N or N·m."""
    peaks: Peaks = Peaks()
    """Peaks of all samples so far."""
    peak_before: float = 0.0
    """Largest force up to the check before, N or N·m."""
    warning: str = ""
    """A sentence that says since when and why results are no longer accurate; empty while they are."""
    ended: tuple[str, str] = ("", "")
    """The last warning of the model and the last `warning` that a change of the scenario has ended, or empty."""
    interval: int = INTERVAL
    """Largest number of ticks between two checks after `CHECKED_TICKS`."""
    torque_change: float = 0.0
    """Largest change of a torque in a checked tick, N·m."""
    newest_change: float = 0.0
    """Largest change of a torque in the newest checked tick, N·m."""
    answer: float = 0.0
    """How far errors of the vibration move the pose, as arms and law answer them, m or rad per N or N·m of `ring_force`; 0 until
    errors are reported."""
    answered: float = 0.0
    """`ring_force` of the tick's errors with which `answer` was found, N or N·m."""
    reported: tuple[float, float, float] | None = None
    """What the warning says: since when, s, and by how much `pose` and `force` may be off."""
    loss: LossError = LossError()


def _ticks_kept(decay: np.ndarray, ticks: int, tick_period: float) -> np.ndarray:
    """Sum over `ticks` ticks of the share of each one's error left at the last, for decay rates, 1/s; 1 for the last."""
    span = max(ticks, 0) * tick_period
    # Slower rates leave the same to six digits.
    rate = np.maximum(decay, 1e-6 / max(span, tick_period))
    return (1 - exponentials(-rate * span)) / (1 - exponentials(-rate * tick_period))


def nothing_yet(assembly: Assembly, tick: int) -> Estimate:
    """The estimate before tick number `tick` of a run that is accurate so far."""
    none = _no_errors(assembly)
    return Estimate(none, none, tick - 1, tick)


def disturbed(estimate: Estimate, assembly: Assembly, tick: int) -> Estimate:
    """The estimate after a tap or a change at `tick`: checks start over, unless those after the last one still go on."""
    fresh = nothing_yet(assembly, tick)
    if len(fresh.accumulated) != len(estimate.accumulated):
        # The modes are others, and their errors unknown. The peak remains that of the run.
        estimate = estimate._replace(accumulated=fresh.accumulated, newest=fresh.newest, checked=fresh.checked)
    return estimate._replace(disturbed=tick) if tick - estimate.disturbed > CHECKED_TICKS[-1] else estimate


def changed(estimate: Estimate, before: Assembly, assembly: Assembly, tick: int) -> Estimate:
    """The estimate after a change of the scenario at `tick`: warnings whose cause it removes end."""
    old, new, said = before.scenario, assembly.scenario, estimate.warning
    estimate, (of_model, of_results) = disturbed(estimate, assembly, tick), estimate.ended
    if old.payload.axial_load != new.payload.axial_load:
        of_model = model_warning(old.payload, estimate.peaks._replace(bending=Largest())).text or of_model
        peaks = estimate.peaks._replace(load_share=Largest(), critical=0.0, spin_share=Largest())
        estimate = estimate._replace(peaks=peaks)
    rounded = said == amplified(old)
    if rounded and assembly.amplifies:
        estimate = estimate._replace(warning=amplified(new))
    elif rounded or (said.startswith(COUNTED) and not new.joints.encoders.active):
        of_results = said
        # What is left of the errors is reported anew.
        estimate = estimate._replace(warning="", pose=0.0, force=0.0, reported=None)
    return estimate._replace(ended=(of_model, of_results))


def unanswered(estimate: Estimate) -> bool:
    """Whether errors are reported and those of the newest tick are too large for the answer found before."""
    return estimate.reported is not None and ring_force(estimate.newest) > GROWN * estimate.answered


def ticks_until_check(estimate: Estimate, tick: int) -> int:
    """Number of ticks from number `tick` to the next that is checked; 0 if this one is."""
    since = tick - estimate.disturbed
    if since > CHECKED_TICKS[-1]:
        slow = (number - since for number in SLOW_TICKS if number >= since)
        return min([(CHECKED_TICKS[-1] - since) % estimate.interval, *slow])
    return min(number - since for number in CHECKED_TICKS if number >= since)


def finer_level(estimate: Estimate, assembly: Assembly, tick: int, level: int) -> int:
    """The level at which the tick from number `tick` on, simulated at `level`, is repeated; it may be finer than any in use.

    For modes that are damped faster than the step, half the step tells little more than the whole. Just after a jump, the
    repetition is therefore as fine as steps after a start are, or would be if no step were given.
    """
    watch = assembly.watch
    if tick - estimate.disturbed not in CHECKED_TICKS[:3]:
        return level + FINER
    return max(level + FINER, min(watch.disturbed, watch.most or watch.disturbed))


def note(
    old: Estimate, assembly: Assembly, tick: int, row: np.ndarray, y: np.ndarray, again: np.ndarray, y_again: np.ndarray
) -> Estimate:
    """The estimate after a check of the tick from number `tick` on, with the sample `row` and the state y at its end.

    `again`, `y_again`: sample and state at the end of its repetition in finer steps.
    """
    now, limited = _tick_errors(assembly, row, y, again, y_again), row[SATURATED] > 0
    tick_period, decay = assembly.tick_period, _decay(assembly, limited)
    # The sample shows the tick's own error; in later ticks, the phase of that error is unknown.
    ringing = _parts(now)[2]
    ringing *= exponentials(-_parts(decay)[2] * tick_period)
    since, ticks = tick - old.disturbed, tick - old.checked
    # Errors of ticks between two checks are taken as the mean of the two; those before a disturbance do not have its error.
    between = old.newest if since == 0 else (old.newest + now) / 2
    errors = old.accumulated * exponentials(-decay * (ticks * tick_period)) + now
    if ticks > 1:
        errors += between * exponentials(-decay * tick_period) * _ticks_kept(decay, ticks - 1, tick_period)
    found = tuple(map(max, (old.pose, old.force), _sizes(errors, old.answer)))
    peak = old.peaks.peak
    new = old._replace(accumulated=errors, newest=now, checked=tick, pose=found[0], force=found[1], peak_before=peak)
    new = _with_warning(new, old, assembly, tick, limited)
    return _with_counts(new, assembly) if since >= FIRST_VERDICT or old.warning else new


def _with_warning(new: Estimate, old: Estimate, assembly: Assembly, tick: int, limited: bool) -> Estimate:
    """`new`, the estimate after a check of tick number `tick`, with its warning; `old`: the estimate before.

    `limited`: whether a torque is at its limit.
    """
    scenario, tick_period, peak = assembly.scenario, assembly.tick_period, old.peaks.peak
    time, since, found = (tick + 1) * tick_period, tick - old.disturbed, (new.pose, new.force)
    if old.reported is not None:
        return _reported_anew(new, scenario, old.reported)
    if old.warning not in ("", COUNTED) or since < FIRST_VERDICT:
        return new
    # Every motion is rounded, and such a loop turns 10⁻¹⁶ m into millimetres within a hundred control periods.
    if assembly.amplifies and (new.pose > AMPLIFIED or old.torque_change > 0):
        return new._replace(warning=amplified(scenario))
    # Motors that were overloaded at the previous check too are overloaded for more than a moment.
    if limited and old.interval == SHORTEST_INTERVAL:
        law = scenario.controller
        if any(scenario.joints.motor.stall_torque):
            return new._replace(warning=saturated(time, "stronger motors (joints.motor)"))
        # Held torques that swing between their limits amplify errors of any size.
        if law.control_period and law.torque_limit and old.newest_change >= SWING * max(law.torque_limit):
            return new._replace(warning=saturated(time, LOOSER))
    ahead = new.accumulated
    if since >= CHECKED_TICKS[-1]:
        decay = _decay(assembly, limited)
        for interval in (INTERVAL, SHORT_INTERVAL, SHORTEST_INTERVAL):
            ahead = new.accumulated * exponentials(-decay * (interval * tick_period)) + new.newest * _ticks_kept(
                decay, interval, tick_period
            )
            new = new._replace(interval=interval)
            is_wrong = _exceed(tuple(map(max, found, _sizes(ahead, new.answer))), bounds(scenario, peak))
            if not is_wrong and (interval == SHORTEST_INTERVAL or not limited):
                break
    else:
        is_wrong = peak <= STEADY * old.peak_before and _exceed(found, bounds(scenario, peak))
    if not is_wrong:
        return new
    if limited and new.pose > bounds(scenario, peak)[0]:
        return new._replace(warning=saturated(time, LOOSER))
    pose, force = map(max, found, *(_largest_sizes(each, new.answer) for each in (new.accumulated, ahead)))
    said = inaccurate(scenario, time, (pose, force), found, peak)
    return new._replace(warning=said, reported=(time, pose, force))


def _exceed(sizes: Sizes, limits: Sizes) -> bool:
    return any(size > limit for size, limit in zip(sizes, limits, strict=True))


def _with_counts(estimate: Estimate, assembly: Assembly) -> Estimate:
    """The estimate with the warning for encoders before any other, from the first error on."""
    said, counted = estimate.warning, assembly.scenario.joints.encoders.active and not assembly.amplifies
    if not counted or estimate.pose <= AMPLIFIED or said.startswith(COUNTED):
        return estimate
    return estimate._replace(warning=f"{COUNTED} {said}".rstrip())


def _decay(assembly: Assembly, limited: bool) -> np.ndarray:
    """Rates, 1/s, at which errors decay, as in `_parts`; `limited`: whether a torque is at its limit."""
    led, fades = not limited and assembly.scenario.controller.kind != "none", ring_decay(assembly.beam)
    return np.concatenate([np.full(3, LOOP_DECAY if led else 0.0), fades, fades])


def _reported_anew(estimate: Estimate, scenario: Scenario, reported: tuple[float, float, float]) -> Estimate:
    """The estimate, with a new warning if its errors exceed those that the old one gives by the factor `GROWN`."""
    (time, *sizes), largest = reported, _largest_sizes(estimate.accumulated, estimate.answer)
    peak = estimate.peaks.peak
    if all(
        now <= GROWN * max(said, bound) for now, said, bound in zip(largest, sizes, bounds(scenario, peak), strict=True)
    ):
        return estimate
    pose, force = map(max, largest, sizes)
    said = inaccurate(scenario, time, (pose, force), (estimate.pose, estimate.force), peak)
    return estimate._replace(warning=said, reported=(time, pose, force))


def _tick_errors(
    assembly: Assembly, row: np.ndarray, y: np.ndarray, again: np.ndarray, y_again: np.ndarray
) -> np.ndarray:
    """The difference between a tick and its repetition, as in `_parts`."""
    errors = _no_errors(assembly)
    pose, force, ringing = _parts(errors)
    pose[:] = row[POSE : POSE + 3] - again[POSE : POSE + 3]
    with np.errstate(invalid="ignore"):  # A law that runs away has infinite forces in both.
        difference = float(np.abs(forces(row[None], assembly) - forces(again[None], assembly)).max())
    if difference > 0:
        weights = mode_forces(assembly, y - y_again)
        # Overdamped modes do not ring: only what the sample shows of them counts.
        ringing[:] = np.where(oscillates(assembly), weights, 0.0)
        # The force's difference is shared among the modes in proportion to their weights.
        force[:] = difference / (float(weights.sum()) or 1.0) * weights
    return errors


def _length(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """√(x² + y²), which the C library's hypot rounds in its own way."""
    return np.sqrt(x * x + y * y)


def mode_forces(assembly: Assembly, difference: np.ndarray) -> np.ndarray:
    """Force on the grips by each mode's amplitude in a difference of two states, (n_m,), N or N·m."""
    omega, modal = assembly.beam.modes.omega, assembly.system.plant.modal
    n = len(omega)
    # In free vibration ω η turns into η̇ and back.
    amplitude = _length(omega * difference[ETA : ETA + n], difference[ETA + n : ETA + 2 * n])
    return RINGING_SHARE * omega * _length(modal[H], modal[G]) * amplitude


def oscillates(assembly: Assembly) -> np.ndarray:
    """Which modes oscillate, (n_m,): the others are overdamped."""
    modes = assembly.beam.modes
    return modes.D.diagonal() < 2 * modes.omega


def forces(rows: np.ndarray, assembly: Assembly) -> np.ndarray:
    """Internal forces in sample rows, (N, arms, 3); a single arm has none: its moving force, (N, 1, 3)."""
    arms = len(assembly.scenario.arms)
    if arms == 1:
        return rows[:, None, MOVING : MOVING + 3]
    own = rows[:, ARMS : ARMS + PER_ARM * arms].reshape(len(rows), arms, PER_ARM)
    return own[:, :, INTERNAL : INTERNAL + 3]
