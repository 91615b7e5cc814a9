"""B7: ten minutes with noise: whether what a law has learnt drifts."""

from typing import Self

import numpy as np

from flexlab.analysis.leaderboard.case import Case, Variant
from flexlab.analysis.leaderboard.cases.b5_real_hardware import HARDWARE
from flexlab.analysis.leaderboard.score import Score, largest_vibration, peak_torque, rms_error
from flexlab.analysis.metrics import Column, Metric
from flexlab.analysis.metrics.run_metrics import Window
from flexlab.sim.samples import Samples

DURATION = 600.0
"""s."""
SETTLED, END = 60.0, 540.0
"""s: from when on a drift is one, and the last minute."""
LEAKAGE = 0.1
"""1/s: forgets within ten seconds."""


class BoundDrift(Metric):
    """Slope of the straight line through the bound b̂ᵀ(1, ‖x‖, ‖ẋ‖²), N/s."""

    name, place = "bound_drift", 0
    columns = (Column("drift", "Drift of the learnt bound", "drift", "N/min", 60.0),)

    def __init__(self) -> None:
        self._sums = np.zeros(5)

    def update(self, samples: Samples) -> None:
        """Take in a piece of a run."""
        size = np.linalg.norm(samples.pose, axis=1)
        speed = np.linalg.norm(samples.pose_rate, axis=1)
        bound = np.sum(samples.bound_estimates * np.stack([np.ones_like(size), size, speed**2], axis=1), axis=1)
        t = samples.time
        self._sums += [len(t), t.sum(), bound.sum(), (t * t).sum(), (t * bound).sum()]

    def merge(self, other: Self) -> None:
        """Take in what another one has taken in."""
        self._sums += other._sums

    def compute(self) -> tuple[float, ...]:
        """N/s."""
        count, t, bound, tt, t_bound = self._sums
        spread = count * tt - t * t
        return ((count * t_bound - t * bound) / spread if spread > 0 else np.nan,)


def drift(window: Window) -> Score:
    """How fast b̂ grows."""
    formula = f"slope of b̂ᵀ(1, ‖x‖, ‖ẋ‖²) over t, least squares, t ≥ {window[0]:g} s"
    return Score(BoundDrift.columns[0], formula, BoundDrift, window=window)


LAST = (END, DURATION)
CASE = Case(
    "B7",
    "Ten minutes",
    f"B5's clock, delay, limits and noise for {DURATION:g} s; once more with the leakage σ = {LEAKAGE:g} 1/s for laws that learn "
    "the bound b̂. Ten minutes of each law take a minute or so of a processor: only with --long.",
    DURATION,
    (rms_error(LAST), drift((SETTLED, DURATION)), largest_vibration(LAST), peak_torque(LAST)),
    HARDWARE,
    (Variant("σ as it is"), Variant(f"σ = {LEAKAGE:g} 1/s", law_fields={"leakage": LEAKAGE})),
    long=True,
)
