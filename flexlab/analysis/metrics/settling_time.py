"""When the vibration has died away: the one definition of lessons, presets, tables, library and Python interface."""

from typing import TYPE_CHECKING, Self

import numpy as np

from flexlab.analysis.metrics.metric import Column, Metric, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples

SHARE = 0.01
"""Share of its peak below which a vibration counts as gone. The paper's "disappears at 0.5 s" is this."""

QUIET = 0.01
"""How long it must have been below when the samples end, s: an oscillation that goes on, at 0.4 Hz or more, crosses zero
faster than that, and does not pass for gone because the end fell on a crossing."""

NOTHING = 1e-9
"""A vibration that never exceeds a nanometre is none, m: it is the integrator's error."""

NOT_SETTLED = "not settled"


@register
class SettlingTime(Metric):
    """Seconds from the first sample to the last one at which |vibration| exceeds `SHARE` of its peak.

    0 without any vibration; NaN if it was above within the last `QUIET` seconds: not settled. The vibration is the
    mid-span deflection less its quasi-static part; where the path itself goes on shaking the beam (a soft beam, a path
    not far below the first mode), that forced part never dies away, and such a run does not settle.
    """

    name, place = "settling_time", 40
    columns = (
        Column("settled", f"Vibration below {SHARE:.0%} after".replace("%", " %"), f"below {100 * SHARE:g} %", "s",
               listed=True, missing=NOT_SETTLED),
    )  # fmt: skip

    # Which share of the final peak an instant reaches is known at the end only. But an instant that is followed by a
    # louder one can never be the last loud one, so few have to be kept: of a ring, its last period.

    def __init__(self) -> None:
        self._first, self._last = np.inf, -np.inf
        self._peak = 0.0
        self._time = np.empty(0)
        self._size = np.empty(0)

    def update(self, samples: "Samples") -> None:
        """Take in a piece of a run."""
        self.add(samples.time, samples.vibration)

    def add(self, time: np.ndarray, signal: np.ndarray) -> None:
        """Take in a signal (N,) at `time` (N,), s, in any order."""
        if len(time) == 0:
            return
        self._first, self._last = min(self._first, float(np.min(time))), max(self._last, float(np.max(time)))
        self._keep(time, np.abs(signal))

    def merge(self, other: Self) -> None:
        """Take in what another one has taken in."""
        self._first, self._last = min(self._first, other._first), max(self._last, other._last)
        self._peak = max(self._peak, other._peak)
        self._keep(other._time, other._size)

    def _keep(self, time: np.ndarray, size: np.ndarray) -> None:
        self._peak = max(self._peak, float(np.max(size, initial=0.0)))
        time, size = np.concatenate([self._time, time]), np.concatenate([self._size, size])
        loud = size > SHARE * self._peak
        order = np.argsort(time[loud], kind="stable")
        time, size = time[loud][order], size[loud][order]
        largest_later = np.maximum.accumulate(np.append(size[1:], -1.0)[::-1])[::-1]
        kept = size > largest_later
        self._time, self._size = time[kept], size[kept]

    def compute(self) -> tuple[float, ...]:
        """Seconds; NaN for a run that has not settled, or has no samples."""
        if self._last < self._first:
            return (np.nan,)
        loud = self._time[self._size > SHARE * self._peak]
        if self._peak < NOTHING or len(loud) == 0:
            return (0.0,)
        settled = self._last - loud[-1] >= QUIET
        return (float(loud[-1] - self._first) if settled else np.nan,)


def settling_time(time: np.ndarray, signal: np.ndarray) -> float:
    """The settling time of a signal (N,) at `time` (N,), s, as the metric defines it; NaN: not settled."""
    metric = SettlingTime()
    metric.add(time, signal)
    return metric.compute()[0]


def settling_text(seconds: float) -> str:
    """A settling time in words."""
    return NOT_SETTLED if np.isnan(seconds) else f"{seconds:.2f} s"
