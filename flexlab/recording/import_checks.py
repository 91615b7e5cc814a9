"""What a run from elsewhere must hold before it is taken in: everything later relies on it."""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from flexlab.errors import RecordingError
from flexlab.plain_text import visible
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import LONGEST_PERIOD, SHORTEST_PERIOD, Event

LAST_TIME = 1e9
"""s, either way: 32 years; rerun counts nanoseconds in 64 bits."""
ROUNDING = 1e-6
"""Relative: a period that was told from two times is not exact."""
LEVELS = ("info", "warning", "error")
LONGEST_EVENT = 10_000
"""Characters of one event's text."""


def checked_blocks(name: str, blocks: Iterable[Samples]) -> Iterator[Samples]:
    """The blocks of the file `name`, as long as their times are finite and rising. Raises `RecordingError`."""
    rows, last = 0, -math.inf
    for block in blocks:
        check_times(name, block.time, rows, last)
        if len(block):
            rows, last = rows + len(block), float(block.time[-1])
        yield block


def check_times(name: str, time: np.ndarray, before: int = 0, last: float = -math.inf) -> None:
    """Look whether times in s are finite and rising. `before`: rows ahead of them, of which `last` was the time of the last.

    Raises `RecordingError`, which counts rows from 1.
    """
    usable = np.abs(time) <= LAST_TIME  # False for NaN too.
    with np.errstate(invalid="ignore"):  # The difference of two infinities is told by `usable`.
        rising = np.diff(time, prepend=last) > 0 if len(time) else usable
    wrong = np.flatnonzero(~(usable & rising))
    if not len(wrong):
        return
    row = int(wrong[0])
    where, value = f"{name}, row {before + row + 1}: time = {time[row]:.12g} s", float(time[row])
    if not usable[row]:
        reason = "is not finite" if not math.isfinite(value) else f"is beyond ±{LAST_TIME:g} s"
        raise RecordingError(f"{where} {reason}: give every row a time in s, each later than the one before.")
    earlier = last if row == 0 else float(time[row - 1])
    raise RecordingError(f"{where} is not later than the {earlier:.12g} s of the row before: sort the rows by time.")


def check_period(name: str, period: object) -> float:
    """The sample period in s. Raises `RecordingError` for one that no run can have."""
    value = period if isinstance(period, (int, float)) and not isinstance(period, bool) else math.nan
    if not (1 - ROUNDING) * SHORTEST_PERIOD <= value <= (1 + ROUNDING) * LONGEST_PERIOD:
        allowed = f"{SHORTEST_PERIOD:g} to {LONGEST_PERIOD:g} s"
        shown = visible(repr(period), 40)
        raise RecordingError(f"{name}: the sample period {shown} s is not usable: it must be {allowed}.")
    return float(value)


def check_events(name: str, events: Iterable[Event]) -> None:
    """Look whether every event can be shown and replayed. Raises `RecordingError`, which counts events from 1."""
    for number, event in enumerate(events, 1):
        where = f"{name}, event {number}"
        if not isinstance(event.time, (int, float)) or not abs(event.time) <= LAST_TIME:
            shown = visible(repr(event.time), 40)
            raise RecordingError(f"{where}: time = {shown} s is not a finite time within ±{LAST_TIME:g} s.")
        if event.level not in LEVELS:
            raise RecordingError(f"{where}: level {visible(repr(event.level), 40)} is not one of {', '.join(LEVELS)}.")
        if len(event.text) > LONGEST_EVENT:
            raise RecordingError(f"{where}: its text has {len(event.text)} characters, over {LONGEST_EVENT}.")
