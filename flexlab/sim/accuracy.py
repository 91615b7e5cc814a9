"""Whether a run's results are still accurate: now and then a tick is redone with half the step, on copies.

What differs is the error of one tick. Each mode adds up those of its ticks as long as it rings and forgets them as it decays;
the pose does as the law leads it back. The estimate is a function of states at ticks that their numbers choose, so that it
is the same live, headless and replayed; it changes no bit of the run.
"""

from typing import NamedTuple

import numpy as np

from flexlab.physics.plant import ETA, G, H
from flexlab.scenario import Scenario
from flexlab.sim import row_layout
from flexlab.sim.advance import advance
from flexlab.sim.assembly import Assembly
from flexlab.sim.closed_loop import new_workspace
from flexlab.sim.signals import ARMS, INTERNAL, PER_ARM
from flexlab.sim.world_state import WorldState

CHECK_TICKS, CHECK_OFFSET = 1024, 64
"""A tick is redone every so many: with 128 the copies that it takes cost a small beam as much as its motion. And how far from
the first, whose jerk stands for no other tick."""

POSE_BOUND = 1e-8
"""Estimated error of the pose, m or rad, up to which a run is called accurate."""

FORCE_BOUND = 1e-4
"""The same of the internal force, over its peak so far."""

LOOP_DECAY = 5.0
"""Rate at which a law leads pose errors back, 1/s: the slowest that the documented gains give, about."""


class Redone(NamedTuple):
    """A tick with half the step."""

    row: np.ndarray
    """Its sample."""
    y: np.ndarray
    """The state after it."""


class Estimate(NamedTuple):
    """Error of a run so far."""

    pose: np.ndarray
    """(3,), m and rad."""
    force: np.ndarray
    """Of the internal force, by mode that makes it, (n_m,), N or N·m."""
    peak: float
    """Largest internal force so far, N or N·m."""


def nothing_yet(assembly: Assembly) -> Estimate:
    """The estimate before the first tick."""
    return Estimate(np.zeros(3), np.zeros(len(assembly.beam.modes.omega)), 0.0)


def is_due(tick: int) -> bool:
    """Whether the tick from number `tick` on is to be redone."""
    return tick % CHECK_TICKS == CHECK_OFFSET


def ticks_to_check(tick: int) -> int:
    """Ticks to go in one piece from number `tick` on: one that is redone, or up to it."""
    return 1 if is_due(tick) else (CHECK_OFFSET - tick) % CHECK_TICKS


def redo_tick(assembly: Assembly, level: int, state: WorldState, tick_period: float, row: np.ndarray) -> Redone | None:
    """The tick from `state` on with the step of the next finer level; None if it cannot be; `row` (1, row length): scratch."""
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
        new_workspace(system),
        row,
        False,
    )
    return Redone(row[0], state.y) if code == 0 else None


def note(
    old: Estimate,
    assembly: Assembly,
    arms: int,
    rows: np.ndarray,
    y: np.ndarray,
    again: Redone | None,
    tick_period: float,
) -> Estimate:
    """The estimate after `rows` (N, row length) more, of which the last was redone as `again`; `y`: the state after it."""
    peak = max(old.peak, float(np.abs(_internal_forces(rows, arms)).max()))
    if again is None:
        return old._replace(peak=peak)
    span, modes, modal = CHECK_TICKS * tick_period, assembly.beam.modes, assembly.system.plant.modal
    n = len(modes.omega)
    decay = np.diag(modes.D) / 2
    # The force's difference is shared out by what each mode's difference in amplitude weighs in it.
    differs = np.hypot(
        modes.omega * (y[ETA : ETA + n] - again.y[ETA : ETA + n]),
        y[ETA + n : ETA + 2 * n] - again.y[ETA + n : ETA + 2 * n],
    )
    weight = modes.omega * np.hypot(modal[H], modal[G]) * differs
    difference = np.abs(_internal_forces(rows[-1:], arms) - _internal_forces(again.row[None], arms)).max()
    share = difference * weight / (weight.sum() or 1.0)
    loop = np.array(0.0 if assembly.scenario.controller.kind == "none" else LOOP_DECAY)
    place = slice(row_layout.POSE, row_layout.POSE + 3)
    return Estimate(
        old.pose * np.exp(-loop * span) + (rows[-1, place] - again.row[place]) * _ticks_kept(loop, span, tick_period),
        old.force * np.exp(-decay * span) + share * _ticks_kept(decay, span, tick_period),
        peak,
    )


def _ticks_kept(decay: np.ndarray, span: float, tick_period: float) -> np.ndarray:
    """How many ticks' errors are left of those of `span` s where they decay at these rates, 1/s: at least the last one's."""
    slow = decay * span < 1e-6
    kept = np.where(slow, span, -np.expm1(-decay * span) / np.where(slow, 1.0, decay)) / tick_period
    return np.maximum(kept, 1.0)


def _internal_forces(rows: np.ndarray, arms: int) -> np.ndarray:
    """Internal forces in sample rows, (N, arms, 3)."""
    own = rows[:, ARMS : ARMS + PER_ARM * arms].reshape(len(rows), arms, PER_ARM)
    return own[:, :, INTERNAL : INTERNAL + 3]


def warning(estimate: Estimate, scenario: Scenario, time: float) -> str:
    """A sentence once an estimate is beyond its bound, else empty."""
    pose, force = float(np.abs(estimate.pose).max()), float(estimate.force.sum())
    found = []
    if pose > POSE_BOUND:
        found.append(f"the pose may be off by {pose:.1g} m or rad")
    if force > FORCE_BOUND * estimate.peak:
        share = f"{force / estimate.peak:.1g} of its peak" if estimate.peak else f"{force:.1g} N"
        found.append(f"the internal force may be off by {share}")
    if not found:
        return ""
    cause, cure = "errors of the steps add up in modes that ring on", "more damping, fewer elements"
    if scenario.simulation.step is not None:
        cure = "a shorter simulation.step or null"
    return (
        f"Results are no longer accurate since about t = {time:.3f} s: {' and '.join(found)}, as {cause}. "
        f"Reset with {cure}, or a smaller simulation.accuracy."
    )
