"""The few numbers by which runs are told apart and compared."""

from dataclasses import dataclass

import numpy as np

from flexlab.analysis.settling import Settling
from flexlab.sim.samples import Samples


@dataclass(frozen=True)
class RunMetrics:
    """Of all samples of a run. SI units; NaN where a run has no samples."""

    duration: float
    """From the first sample to the last, s."""
    rms_error: tuple[float, float, float]
    """Root mean square of e = x - x_d, m, m, rad."""
    peak_error: tuple[float, float, float]
    """Largest |e|, m, m, rad."""
    peak_vibration: float
    """Largest magnitude of the mid-span deflection less its quasi-static part, m."""
    settling_time: float
    """Seconds from the first sample after which |vibration| stays within `SETTLED` of its peak."""
    peak_torque: float
    """Largest magnitude of any joint's torque, N·m."""
    rms_internal_force: float
    """Root mean square of the (x, y) part of the left arm's internal force, N."""
    rms_internal_moment: float
    """Root mean square of its moment, N·m."""


class MetricSums:
    """Gathers the metrics block by block, in any order of blocks, so that hours of a run need no more memory than seconds."""

    def __init__(self) -> None:
        self._count = 0
        self._error_squares = np.zeros(3)
        self._force_squares = np.zeros(3)
        self._error_peak = np.zeros(3)
        self._torque_peak = 0.0
        self._vibration_peak = 0.0
        self._settling = Settling()
        self._first, self._last = np.inf, -np.inf

    def add(self, samples: Samples) -> None:
        """Take in a block."""
        if len(samples) == 0:
            return
        self._count += len(samples)
        self._error_squares += np.sum(samples.tracking_error**2, axis=0)
        self._force_squares += np.sum(samples.internal_force[:, 0] ** 2, axis=0)
        self._error_peak = np.maximum(self._error_peak, np.max(np.abs(samples.tracking_error), axis=0))
        self._torque_peak = max(self._torque_peak, float(np.max(np.abs(samples.joint_torque))))
        vibration = samples.vibration
        self._vibration_peak = max(self._vibration_peak, float(np.max(np.abs(vibration))))
        self._settling.add(samples.time, vibration)
        self._first = min(self._first, float(samples.time[0]))
        self._last = max(self._last, float(samples.time[-1]))

    def result(self) -> RunMetrics:
        """The metrics of all blocks so far."""
        if self._count == 0:
            nothing = (np.nan, np.nan, np.nan)
            return RunMetrics(0.0, nothing, nothing, *[np.nan] * 5)
        force = self._force_squares / self._count
        return RunMetrics(
            duration=self._last - self._first,
            rms_error=_three(np.sqrt(self._error_squares / self._count)),
            peak_error=_three(self._error_peak),
            peak_vibration=self._vibration_peak,
            settling_time=self._settling.result(),
            peak_torque=self._torque_peak,
            rms_internal_force=float(np.sqrt(force[0] + force[1])),
            rms_internal_moment=float(np.sqrt(force[2])),
        )


def run_metrics(samples: Samples) -> RunMetrics:
    """The metrics of a run, or of any piece of one."""
    sums = MetricSums()
    sums.add(samples)
    return sums.result()


def _three(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


@dataclass(frozen=True)
class MetricRow:
    """One line of a table of metrics, in units for people."""

    title: str
    unit: str
    value: float


def metric_rows(metrics: RunMetrics) -> tuple[MetricRow, ...]:
    """All metrics with titles and display units (mm, mrad), in the order of a table."""
    axes = (("x", "mm"), ("y", "mm"), ("θ", "mrad"))
    rms = (MetricRow(f"RMS error {a}", u, 1e3 * v) for (a, u), v in zip(axes, metrics.rms_error, strict=True))
    peak = (MetricRow(f"Peak error {a}", u, 1e3 * v) for (a, u), v in zip(axes, metrics.peak_error, strict=True))
    return (
        MetricRow("Duration", "s", metrics.duration),
        *rms,
        *peak,
        MetricRow("Peak vibration", "mm", 1e3 * metrics.peak_vibration),
        MetricRow("Free vibration gone after", "s", metrics.settling_time),
        MetricRow("Peak joint torque", "N·m", metrics.peak_torque),
        MetricRow("RMS internal force", "N", metrics.rms_internal_force),
        MetricRow("RMS internal moment", "N·m", metrics.rms_internal_moment),
    )
