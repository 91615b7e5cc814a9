"""What a score is: a metric over a window of a run, with its formula. Less is better."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, nan

import numpy as np

from flexlab.analysis.metrics import Column, Metric
from flexlab.analysis.metrics.metric import Peak, RootMeanSquare
from flexlab.analysis.metrics.peak_torque import PeakTorque
from flexlab.analysis.metrics.peak_vibration import PeakVibration
from flexlab.analysis.metrics.residual_vibration import LATER, ResidualVibration
from flexlab.analysis.metrics.rms_internal_force import RmsInternalForce
from flexlab.analysis.metrics.run_metrics import Window, between, value_text
from flexlab.analysis.metrics.settling_time import SettlingTime
from flexlab.sim.samples import Samples

ALWAYS: Window = (-inf, inf)


@dataclass(frozen=True)
class Score:
    """One number about a run by which laws are compared."""

    column: Column
    """Short name, title, heading, unit; the number is kept in SI units."""
    formula: str
    metric: Callable[[], Metric]
    number: int = 0
    """Which of the metric's numbers."""
    window: Window = ALWAYS
    """Which samples count, s."""
    floor: float = 1e-9
    """Less than this counts as this where laws are compared, SI: a nanometre is the integrator's error."""

    @property
    def name(self) -> str:
        """In tables for programs."""
        return self.column.field

    def text(self, value: float | None) -> str:
        """A value (SI, None: there is none) with four digits in its unit, or the word that stands for a missing one."""
        return value_text(self.column, nan if value is None else self.column.scale * value)


class Tally:
    """The scores of a run, gathered in pieces."""

    def __init__(self, scores: tuple[Score, ...]):
        self._parts = [(score, score.metric()) for score in scores]

    def update(self, samples: Samples) -> None:
        """Take in the next piece."""
        for score, metric in self._parts:
            piece = between(samples, *score.window)
            if len(piece):
                metric.update(piece)

    def compute(self) -> dict[str, float | None]:
        """SI, by the scores' names; None where there is no number."""
        values = {score.name: float(metric.compute()[score.number]) for score, metric in self._parts}
        return {name: value if np.isfinite(value) else None for name, value in values.items()}


class PeakPositionError(Peak):
    """Largest √(e_x² + e_y²), m."""

    name, place = "peak_position_error", 0
    columns = (Column("peak", "Peak position error", "peak error", "mm", 1e3),)

    def signal(self, samples: Samples) -> np.ndarray:
        """(N, 1)."""
        return _position_error(samples)


class RmsPositionError(RootMeanSquare):
    """Root mean square of √(e_x² + e_y²), m."""

    name, place = "rms_position_error", 0
    columns = (Column("rms", "RMS position error", "RMS error", "mm", 1e3),)

    def signal(self, samples: Samples) -> np.ndarray:
        """(N, 1)."""
        return _position_error(samples)


def _position_error(samples: Samples) -> np.ndarray:
    return np.hypot(samples.tracking_error[:, 0], samples.tracking_error[:, 1])[:, None]


def since(window: Window) -> str:
    """A window as a formula ends."""
    first, last = window
    if first == -inf:
        return ""
    return f", t ≥ {first:g} s" if last == inf else f", {first:g} s ≤ t ≤ {last:g} s"


def peak_error(window: Window = ALWAYS) -> Score:
    """max √(e_x² + e_y²)."""
    return Score(PeakPositionError.columns[0], f"max √(e_x² + e_y²){since(window)}", PeakPositionError, window=window)


def rms_error(window: Window = ALWAYS) -> Score:
    """√(mean(e_x² + e_y²))."""
    return Score(RmsPositionError.columns[0], f"√(mean(e_x² + e_y²)){since(window)}", RmsPositionError, window=window)


def largest_vibration(window: Window) -> Score:
    """max |w(0, t) - its quasi-static part|."""
    column = Column("vibration", "Largest vibration", "vibration", "µm", 1e6)
    return Score(column, f"max |w − w_qs| at mid-span{since(window)}", PeakVibration, window=window)


def residual(later: bool = True) -> Score:
    """What rings after the target has stopped, at once or `LATER` s after it."""
    title = f"Residual vibration {LATER:g} s after the stop" if later else "Residual vibration after the stop"
    column = Column("residual-later" if later else "residual", title, "residual", "µm", 1e6)
    time = f"T + {LATER:g} s" if later else "T"
    return Score(column, f"max |w − w_qs| at mid-span, t > {time}, T: the stop", ResidualVibration, int(later))


def settled(window: Window = ALWAYS) -> Score:
    """How long the vibration stays above a hundredth of its peak."""
    formula = f"last t with |w − w_qs| > 1 % of its peak{since(window)}"
    return Score(SettlingTime.columns[0], formula, SettlingTime, window=window, floor=1e-3)


def peak_torque(window: Window = ALWAYS) -> Score:
    """max |τ| of all joints."""
    return Score(PeakTorque.columns[0], f"max |τ| of any joint{since(window)}", PeakTorque, window=window)


def internal_force(window: Window = ALWAYS) -> Score:
    """RMS of the force by which the arms press against each other."""
    return Score(RmsInternalForce.columns[0], f"√(mean(F_1x² + F_1y²)){since(window)}", RmsInternalForce, window=window)
