"""The residual vibration of the beam after a motion has stopped."""

from typing import TYPE_CHECKING, Self

import numpy as np

from flexlab.analysis.metrics.metric import Column, Metric, outlasting, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples

LATER = 0.2
"""Time after the stop from which the second number counts, s, as for a next move that waits."""
STOPPED = 0.01
"""Time for which the target must stand still at the end of the samples, s, so that a turning point is no stop."""
ROUNDING = 1e-9
"""Tolerance of that time, s, as sample instants are products of whole numbers and periods."""


@register
class ResidualVibration(Metric):
    """Largest |vibration| after the last instant at which the desired pose moved, and from `LATER` s after it on, m.

    NaN of a target that never moved, or has not stopped. The vibration is the mid-span deflection less its quasi-static part.
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

    # Samples that a louder one follows can never be the loudest after the stop, whenever that was: few have to be kept.
    # A target is seen to stand from the sample after its last motion on: one still sample alone is no stop.

    def __init__(self) -> None:
        self._first, self._last, self._end = np.inf, -np.inf, np.full(3, np.nan)
        self._step = np.inf
        self._moved = -np.inf
        self._time = np.empty(0)
        self._size = np.empty(0)

    def update(self, samples: "Samples") -> None:
        """Take in a piece of a run."""
        piece = ResidualVibration()
        latest = int(np.argmax(samples.time))
        piece._first, piece._last = float(np.min(samples.time)), float(samples.time[latest])
        piece._end = np.array(samples.desired_pose[latest])
        piece._step = _shortest_step(samples.time)
        elsewhere = np.any(samples.desired_pose != piece._end, axis=1)
        piece._moved = float(np.max(samples.time[elsewhere], initial=-np.inf))
        piece._keep(samples.time, np.abs(samples.vibration))
        self.merge(piece)

    def merge(self, other: Self) -> None:
        """Take in what another one has taken in."""
        early, late = sorted((self, other), key=lambda one: one._last)
        same = np.array_equal(early._end, late._end)
        # Where the earlier one stood at another pose, the target has moved since.
        moved = max(late._moved, early._moved if same else early._last)
        time, size = np.concatenate([early._time, late._time]), np.concatenate([early._size, late._size])
        ends = np.array([early._first, early._last, late._first, late._last])
        self._step = min(self._step, other._step, _shortest_step(ends[np.isfinite(ends)]))
        self._first, self._last = min(early._first, late._first), late._last
        self._end, self._moved = late._end, moved
        self._keep(time, size)

    def _keep(self, time: np.ndarray, size: np.ndarray) -> None:
        after = time > self._moved
        self._time, self._size = outlasting(time[after], size[after])

    def compute(self) -> tuple[float, ...]:
        """Largest |vibration| after the stop and later, m."""
        if not np.isfinite(self._moved) or self._last - (self._moved + self._step) < STOPPED - ROUNDING:
            return np.nan, np.nan
        return self._after(self._moved), self._after(self._moved + LATER)

    def _after(self, time: float) -> float:
        return float(np.max(self._size[self._time > time], initial=0.0)) if self._last > time else np.nan


def _shortest_step(instants: np.ndarray) -> float:
    """The shortest time between two different instants, s; infinite without any."""
    steps = np.diff(np.sort(instants))
    return float(np.min(steps[steps > 0], initial=np.inf))
