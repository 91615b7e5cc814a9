"""Input shapers: a few impulses with which a motion is convolved, so that the vibrations that its copies leave cancel.

For a mode of frequency ω, rad/s, and damping ratio ζ: k = exp(-ζπ/√(1-ζ²)), T_d = 2π/(ω√(1-ζ²)). Amplitudes add up to 1, so
the motion ends where it would; it ends later by the last impulse's time. Singer & Seering, J. Dyn. Sys. Meas. Control
112(1), 1990; Singhose, Seering & Singer, J. Mech. Design 116(2), 1994 (extra-insensitive).
"""

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from flexlab.numerics.elementary import exp

Shaper = Literal["none", "zv", "zvd", "ei-shaper"]
"""By name: zero vibration, the same with zero derivative, extra-insensitive."""

TOLERATED = 0.05
"""V: share of the unshaped vibration that the extra-insensitive shaper leaves at ω, for a band twice as wide."""

_AMPLITUDES: dict[str, Callable[[float], list[float]]] = {
    "none": lambda k: [],
    "zv": lambda k: [1.0, k],
    "zvd": lambda k: [1.0, 2 * k, k * k],
    "ei-shaper": lambda k: [(1 + TOLERATED) / 4, (1 - TOLERATED) * k / 2, (1 + TOLERATED) * k * k / 4],
}
"""Shaper → relative amplitudes of its impulses, half a period T_d apart."""


def impulses(shaper: str, omega: float, zeta: float) -> np.ndarray:
    """A_j, 1, and t_j, s, of a shaper for a mode of ω rad/s and damping ratio ζ in [0, 1), (impulses, 2)."""
    root = math.sqrt(1 - zeta * zeta)
    amplitudes = np.array(_AMPLITUDES[shaper](float(exp(-zeta * np.pi / root))))
    times = np.arange(len(amplitudes)) * np.pi / (omega * root)
    return np.stack([amplitudes / amplitudes.sum(), times], axis=1) if len(amplitudes) else np.zeros((0, 2))


def residual(shaped: np.ndarray, omega: float) -> float:
    """Vibration that impulses (k, 2) leave in an undamped mode of ω rad/s, as a share of that of one impulse, 1."""
    return float(abs(np.sum(shaped[:, 0] * np.exp(1j * omega * shaped[:, 1]))))
