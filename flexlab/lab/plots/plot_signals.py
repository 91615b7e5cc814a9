"""Which signals the plots show over time, in which units, on which tab."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexlab.control.law import BOUND_ESTIMATES, law_of
from flexlab.lab import colors
from flexlab.lab.plots.lyapunov import tracking_energy
from flexlab.scenario import Scenario
from flexlab.signal import Signal
from flexlab.sim.samples import Samples
from flexlab.sim.signals import own_signals

MILLI = 1e3
"""m to mm, rad to mrad, J to mJ."""
THREE = colors.CURVES

LEAST_OWN = 1e-6
"""Smallest range of a plot of a law's own signal, whose size nobody knows beforehand."""

Values = Callable[[Scenario, Samples], np.ndarray]


@dataclass(frozen=True)
class Limit:
    """A level that means something: drawn as two dashed lines at ± `value` (plot units)."""

    label: str
    value: float
    tone: colors.Color


@dataclass(frozen=True)
class Plot:
    """One plot over time: `labels` with units, one per signal; `values` gives (signals, N) in those units.

    `least`: the smallest vertical range, in the plot's units; below it there is nothing worth magnifying.
    `positive`: whether the range starts at 0 instead of -limit.
    """

    title: str
    labels: tuple[str, ...]
    tones: tuple[colors.Color, ...]
    values: Values
    least: float
    positive: bool = False
    limits: Callable[[Scenario], tuple[Limit, ...]] = lambda _: ()
    note: str = ""
    """A sentence below the plot."""


def _torques(arm: int) -> Values:
    return lambda _, samples: samples.joint_torque[:, arm].T


def _torque_limits(scenario: Scenario) -> tuple[Limit, ...]:
    limits = scenario.controller.torque_limit or ()
    return tuple(Limit(f"limit {k + 1} (N·m)", value, THREE[k]) for k, value in enumerate(limits))


def _wanted_force(scenario: Scenario) -> tuple[Limit, ...]:
    force = abs(scenario.controller.wanted_internal_force)
    return (Limit("wanted F_d (N)", force, colors.GRAY),) if force else ()


def _law_limits(signal: str) -> Callable[[Scenario], tuple[Limit, ...]]:
    """The levels that the control law knows for a signal."""

    def limits(scenario: Scenario) -> tuple[Limit, ...]:
        levels = law_of(scenario.controller).limits(scenario.controller).get(signal, {})
        return tuple(Limit(label, value, colors.GRAY) for label, value in levels.items())

    return limits


def _own_plot(signal: Signal) -> Plot:
    """A law's own signal."""
    parts = [f" {label}" for label in signal.axes[-1].labels] if signal.axes else [""]
    units = signal.units * len(parts) if len(signal.units) == 1 else signal.units
    return Plot(
        f"{signal.meaning[:1].upper()}{signal.meaning[1:]} {signal.symbol}",
        tuple(f"{signal.symbol}{part} ({unit})" for part, unit in zip(parts, units, strict=True)),
        tuple(THREE[k % len(THREE)] for k in range(len(parts))),
        lambda _, samples: _own_values(samples, signal, len(parts)),
        LEAST_OWN,
        limits=_law_limits(signal.name),
    )


def _own_values(samples: Samples, signal: Signal, count: int) -> np.ndarray:
    """(parts, N); NaN in samples of another law."""
    found = samples.own.get(signal.name)
    return np.full((count, len(samples)), np.nan) if found is None else found.reshape(len(samples), count).T


def _torque_plot(arm: int, name: str) -> Plot:
    labels = tuple(f"τ{joint} (N·m)" for joint in (1, 2, 3))
    return Plot(f"Joint torques, {name} arm", labels, THREE, _torques(arm), 1.0, limits=_torque_limits)


ERROR = Plot(
    "Tracking error",
    ("x (mm)", "y (mm)", "θ (mrad)"),
    THREE,
    lambda _, samples: MILLI * samples.tracking_error.T,
    0.1,
)
DEFLECTION = Plot(
    "Mid-span deflection, true size",
    ("vibration (mm)", "quasi-static (mm)"),
    (colors.VIOLET, colors.OLIVE),
    lambda _, samples: MILLI * np.stack([samples.vibration, samples.quasi_static_deflection]),
    0.01,
)
INTERNAL_FORCE = Plot(
    "Internal force, left arm",
    ("Fx (N)", "Fy (N)", "M (N·m)"),
    THREE,
    lambda _, samples: samples.internal_force[:, 0].T,
    1.0,
    limits=_wanted_force,
)
SLIDING = Plot(
    "Sliding variable s",
    ("x (m/s)", "y (m/s)", "θ (rad/s)"),
    THREE,
    lambda _, samples: samples.sliding_variable.T,
    0.01,
    limits=_law_limits("sliding_variable"),
)
ESTIMATES = Plot(
    "Bound estimates b̂",
    ("b̂0 (N)", "b̂1 (N/m)", "b̂2 (N·s²/m²)"),
    THREE,
    lambda _, samples: samples.bound_estimates.T,
    0.01,
    positive=True,
)
ENERGY = Plot(
    "Energy of arms and payload",
    ("kinetic (J)", "weight (J)", "total (J)"),
    THREE,
    lambda _, samples: np.stack([samples.kinetic_energy, samples.gravity_energy, samples.total_energy]),
    1.0,
)
ELASTIC = Plot(
    "Elastic energy of the beam",
    ("elastic (mJ)",),
    (colors.VIOLET,),
    lambda _, samples: MILLI * samples.elastic_energy[None],
    0.01,
    positive=True,
)
AXIAL_LOAD = Plot(
    "Axial load beside P_cr",
    ("compression (%)", "stiffness taken by the spin (%)"),
    (colors.VIOLET, colors.OLIVE),
    lambda _, samples: 100 * np.stack([samples.axial_load_share, samples.spin_share]),
    1.0,
    positive=True,
    note="At 100 % of compression this beam buckles; at 100 % of spin the paper's beam has no stiffness left.",
)
LYAPUNOV = Plot(
    "Lyapunov function, tracking part ½ sᵀM̄s",
    ("V (mJ)",),
    (colors.VIOLET,),
    lambda scenario, samples: MILLI * tracking_energy(scenario, samples)[None],
    0.1,
    positive=True,
    note="The proof's whole function adds ½ Σ kⱼ (bⱼ − b̂ⱼ)²: what the estimates still lack. Nobody knows the true "
    "bounds bⱼ, so that part cannot be drawn.",
)


def tabs(scenario: Scenario) -> dict[str, tuple[Plot, ...]]:
    """Tab name → its plots over time, for the arms that are there."""
    torques = (_torque_plot(0, "left"), _torque_plot(1, "right"))[: len(scenario.arms)]
    estimates = (ESTIMATES,) if BOUND_ESTIMATES in law_of(scenario.controller).memory else ()
    return {
        "Motion": (ERROR, DEFLECTION, INTERNAL_FORCE),
        "Torques": (*torques, AXIAL_LOAD),
        "Control": (SLIDING, *estimates, *map(_own_plot, own_signals(scenario))),
        "Energy": (ENERGY, ELASTIC, LYAPUNOV),
    }
