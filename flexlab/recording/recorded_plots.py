"""The plotted signals: which entity, which curves in which unit and colour, and how they follow from samples.

Plots use the unit that suits the eye (mm, mrad); each curve's name says it. The exact signals, in SI units, are in the
blocks of `flexlab.recording.sample_codec`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexlab.sim.samples import Samples

MILLI = 1e3
"""Millimetres per metre, milliradians per radian."""

BLUE, VERMILION, GREEN = (0, 114, 178), (213, 94, 0), (0, 158, 115)
PURPLE, ORANGE, SKY, GRAY = (204, 121, 167), (230, 159, 0), (86, 180, 233), (150, 156, 164)
"""Okabe and Ito's palette (RGB), told apart with any colour vision."""

LEFT = ((0, 114, 178), (86, 180, 233), (0, 158, 115))
RIGHT = ((213, 94, 0), (230, 159, 0), (204, 121, 167))
"""Shades of the left arm's and of the right arm's three curves."""


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


def plot_signals(arm_count: int) -> tuple[PlotSignal, ...]:
    """All plotted signals of a run with `arm_count` arms, most looked at first."""
    arm_colors = (*LEFT, *RIGHT)[: 3 * arm_count]
    return (
        PlotSignal(
            "error",
            "Tracking error",
            "e = x - x_d, pose less desired pose (Section III), in m, m, rad; here in mm and mrad.",
            ("error x [mm]", "error y [mm]", "error θ [mrad]"),
            (BLUE, VERMILION, GREEN),
            lambda samples: samples.tracking_error * MILLI,
        ),
        PlotSignal(
            "vibration",
            "Beam at mid-span",
            "Deflection w(0, t) and its two parts: what the motion's inertial load bends, and the vibration, in m; "
            "here in mm.",
            ("vibration [mm]", "deflection [mm]", "quasi-static part [mm]"),
            (VERMILION, SKY, GREEN),
            lambda samples: (
                MILLI * _columns(samples.vibration, samples.midspan_deflection, samples.quasi_static_deflection)
            ),
        ),
        PlotSignal(
            "internal_force",
            "Internal force of the left arm",
            "F_1, Eqs. (13)-(15): the part of the grip's force that only squeezes and bends the payload, in N, N, N·m. "
            "The right arm's is equal and opposite.",
            ("force x [N]", "force y [N]", "moment [N·m]"),
            (BLUE, VERMILION, GREEN),
            lambda samples: samples.internal_force[:, 0],
        ),
        PlotSignal(
            "joint_torque",
            "Joint torques",
            "τ_i, Eq. (11), base joint first, in N·m.",
            _arm_names(arm_count, "joint 1 [N·m]", "joint 2 [N·m]", "joint 3 [N·m]"),
            arm_colors,
            lambda samples: _per_arm(samples.joint_torque),
        ),
        PlotSignal(
            "sliding_variable",
            "Sliding variable",
            "s = ẋ - r (Section III), in m/s, m/s, rad/s.",
            ("s x [m/s]", "s y [m/s]", "s θ [rad/s]"),
            (BLUE, VERMILION, GREEN),
            lambda samples: samples.sliding_variable,
        ),
        PlotSignal(
            "bound_estimates",
            "Bound estimates",
            "b̂, Eq. (25): what the controller has learnt about the beam's reaction, in N, N/m, N·s²/m².",
            ("b̂0 [N]", "b̂1 [N/m]", "b̂2 [N·s²/m²]"),
            (BLUE, VERMILION, GREEN),
            lambda samples: samples.bound_estimates,
        ),
        PlotSignal(
            "energy",
            "Energies",
            "Kinetic energy of arms and payload, elastic energy ½qᵀK_F q, weight, work put in and energy damped away, in J.",
            ("kinetic [J]", "elastic [J]", "gravity [J]", "total [J]", "work put in [J]", "damped away [J]"),
            (BLUE, GREEN, GRAY, PURPLE, ORANGE, VERMILION),
            lambda samples: _columns(
                samples.kinetic_energy,
                samples.elastic_energy,
                samples.gravity_energy,
                samples.total_energy,
                samples.input_work,
                samples.dissipated_energy,
            ),
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
