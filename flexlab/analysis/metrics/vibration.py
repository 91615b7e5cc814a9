"""Metrics of the vibration: its settling time, by one definition for lessons, tables and Python, and the rest after a stop."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, Metric, maxima, outlasting, register
from flexlab.analysis.metrics.run_metrics import ROUNDING

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples

SHARE = 0.01
"""Share of its peak below which a vibration counts as gone, as in the paper's "disappears at 0.5 s"."""
QUIET = 0.01
"""Least time below this share at the end of the samples, s."""
LONGER = 2.0
"""Least ratio of that time to the longest earlier pause below the share: an oscillation also pauses at each zero crossing."""
AGAIN, NEAR = 4.0, 0.02
"""A pause ends with a new excitation, such as a tap, if the peak within NEAR s after it is at least AGAIN times the peak within
NEAR s before it; earlier pauses then do not count."""
FINEST, MOST_PIECES = 0.0025, 4000
"""Shortest piece of time whose peak is kept, s, and most pieces; pieces double in length if a run has more."""
LASTING = 0.5
"""Least ratio of the smallest to the largest deflection at the end with which a beam counts as bent and not as vibrating."""
PARTS, KEEPS = 3, 0.8
"""Number of parts of an unsettled run whose peaks are compared; ratio of the last two from which there is no decay."""
FOLLOWS = 0.2
"""Largest error over the range of the desired motion with which a payload counts as following its path."""
STARTED = 1.0
"""Duration, s, from which a payload may count as off its path: at first it catches up with a path that already moves."""
NOTHING = 1e-9
"""Largest vibration that may be the integrator's error, m."""
NOT_SETTLED, NOT_RECORDED = "not settled", "not recorded"


@register
class SettlingTime(Metric):
    """Seconds from the first sample to the last one at which |vibration| exceeds `SHARE` of its peak.

    0 without any vibration. NaN, not settled, unless it stays below at the end for `QUIET` seconds, and for `LONGER` times its
    longest pause below since it was last excited. The vibration is the mid-span deflection less its quasi-static part; if the
    path itself goes on shaking the beam (a soft beam, a path not far below the first mode), that forced part never dies away,
    and the run does not settle. Nor does a payload that does not follow its path: it bends as its own motion demands.
    """

    name, place = "settling_time", 40
    columns = (
        Column("settled", f"Vibration below {SHARE:.0%} after".replace("%", " %"), f"below {100 * SHARE:g} %", "s",
               listed=True, missing=NOT_SETTLED),
    )  # fmt: skip

    # The final peak, and so the share that a sample reaches, is known only at the end. But a sample that is followed by a
    # louder one can never be the last loud one, so few have to be kept: of a ring, its last period.

    def __init__(self) -> None:
        self._first, self._last = np.inf, -np.inf
        self._peak, self._is_recorded = 0.0, False
        self._error, self._low, self._high = 0.0, np.full(2, np.inf), np.full(2, -np.inf)
        """Largest tracking error, and range of the desired x and y, m."""
        self._time = np.empty(0)
        self._size = np.empty(0)
        self._piece = FINEST
        self._places, self._extremes = np.empty(0, np.int64), np.empty((2, 0))
        """Indices of the pieces of time so far, and the largest signal and its largest negative in each."""

    def update(self, samples: "Samples") -> None:
        """Take in the next piece of a run."""
        desired = samples.desired_pose[:, :2]
        self._error = max(self._error, float(np.abs(samples.tracking_error[:, :2]).max()))
        self._low, self._high = np.minimum(self._low, -maxima(-desired)), np.maximum(self._high, maxima(desired))
        self.add(samples.time, samples.vibration)

    def add(self, time: np.ndarray, signal: np.ndarray) -> None:
        """Take in the next piece of a signal (N,) at `time` (N,), s, rising."""
        if len(time) == 0:
            return
        self._is_recorded |= not np.isnan(signal).all()
        signal = np.nan_to_num(signal)  # NaN: not recorded.
        size = np.abs(signal)
        self._first, self._last = min(self._first, float(time[0])), float(time[-1])
        self._peak = max(self._peak, float(np.max(size)))
        places = np.concatenate([self._places, np.floor(time / self._piece).astype(np.int64)])
        self._places, self._extremes = _gathered(places, np.hstack([self._extremes, [signal, -signal]]))
        while len(self._places) > MOST_PIECES:
            self._piece *= 2
            self._places, self._extremes = _gathered(self._places // 2, self._extremes)
        time, size = np.concatenate([self._time, time]), np.concatenate([self._size, size])
        loud = size > SHARE * self._peak
        self._time, self._size = outlasting(time[loud], size[loud])

    def _longest_pause(self) -> float:
        """The longest pause between two times above the share since the last excitation, s."""
        sizes = self._extremes.max(axis=0)
        loud = sizes > SHARE * self._peak
        places, sizes = self._places[loud], sizes[loud]
        near, longest = max(1, round(NEAR / self._piece)), 0
        for at in reversed(np.flatnonzero(np.diff(places) > 1)):
            before = sizes[: at + 1][places[: at + 1] > places[at] - near].max()
            after = sizes[at + 1 :][places[at + 1 :] < places[at + 1] + near].max()
            if after >= AGAIN * before:
                break
            longest = max(longest, int(places[at + 1] - places[at]) - 1)
        return longest * self._piece

    def compute(self) -> tuple[float, ...]:
        """Seconds; NaN for a run that has not settled, or has no samples, or none of its vibration."""
        if self._last < self._first or not self._is_recorded:
            return (np.nan,)
        loud = self._time[self._size > SHARE * self._peak]
        if self._peak < NOTHING or len(loud) == 0:
            return (0.0,)
        settled = self._last - loud[-1] >= max(QUIET, LONGER * self._piece, LONGER * self._longest_pause())
        return (float(loud[-1] - self._first) if settled else np.nan,)

    def reason(self) -> str:
        """Why a vibration has not settled, and its share of the peak at the end."""
        if self._last <= self._first or not np.isnan(self.compute()[0]):
            return ""
        if not self._is_recorded:
            return NOT_RECORDED
        part = (self._last - self._first) / PARTS
        parts = [self._within(self._last - count * part, self._last - (count - 1) * part) for count in (3, 2, 1)]
        first, before, last = (float(part.max(initial=0.0)) for part in parts)
        # A tap or a change near the end says nothing of what follows; a vibration that grows did so before, too.
        is_new = last >= AGAIN * before and before <= AGAIN * first
        goes_on = last >= KEEPS * before and not is_new
        bends = -parts[-1].max(axis=1, initial=-np.inf).min() > LASTING * last  # It never comes near the other side.
        lasts = "does not settle: the beam stays bent" if bends else "does not settle: forced or undamped"
        found = lasts if goes_on else "not settled: still"
        strays = self._error > FOLLOWS * (self._high - self._low).max() > 0
        if goes_on and strays and self._last - self._first >= STARTED:
            found = "does not settle: the payload is off its path; vibration"
        return f"{found} at {100 * last / self._peak:.3g} %"

    def _within(self, first: float, last: float) -> np.ndarray:
        """The extremes (2, pieces) from `first` to `last`, s, rounded to pieces of time."""
        within = (first <= (self._places + 1) * self._piece) & (self._places * self._piece <= last)
        return self._extremes[:, within]


def _gathered(places: np.ndarray, extremes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each of the rising indices once, and the largest of its extremes (2, N)."""
    firsts = np.flatnonzero(np.diff(places, prepend=places[0] - 1))
    return places[firsts], np.maximum.reduceat(extremes, firsts, axis=1)


def settling_time(time: np.ndarray, signal: np.ndarray) -> float:
    """The settling time, s, of a signal (N,) at `time` (N,), s, as the metric defines it; NaN if not settled."""
    metric = SettlingTime()
    metric.add(time, signal)
    return metric.compute()[0]


LATER = 0.2
"""Time after the stop from which the second number counts, s, as if the next move waited that long."""
STOPPED = 0.01
"""Time for which the target must stand still at the end of the samples, s, so that a turning point is not a stop."""


@register
class ResidualVibration(Metric):
    """Largest |vibration| after the last instant at which the desired pose moved, and from `LATER` s after it on, m.

    NaN if the target never moved or has not stopped, or if the vibration is not recorded, which is the mid-span deflection less
    its quasi-static part.
    """

    name, place = "residual_vibration", 35
    columns = (
        Column("residual", "Residual vibration after the stop", "residual", "mm", 1e3, part="stop"),
        Column(
            "residual-later",
            f"Residual vibration {LATER:g} s after the stop",
            f"residual {LATER:g} s",
            "mm",
            1e3,
            part="later",
        ),
    )

    # A sample that is followed by a louder one can never be the loudest after the stop, so few have to be kept.
    # The target stands still from the sample after its last motion on: one still sample alone is not a stop.

    def __init__(self) -> None:
        self._last, self._pose = -np.inf, np.full(3, np.nan)
        self._moved = self._stands = -np.inf
        self._time = np.empty(0)
        self._size = np.empty(0)

    def update(self, samples: "Samples") -> None:
        """Take in the next piece of a run."""
        time, pose = samples.time, np.array(samples.desired_pose[-1])
        moving = np.flatnonzero(np.any(samples.desired_pose != pose, axis=1))
        if len(moving):
            # A measurement has no target: NaN never equals itself, so that it seems to move up to the last sample.
            stands = min(moving[-1] + 1, len(time) - 1)
            self._moved, self._stands = float(time[moving[-1]]), float(time[stands])
        elif not np.array_equal(self._pose, pose):  # The target has moved since the piece before, if there was one.
            self._moved, self._stands = self._last, float(time[0])
        self._last, self._pose = float(time[-1]), pose
        size = np.nan_to_num(np.abs(samples.vibration), nan=np.inf)  # NaN, not recorded, may have been any size.
        time, size = np.concatenate([self._time, time]), np.concatenate([self._size, size])
        after = time > self._moved
        self._time, self._size = outlasting(time[after], size[after])

    @property
    def stop(self) -> float:
        """Last instant at which the target moved, s; NaN if it never moved or has not stopped."""
        stopped = np.isfinite(self._moved) and self._last - self._stands >= STOPPED - ROUNDING
        return self._moved if stopped else np.nan

    def compute(self) -> tuple[float, ...]:
        """Largest |vibration| after the stop and later, m."""
        return self._after(self.stop), self._after(self.stop + LATER)

    def _after(self, time: float) -> float:
        largest = float(np.max(self._size[self._time > time], initial=0.0)) if self._last > time else np.nan
        return largest if largest < np.inf else np.nan
