"""Whether a run's results are still accurate: now and then a tick is redone with half the step, on copies.

What differs is the error of one tick. Each mode adds up those of its ticks as long as it rings and forgets them as it decays;
the pose does as the law leads it back. Looks are close together after a start, a tap or a change, where errors are largest and
fade fastest. The estimate is a function of states at ticks that their numbers and the commands choose, so that it is the same
live, headless and replayed; it changes no bit of the run.
"""

from typing import NamedTuple

import numpy as np

from flexlab.physics.plant import ETA, G, H
from flexlab.scenario import Scenario
from flexlab.sim import row_layout
from flexlab.sim.advance import advance
from flexlab.sim.assembly import Assembly
from flexlab.sim.closed_loop import scratch_workspace
from flexlab.sim.signals import ARMS, INTERNAL, MOVING, PER_ARM
from flexlab.sim.world_state import WorldState

LOOKS = (0, 1, 2, 5, 8, 17, 32, 65)
"""Ticks after a disturbance that are redone, even and odd ones as control instants may be either: fast modes ring for a few
of them only."""

CHECK_TICKS = 1021
"""Then a tick is redone every so many: with 128 the copies that it takes cost a small beam as much as its motion. A prime
number, so that the looks fall on all phases of path and control."""

FIRST_VERDICT, STEADY = 8, 1.1
"""Ticks after a disturbance before which nothing is judged, and up to the last of `LOOKS` nothing but what is at a force that
has not grown by more than this factor since the look before: of a run that starts at rest, the peak is still to come."""

POSE_BOUND = 1e-8
"""Estimated error of the pose, m or rad, up to which a run is called accurate that was not asked to be coarser."""

FORCE_BOUND = 1e-4
"""The same of the internal force, over its peak so far; of one arm alone, of the force that moves the beam."""

RINGING_SHARE = 0.5
"""What an internal force has at most of the force that a mode puts on both grips: half of how they differ."""

LOOP_DECAY = 5.0
"""Rate at which a law leads pose errors back, 1/s: the slowest that the documented gains give, about."""


class Redone(NamedTuple):
    """A tick with half the step."""

    row: np.ndarray
    """Its sample."""
    y: np.ndarray
    """The state after it."""


class Errors(NamedTuple):
    """What steps did to a run: in one tick, or what is left of all of them."""

    pose: np.ndarray
    """(3,), m and rad."""
    force: np.ndarray
    """Of the force as a sample shows it, by mode that makes it, (n_m,), N or N·m."""
    ringing: np.ndarray
    """The same by the amplitudes of the modes, whatever their phases: where nothing fades, they come together some time."""

    @property
    def worst_pose(self) -> float:
        """Of any coordinate, m or rad."""
        return float(np.abs(self.pose).max())

    @property
    def whole_force(self) -> float:
        """Of the force, N or N·m; amplitudes of modes with no phase in common add up as squares do."""
        return max(float(self.force.sum()), float(np.sqrt(self.ringing @ self.ringing)))


class Estimate(NamedTuple):
    """What is known of a run's accuracy so far."""

    left: Errors
    """At the tick looked at last."""
    rate: Errors
    """Of that tick alone."""
    looked: int
    """Its number."""
    disturbed: int
    """Number of the tick from which `LOOKS` count."""
    pose: float = 0.0
    """Largest error of the pose so far, m or rad."""
    force: float = 0.0
    """Largest error of the force so far, N or N·m."""
    peak: float = 0.0
    """Largest force so far, N or N·m."""
    peak_before: float = 0.0
    """The same at the look before."""
    warning: str = ""
    """Since when and why results are no longer accurate, a sentence; empty: they are."""


class Fading(NamedTuple):
    """How errors fade."""

    pose: float
    """1/s."""
    modes: np.ndarray
    """(n_m,), 1/s."""

    def left(self, errors: Errors, span: float) -> Errors:
        """What is left of errors after `span` s."""
        on_modes = np.exp(-self.modes * span)
        return Errors(errors.pose * np.exp(-self.pose * span), errors.force * on_modes, errors.ringing * on_modes)

    def kept(self, rate: Errors, ticks: int, tick_period: float) -> Errors:
        """What is left at the end of so many ticks that each made the errors `rate`, with none faded of the last one's."""
        on_pose, on_modes = (_ticks_kept(decay, ticks, tick_period) for decay in (np.array(self.pose), self.modes))
        return Errors(rate.pose * on_pose, rate.force * on_modes, rate.ringing * on_modes)


def _ticks_kept(decay: np.ndarray, ticks: int, tick_period: float) -> np.ndarray:
    """How many ticks' errors are left of those of `ticks` where they decay at these rates, 1/s: at least the last one's."""
    span = ticks * tick_period
    slow = decay * span < 1e-6
    kept = np.where(slow, span, -np.expm1(-decay * span) / np.where(slow, 1.0, decay)) / tick_period
    return np.maximum(kept, min(ticks, 1))


def _sum(one: Errors, other: Errors) -> Errors:
    return Errors(*(a + b for a, b in zip(one, other, strict=True)))


def _larger(one: Errors, other: Errors) -> Errors:
    return Errors(*(np.where(np.abs(a) > np.abs(b), a, b) for a, b in zip(one, other, strict=True)))


def nothing_yet(assembly: Assembly, tick: int) -> Estimate:
    """The estimate before tick number `tick` of a run that is accurate so far."""
    n = len(assembly.beam.modes.omega)
    none = Errors(np.zeros(3), np.zeros(n), np.zeros(n))
    return Estimate(none, none, tick - 1, tick)


def disturbed(estimate: Estimate, assembly: Assembly, tick: int) -> Estimate:
    """The estimate after a tap or a change at `tick`: looks begin anew, but not before those of the last one have ended."""
    if len(assembly.beam.modes.omega) != len(estimate.left.force):
        # Modes have another meaning. The peak is the run's.
        fresh = nothing_yet(assembly, tick)
        estimate = estimate._replace(left=fresh.left, rate=fresh.rate, looked=fresh.looked)
    return estimate._replace(disturbed=tick) if tick - estimate.disturbed > LOOKS[-1] else estimate


def ticks_to_check(estimate: Estimate, tick: int) -> int:
    """Ticks to go in one piece from number `tick` on: one that is redone, or up to it."""
    since = tick - estimate.disturbed
    if since > LOOKS[-1]:
        return (LOOKS[-1] - since) % CHECK_TICKS or 1
    return min(look - since for look in LOOKS if look >= since) or 1


def is_due(estimate: Estimate, tick: int) -> bool:
    """Whether the tick from number `tick` on is to be redone."""
    since = tick - estimate.disturbed
    return since in LOOKS or (since > LOOKS[-1] and (since - LOOKS[-1]) % CHECK_TICKS == 0)


def redo_tick(assembly: Assembly, level: int, state: WorldState, tick_period: float, row: np.ndarray) -> Redone | None:
    """The tick from `state` on with the step of the next finer level; None if it cannot be.

    `row` (1, row length) and `state` are scratch.
    """
    finer, sampling, system = level + 1, assembly.sampling, assembly.system
    _, code = advance(
        system._replace(held_torque=state.held_torque),
        sampling._replace(line=state.torque_line, steps=sampling.steps << finer),
        *assembly.levels.scheme(finer),
        assembly.watch._replace(most=0),
        0,
        np.inf,
        state.tick,
        tick_period,
        assembly.step_count << finer,
        state.y,
        np.empty_like(state.y),
        scratch_workspace(system),
        row,
        False,
    )
    return Redone(row[0], state.y) if code == 0 else None


def note_peak(old: Estimate, assembly: Assembly, rows: np.ndarray) -> Estimate:
    """The estimate after `rows` (N, row length) more."""
    return old._replace(peak=max(old.peak, float(np.abs(_forces(rows, assembly)).max())))


def note(
    old: Estimate, assembly: Assembly, tick: int, row: np.ndarray, y: np.ndarray, again: Redone, tick_period: float
) -> Estimate:
    """The estimate after the tick from number `tick` on, redone as `again`; `row`: its sample, `y`: the state after it."""
    loop = 0.0 if assembly.scenario.controller.kind == "none" else LOOP_DECAY
    fading, now = Fading(loop, np.diag(assembly.beam.modes.D) / 2), _tick_errors(assembly, row, y, again)
    since, ticks = tick - old.disturbed, tick - old.looked
    # Ticks between two looks did no worse than the worse of the two; but what a disturbance does, none before it did.
    between = old.rate if since == 0 else _larger(old.rate, now)
    left = _sum(fading.left(old.left, ticks * tick_period), fading.kept(between, ticks - 1, tick_period))
    left = _sum(left, now)
    pose, force = max(old.pose, left.worst_pose), max(old.force, left.whole_force)
    seen = old._replace(left=left, rate=now, looked=tick, pose=pose, force=force, peak_before=old.peak)
    if old.warning or since < FIRST_VERDICT:
        return seen
    if since >= LOOKS[-1]:
        ahead = _sum(fading.left(left, CHECK_TICKS * tick_period), fading.kept(now, CHECK_TICKS, tick_period))
        pose, force = max(pose, ahead.worst_pose), max(force, ahead.whole_force)
    elif old.peak > STEADY * old.peak_before:
        return seen
    return seen._replace(warning=_warning(pose, force, seen, assembly.scenario, (tick + 1) * tick_period))


def _tick_errors(assembly: Assembly, row: np.ndarray, y: np.ndarray, again: Redone) -> Errors:
    """How a tick and the same tick redone differ."""
    omega, modal = assembly.beam.modes.omega, assembly.system.plant.modal
    n = len(omega)
    differs = y[ETA : ETA + 2 * n] - again.y[ETA : ETA + 2 * n]
    # In a free ring, ω times η goes over into η̇ and back.
    ringing = RINGING_SHARE * omega * np.hypot(modal[H], modal[G]) * np.hypot(omega * differs[:n], differs[n:])
    forces = _forces(np.stack([row, again.row]), assembly)
    difference = float(np.abs(forces[0] - forces[1]).max(initial=0.0))
    place = slice(row_layout.POSE, row_layout.POSE + 3)
    # The force's difference is shared out by what each mode's difference in amplitude weighs in it.
    force = difference * ringing / (float(ringing.sum()) or 1.0)
    return Errors(row[place] - again.row[place], force, ringing if difference > 0 else np.zeros(n))


def _forces(rows: np.ndarray, assembly: Assembly) -> np.ndarray:
    """Internal forces in sample rows, (N, arms, 3); of one arm alone, which has none, the moving force (N, 1, 3)."""
    arms = len(assembly.scenario.arms)
    if arms == 1:
        return rows[:, None, MOVING : MOVING + 3]
    own = rows[:, ARMS : ARMS + PER_ARM * arms].reshape(len(rows), arms, PER_ARM)
    return own[:, :, INTERNAL : INTERNAL + 3]


def _warning(pose: float, force: float, estimate: Estimate, scenario: Scenario, time: float) -> str:
    """A sentence once the errors found until `time`, s, are beyond their bounds, else empty."""
    found = []
    bound = max(POSE_BOUND, scenario.simulation.accuracy)
    if pose > bound:
        found.append(f"the pose may be off by {pose:.1g} m or rad")
    if force > FORCE_BOUND * estimate.peak:
        share = f"{force / estimate.peak:.1g} of its peak" if estimate.peak else f"{force:.1g} N"
        name = "internal" if len(scenario.arms) > 1 else "moving"
        found.append(f"the {name} force may be off by {share}")
    if not found:
        return ""
    cause, cure = "errors of the steps add up in modes that ring on", "more damping, fewer elements"
    smaller = " or a smaller simulation.accuracy"
    if estimate.pose > bound or estimate.force > FORCE_BOUND * estimate.peak:
        cause = "the start or a change excites modes that are faster than the steps, or errors of the steps add up"
        cure = "a smooth start, more damping, fewer elements"
    if scenario.simulation.step is not None:
        cure, smaller = "a shorter simulation.step or null", ""
    return (
        f"Results are no longer accurate since about t = {time:.3f} s: {' and '.join(found)}, as {cause}. "
        f"Reset with {cure}{smaller}."
    )
