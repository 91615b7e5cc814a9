"""How signals are plotted: their groups, names, units and colours; and how much the deflection is exaggerated in drawings.

The lab's plots and a recording's curves and texts follow from these rows; the table of signals says what each signal means.
Signals of a law, and those that the table calls `plotted`, get a view each. Views use convenient units (mm, mrad); recordings
also hold all signals in SI units.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexlab.guide import HIGHEST_EXAGGERATION
from flexlab.scenario import Scenario
from flexlab.signal import Signal
from flexlab.sim.samples import Samples
from flexlab.sim.signals import DERIVED, TABLE, own_signals

Color = tuple[int, int, int]
BLUE, VERMILION, GREEN = (0, 114, 178), (213, 94, 0), (0, 158, 115)
PURPLE, ORANGE, SKY, GRAY = (204, 121, 167), (230, 159, 0), (86, 180, 233), (128, 134, 142)
"""Okabe and Ito's palette (RGB), distinguishable with any colour vision."""
VIOLET, OLIVE, ROSE = (142, 98, 218), (140, 138, 20), (214, 84, 120)
CURVES = (VIOLET, OLIVE, ROSE)
"""Colours of the curves of x, y and θ, and of any other first three curves; none is an arm's colour or the beam's."""
LEFT, RIGHT = (BLUE, (38, 150, 170), (104, 112, 220)), (VERMILION, (176, 128, 10), (206, 72, 112))
"""Colours of the left and of the right arm's three curves: the arm's colour and two near it."""
OWN = "own/"
"""Prefix of a law's own signals in recordings."""
LEAST_OWN = 1e-6
"""Smallest axis range of a law's own signal, whose magnitude is not known beforehand."""
USUAL_FACTOR, USUAL_BENDING = 50.0, 3.6e-4
"""The factor that suits the paper's beam, and that beam's usual bending as a fraction of its length."""
SOFTER_BENDS_MORE = 0.25
"""Exponent with which the drawn bending grows with the true one: a softer beam looks more bent, but not wildly."""
FACTOR_DIGITS = 2
"""Significant digits of a factor that flexlab chooses."""


def css(color: Color) -> str:
    """A colour in CSS notation, "#rrggbb"."""
    return "#" + bytes(color).hex()


@dataclass(frozen=True)
class View:
    """Curves of one plot."""

    entity: str
    """The curves' entity in a recording."""
    title: str
    signals: tuple[Signal, ...]
    """The curves are the numbers of these signals, one signal after the other, the left arm's first."""
    curves: tuple[str, ...]
    """Name of each curve; further numbers of the signals are not shown."""
    units: tuple[str, ...]
    """Unit of each curve, as shown."""
    scale: float = 1.0
    """Shown number over SI number."""
    least: float = 1.0
    """Smallest range of the plot's axis, in its unit."""
    palette: tuple[Color, ...] = (*CURVES, GREEN, BLUE, VERMILION)
    """Colours of the curves, repeated if there are more curves."""
    beside: str = ""
    """Further explanation."""

    @property
    def names(self) -> tuple[str, ...]:
        """Curves with their units."""
        return tuple(f"{curve} ({unit})" for curve, unit in zip(self.curves, self.units, strict=True))

    @property
    def colors(self) -> tuple[Color, ...]:
        """Colour of each curve."""
        return tuple(self.palette[number % len(self.palette)] for number in range(len(self.curves)))

    @property
    def meaning(self) -> str:
        """Symbol, meaning, equation and SI unit of each signal, and the units shown."""
        shown = f"; here in {' and '.join(dict.fromkeys(self.units))}" if self.scale != 1 else ""
        return " ".join(f"{_about(signal)}{shown}." for signal in self.signals) + self.beside

    def values(self, samples: Samples, precision: type[np.floating] = np.float64) -> np.ndarray:
        """(N, curves), in the units shown and in this precision; NaN for signals that these samples lack."""
        shown = np.empty((len(samples), len(self.curves)), precision)
        if self.entity.startswith(OWN) and self.signals[0].name not in samples.own:
            shown.fill(np.nan)
            return shown
        first = 0
        for signal in self.signals:
            array = samples[signal.name]
            numbers = array.reshape(len(array), math.prod(array.shape[1:]))[:, : len(self.curves) - first]
            last = first + numbers.shape[1]
            np.multiply(self.scale, numbers, out=shown[:, first:last], casting="same_kind")
            first = last
        return shown[:, :first]


def _about(signal: Signal) -> str:
    source = f" ({signal.equation})" if signal.equation else ""
    return f"{signal.symbol}: {signal.meaning}{source}, in {signal.unit_text}"


def _view(entity: str, title: str, curves: str, units: str, signals: str = "", **how: Any) -> View:
    """A view of curves; their names, units (or one for all) and signals are separated by commas."""
    each, unit = tuple(curves.split(", ")), tuple(units.split(", "))
    shown = tuple({**TABLE, **DERIVED}[name] for name in signals.split(", ") if name)
    return View(entity, title, shown, each, unit * (len(each) // len(unit)), **how)


MILLI, PERCENT = 1e3, 100.0
ERROR = _view("error", "Tracking error", "x, y, θ", "mm, mm, mrad", "tracking_error", scale=MILLI, least=0.1)
DEFLECTION = _view(
    "vibration", "Mid-span deflection, true size", "vibration, deflection, quasi-static", "mm",
    "vibration, midspan_deflection, quasi_static_deflection", scale=MILLI, least=0.01, palette=(VIOLET, GREEN, OLIVE),
)  # fmt: skip
INTERNAL_FORCE = _view(
    "internal_force", "Internal force, left arm", "Fx, Fy, M", "N, N, N·m", "internal_force",
    beside=" It only squeezes and bends; the right arm's is equal and opposite.",
)  # fmt: skip
TORQUES = tuple(
    _view("joint_torque", "Joint torques", curves, "N·m", "joint_torque", palette=(*LEFT, *RIGHT))
    for curves in ("left τ₁, left τ₂, left τ₃", "left τ₁, left τ₂, left τ₃, right τ₁, right τ₂, right τ₃")
)
"""For one arm and for two."""
SLIDING = _view("sliding_variable", "Sliding variable s", "x, y, θ", "m/s, m/s, rad/s", "sliding_variable", least=0.01)
ESTIMATES = _view(
    "bound_estimates", "Bound estimates b̂", "b̂₀, b̂₁, b̂₂", "N, N/m, N·s²/m²", "bound_estimates", least=0.01
)
ENERGIES = _view(
    "energy", "Energy of arms and payload",
    "kinetic, elastic, weight, total, work put in, work of the axial load, damped away", "J",
    "kinetic_energy, elastic_energy, gravity_energy, total_energy, input_work, axial_work, dissipated_energy",
    palette=(VIOLET, GREEN, OLIVE, ROSE, ORANGE, SKY, GRAY),
)  # fmt: skip
ELASTIC = _view(
    "elastic_energy", "Elastic energy", "elastic", "mJ", "elastic_energy", scale=MILLI, least=0.01, palette=(GREEN,)
)
"""The elastic energy has its own plot: beside the other energies it would be a line at zero."""
AXIAL_LOAD = _view("axial_load", "Axial load", "place 1, place 2, place 3, place 4", "N", "axial_load")
AXIAL_SHARE = _view(
    "axial_load_share", "Axial load beside P_cr", "compression, stiffness taken by the spin", "%",
    "axial_load_share, spin_share", scale=PERCENT,
)  # fmt: skip
REAL_TIME_FACTOR = _view(
    "real_time_factor", "Real-time factor", "real-time factor", "1",
    beside="Simulated seconds per wall second, as reached (1: real time); one value per block of the simulation thread.",
)  # fmt: skip
"""Its values come with blocks, not from samples."""


def own_views(scenario: Scenario) -> tuple[View, ...]:
    """Views of one signal each: those of the table that are `plotted`, and those that the scenario's law adds."""
    plotted = (signal for signal in {**TABLE, **DERIVED}.values() if signal.plotted)
    return tuple(map(_own_view, (*plotted, *own_signals(scenario))))


def _own_view(signal: Signal) -> View:
    parts = [f"{signal.symbol} {label}" for label in signal.axes[-1].labels] if signal.axes else [signal.symbol]
    title = f"{signal.meaning[:1].upper()}{signal.meaning[1:]} {signal.symbol}"
    units = signal.units * (len(parts) // len(signal.units))
    entity = signal.name if signal.plotted else OWN + signal.name
    return View(entity, title, (signal,), tuple(parts), units, least=LEAST_OWN)


def views(scenario: Scenario) -> tuple[View, ...]:
    """All views of a run, the most important first, its law's own signals last."""
    torques, own = TORQUES[len(scenario.arms) - 1], own_views(scenario)
    return ERROR, DEFLECTION, INTERNAL_FORCE, torques, SLIDING, ESTIMATES, ENERGIES, AXIAL_LOAD, AXIAL_SHARE, *own


def fitting_exaggeration(scenario: Scenario) -> float:
    """The factor on the drawn deflection at which bending in steady motion is visible but moderate, and more for a softer beam.

    Bending is that of a uniform beam, 5ρaL⁴/(384 EI) at mid-span, under the trajectory's largest acceleration and weight.
    """
    payload, path = scenario.payload, scenario.trajectory
    load = payload.linear_density * math.hypot(*path.peak_acceleration[:2], scenario.gravity)
    bending = 5 * load * payload.length**3 / (384 * payload.bending_stiffness)
    if bending <= 0:
        return USUAL_FACTOR
    factor = USUAL_FACTOR * (bending / USUAL_BENDING) ** (SOFTER_BENDS_MORE - 1)
    return min(max(float(f"{factor:.{FACTOR_DIGITS}g}"), 1.0), HIGHEST_EXAGGERATION)
