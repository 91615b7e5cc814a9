"""The plotted signals: which entity, which curves in which unit and colour, and how they follow from samples.

What a curve means stands in the table of signals. A law's own signals have a plot each, without a line here.

Plots use the unit that suits the eye (mm, mrad); each curve's name says it. The exact signals, in SI units, are in the
blocks of `flexlab.recording.sample_codec`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexlab.scenario import Scenario
from flexlab.signal import Signal
from flexlab.sim.samples import Samples
from flexlab.sim.signals import DERIVED, TABLE, own_signals

MILLI = 1e3
"""Millimetres per metre, milliradians per radian."""

BLUE, VERMILION, GREEN = (0, 114, 178), (213, 94, 0), (0, 158, 115)
PURPLE, ORANGE, SKY, GRAY = (204, 121, 167), (230, 159, 0), (86, 180, 233), (150, 156, 164)
"""Okabe and Ito's palette (RGB), told apart with any colour vision."""

LEFT = ((0, 114, 178), (86, 180, 233), (0, 158, 115))
RIGHT = ((213, 94, 0), (230, 159, 0), (204, 121, 167))
"""Shades of the left arm's and of the right arm's three curves."""


ENERGIES = ("kinetic_energy", "elastic_energy", "gravity_energy", "input_work", "axial_work", "dissipated_energy")


@dataclass(frozen=True)
class PlotSignal:
    """One entity of curves. `values`: samples (N) → (N, curves), in the units that the names give."""

    entity: str
    title: str
    meaning: str
    """What it is, with its SI unit and equation, for the document beside the plot."""
    names: tuple[str, ...]
    colors: tuple[tuple[int, int, int], ...]
    values: Callable[[Samples], np.ndarray]


def _columns(*signals: np.ndarray) -> np.ndarray:
    return np.stack(signals, axis=1)


def _per_arm(signal: np.ndarray) -> np.ndarray:
    return signal.reshape(len(signal), -1)


def _arm_names(arm_count: int, *names: str) -> tuple[str, ...]:
    return tuple(f"{side} {name}" for side in ("left", "right")[:arm_count] for name in names)


def plot_signals(scenario: Scenario) -> tuple[PlotSignal, ...]:
    """All plotted signals of a run, most looked at first, those that only its law has last."""
    return (*_plots(len(scenario.arms)), *map(_own_plot, own_signals(scenario)))


def _own_plot(signal: Signal) -> PlotSignal:
    """A law's own signal in its SI units."""
    numbers = range(signal.fixed_size)
    units = [signal.units[number % len(signal.units)] for number in numbers]
    labels = [signal.symbol if len(numbers) == 1 else f"{signal.symbol} {number + 1}" for number in numbers]

    def values(samples: Samples) -> np.ndarray:
        found = samples.own.get(signal.name)
        return np.full((len(samples), len(numbers)), np.nan) if found is None else _per_arm(found)

    return PlotSignal(
        f"own/{signal.name}",
        signal.name.replace("_", " ").capitalize(),
        about(signal),
        tuple(f"{label} [{unit}]" for label, unit in zip(labels, units, strict=True)),
        tuple((*LEFT, *RIGHT)[number % 6] for number in numbers),
        values,
    )


def about(signal: Signal, shown: str = "") -> str:
    """What a signal is: symbol, meaning, equation and SI units, as the table of signals says. `shown`: the plot's units."""
    source = f" ({signal.equation})" if signal.equation else ""
    return f"{signal.symbol}: {signal.meaning}{source}, in {signal.unit_text}{f'; here in {shown}' if shown else ''}."


def _plots(arm_count: int) -> tuple[PlotSignal, ...]:
    arm_colors = (*LEFT, *RIGHT)[: 3 * arm_count]
    return (
        PlotSignal(
            "error",
            "Tracking error",
            about(TABLE["tracking_error"], "mm and mrad"),
            ("error x [mm]", "error y [mm]", "error θ [mrad]"),
            (BLUE, VERMILION, GREEN),
            lambda samples: samples.tracking_error * MILLI,
        ),
        PlotSignal(
            "vibration",
            "Beam at mid-span",
            f"{about(TABLE['midspan_deflection'])} {about(TABLE['quasi_static_deflection'])} "
            f"{about(DERIVED['vibration'], 'mm')}",
            ("vibration [mm]", "deflection [mm]", "quasi-static part [mm]"),
            (VERMILION, SKY, GREEN),
            lambda samples: (
                MILLI * _columns(samples.vibration, samples.midspan_deflection, samples.quasi_static_deflection)
            ),
        ),
        PlotSignal(
            "internal_force",
            "Internal force of the left arm",
            f"{about(TABLE['internal_force'])} It only squeezes and bends; the right arm's is equal and opposite.",
            ("force x [N]", "force y [N]", "moment [N·m]"),
            (BLUE, VERMILION, GREEN),
            lambda samples: samples.internal_force[:, 0],
        ),
        PlotSignal(
            "joint_torque",
            "Joint torques",
            about(TABLE["joint_torque"]),
            _arm_names(arm_count, "joint 1 [N·m]", "joint 2 [N·m]", "joint 3 [N·m]"),
            arm_colors,
            lambda samples: _per_arm(samples.joint_torque),
        ),
        PlotSignal(
            "sliding_variable",
            "Sliding variable",
            about(TABLE["sliding_variable"]),
            ("s x [m/s]", "s y [m/s]", "s θ [rad/s]"),
            (BLUE, VERMILION, GREEN),
            lambda samples: samples.sliding_variable,
        ),
        PlotSignal(
            "bound_estimates",
            "Bound estimates",
            about(TABLE["bound_estimates"]),
            ("b̂0 [N]", "b̂1 [N/m]", "b̂2 [N·s²/m²]"),
            (BLUE, VERMILION, GREEN),
            lambda samples: samples.bound_estimates,
        ),
        PlotSignal(
            "energy",
            "Energies",
            " ".join(about(TABLE[name]) for name in ENERGIES),
            (
                "kinetic [J]",
                "elastic [J]",
                "gravity [J]",
                "total [J]",
                "work put in [J]",
                "work of the axial load [J]",
                "damped away [J]",
            ),
            (BLUE, GREEN, GRAY, PURPLE, ORANGE, SKY, VERMILION),
            lambda samples: _columns(
                samples.kinetic_energy,
                samples.elastic_energy,
                samples.gravity_energy,
                samples.total_energy,
                samples.input_work,
                samples.axial_work,
                samples.dissipated_energy,
            ),
        ),
        PlotSignal(
            "axial_load",
            "Axial load",
            about(TABLE["axial_load"]),
            tuple(f"place {number} [N]" for number in (1, 2, 3, 4)),
            (BLUE, GREEN, ORANGE, VERMILION),
            lambda samples: samples.axial_load,
        ),
        PlotSignal(
            "axial_load_share",
            "Axial load beside P_cr",
            f"{about(TABLE['axial_load_share'])} {about(TABLE['spin_share'])}",
            ("compression of P_cr [1]", "stiffness taken by the spin [1]"),
            (BLUE, VERMILION),
            lambda samples: _columns(samples.axial_load_share, samples.spin_share),
        ),
    )


REAL_TIME_FACTOR = PlotSignal(
    "real_time_factor",
    "Real-time factor",
    "Simulated seconds per wall second, as reached (1: real time); one value per block of the simulation thread.",
    ("real-time factor [1]",),
    (BLUE,),
    lambda samples: np.full((len(samples), 1), np.nan),
)
"""Its values come with the blocks, not from samples."""
