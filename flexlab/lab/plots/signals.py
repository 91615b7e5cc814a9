"""Which signals the plots show, in which units."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexlab.lab import colors
from flexlab.sim.samples import Samples

MILLI = 1e3
"""m to mm, rad to mrad."""


@dataclass(frozen=True)
class Plot:
    """One plot: `labels` with units, one per signal; `values` gives (signals, N) in those units.

    `least`: the smallest vertical range, in the plot's units; below it there is nothing worth magnifying.
    """

    title: str
    labels: tuple[str, ...]
    tones: tuple[colors.Color, ...]
    values: Callable[[Samples], np.ndarray]
    least: float


def _error(samples: Samples) -> np.ndarray:
    return MILLI * samples.tracking_error.T


def _deflection(samples: Samples) -> np.ndarray:
    return MILLI * np.stack([samples.vibration, samples.quasi_static_deflection])


def _internal_force(samples: Samples) -> np.ndarray:
    return samples.internal_force[:, 0].T


PLOTS: tuple[Plot, ...] = (
    Plot(
        "Tracking error",
        ("x (mm)", "y (mm)", "θ (mrad)"),
        (colors.LIGHT_BLUE, colors.VERMILION, colors.GREEN),
        _error,
        0.1,
    ),
    Plot(
        "Mid-span deflection, true size",
        ("vibration (mm)", "quasi-static (mm)"),
        (colors.VERMILION, colors.LIGHT_BLUE),
        _deflection,
        0.01,
    ),
    Plot(
        "Internal force, left arm",
        ("Fx (N)", "Fy (N)", "M (N·m)"),
        (colors.LIGHT_BLUE, colors.VERMILION, colors.GREEN),
        _internal_force,
        1.0,
    ),
)
