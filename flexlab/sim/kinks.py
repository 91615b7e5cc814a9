"""Ticks in which the desired motion has a kink: each piece between two kinks is gone with steps of its own.

A step across a jump of the desired velocity or acceleration is of first order, whatever the integrator: kinks have to lie on
steps. They do so by themselves where they are whole ticks; elsewhere such a tick is cut into pieces. A sampled controller
looks at its target at its instants only, and its steps need no cut.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from flexlab.physics.plant import ETA
from flexlab.sim import samples
from flexlab.sim.assembly import Assembly
from flexlab.sim.closed_loop import System, Workspace
from flexlab.sim.integrators.beam_flow import TICKS
from flexlab.sim.step_levels import StepWatch
from flexlab.sim.step_size import build_scheme

SAME_INSTANT = 1e-11
"""s. A kink as close as this to the end of a step or to another kink is there: nothing moves in that time, and no step is so
short that the differences over it are lost in rounding."""


class TickOfKinks(NamedTuple):
    """A tick that is to be gone in pieces."""

    number: int
    cuts: tuple[float, ...]
    """Where its pieces begin and end, s: the tick's own ends included."""


def next_tick_of_kinks(assembly: Assembly, level: int, tick: int, tick_period: float) -> TickOfKinks | None:
    """The first tick from number `tick` on with a kink that lies on no step of this level; None: there is none."""
    kinks = assembly.system.trajectory.kinks
    if assembly.system.control.sampled or not len(kinks) or kinks[-1] <= tick * tick_period:
        return None
    dt = tick_period / (assembly.step_count << level)
    ahead = kinks[kinks > tick * tick_period + SAME_INSTANT]
    off = ahead[np.abs(ahead - np.round(ahead / dt) * dt) > SAME_INSTANT]
    if not len(off):
        return None
    number = int(np.floor(off[0] / tick_period))
    begin, end = number * tick_period, (number + 1) * tick_period
    cuts = [begin]
    for kink in ahead:
        if cuts[-1] + SAME_INSTANT < kink < end - SAME_INSTANT:
            cuts.append(float(kink))
    return TickOfKinks(number, (*cuts, end))


def steps_in(length: float, dt: float) -> int:
    """Steps no longer than `dt` that a piece of this length is gone in, s."""
    return max(1, int(np.ceil(length / dt - 1e-9)))


def advance_in_pieces(
    assembly: Assembly,
    move: Callable[..., Any],
    system: System,
    watch: StepWatch,
    level: int,
    dt: float,
    deflection_limit: float,
    cuts: tuple[float, ...],
    y: np.ndarray,
    ws: Workspace,
    row: np.ndarray,
) -> int:
    """Go one tick in pieces of steps no longer than `dt`, s; fills `row` (1, row length) and returns as code of `advance`.

    `move`: `advance`, or its entry point. With any code but 0, y is that of the tick's beginning.
    """
    start, since = y.copy(), ETA + 2 * system.plant.modal.shape[1] + TICKS
    ticks_before, integrator = y[since], assembly.levels.integrator
    for begin, end in zip(cuts[:-1], cuts[1:], strict=True):
        y[since] = ticks_before
        length = end - begin
        count = steps_in(length, dt)
        scheme = build_scheme(integrator, assembly.beam, length / count)
        _, code = move(
            system, assembly.sampling, *scheme, watch, level, deflection_limit, begin, 0, length, count, y,
            np.empty_like(y), ws, row, False,
        )  # fmt: skip
        if code != 0:
            y[:] = start
            return code
        # The step is that of the whole tick, as its beginning wanted it.
        watch, level = watch._replace(most=0), 0
    row[0, samples.TIME] = cuts[-1]
    return 0
