"""States between two samples, for slow motion: what is drawn moves smoothly although samples are a millisecond apart."""

import numpy as np

from flexlab.sim.samples import Samples


def interpolate(before: Samples, after: Samples, fraction: float) -> Samples:
    """The state at `fraction` in [0, 1] of the way between two samples (N = 1 each).

    Pose and beam follow cubic Hermite curves through positions and rates, the rest straight lines.
    """
    if fraction >= 1 or len(before) == 0 or before.beam_coordinates.shape != after.beam_coordinates.shape:
        return after
    signals = {}
    earlier, later = before.signals(), after.signals()
    for name, b in later.items():
        a = earlier.get(name, b)
        signals[name] = a + fraction * (b - a)
    span = float(after.time[0] - before.time[0])
    for position, rate in (("pose", "pose_rate"), ("beam_coordinates", "beam_rates")):
        ends = [getattr(sample, name) for sample in (before, after) for name in (position, rate)]
        signals[position] = _hermite(*ends, span, fraction)
    for signal in signals.values():
        signal.flags.writeable = False
    return Samples(**signals)


def _hermite(
    x0: np.ndarray, v0: np.ndarray, x1: np.ndarray, v1: np.ndarray, span: float, fraction: float
) -> np.ndarray:
    f, g = fraction, 1 - fraction
    return g * g * (1 + 2 * f) * x0 + f * f * (1 + 2 * g) * x1 + span * f * g * (g * v0 - f * v1)
