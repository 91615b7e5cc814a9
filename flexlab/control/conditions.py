"""Conditions of the laws' stability that can be computed, as sentences with the numbers of a scenario."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flexlab.numerics.elementary import each, sin
from flexlab.text import counted, number_text

SEPARATION = 3.0
"""Factor by which an observer must be slower than the beam's first mode, so that it follows a tenth of its vibration."""


class Condition(NamedTuple):
    """One condition of a law, with the numbers of a scenario."""

    sentence: str
    met: bool
    of_stability: bool = True
    """Whether the proof of stability needs it."""


@dataclass(frozen=True)
class Circumstances:
    """The quantities of a law's conditions on the desired motion, with the beam in quasi-static bending."""

    scenario: Any
    instants: np.ndarray
    """Equally spaced over the path, s, (N,)."""
    path: np.recarray
    """`LAW_INPUT` records on the desired motion, arm terms and believed payload included, (N,)."""
    reaction: np.ndarray
    """Ψ: force on the pose beyond the law's model of the payload, N, N, N·m, (N, 3)."""
    largest_reaction: float
    """max ‖Ψ‖ at all times, N."""
    largest_reaction_rate: float
    """max ‖dΨ/dt‖ at all times, N/s; infinite if Ψ jumps."""
    omega: np.ndarray
    """Modes of the beam with its grips held, rad/s, (n_m,)."""
    damping: np.ndarray
    """D_kk of each mode alone, 1/s, (n_m,)."""
    loads: np.ndarray
    """h and g of the modes, kg^½ and kg^½·m, (2, n_m)."""
    fastest_rate: float
    """Fastest rate of the closed loop, as in step control, 1/s."""
    slow_rate: float
    """Fastest rate of the closed loop with a rigid payload, 1/s."""

    def inertias(self) -> np.ndarray:
        """B = ΣM̄_i + Ā along the path, as the law believes the payload, (N, 3, 3)."""
        found = []
        for now in self.path:
            (c, s), (hh, hg, gg) = now.trig, now.kappa
            lateral, turn = np.array([-s, c, 0.0]), np.array([0.0, 0.0, 1.0])
            beam = hh * np.outer(lateral, lateral) + gg * np.outer(turn, turn)
            beam += hg * (np.outer(lateral, turn) + np.outer(turn, lateral))
            found.append(now.M[: now.arm_count].sum(axis=0) + np.diag([now.m, now.m, now.I]) - beam)
        return np.array(found)


def n(value: float) -> str:
    """A number for a sentence, with three digits."""
    return number_text(value, 3)


def within_layer(around: Circumstances) -> Condition:
    """Whether the feedback alone keeps ‖s‖ within the boundary layer on the path: ‖Ψ‖ ≤ K ε."""
    law, force = around.scenario.controller, around.largest_reaction
    gain = float(np.min(law.feedback_gain))
    size = force / gain if gain > 0 else np.inf
    return Condition(
        f"‖Ψ‖ ≤ K ε: the beam's reaction on this path, {n(force)} N, is held by K = {n(gain)} N·s/m at "
        f"‖s‖ = {n(size)} m/s, boundary layer {n(law.boundary_layer)} m/s.",
        size <= law.boundary_layer,
        of_stability=False,
    )


def slower_than_the_beam(around: Circumstances) -> Condition:
    """Whether the loop is slow against the beam's first mode, so that the law may treat the payload as rigid."""
    rate, first = around.slow_rate, float(np.min(around.omega))
    return Condition(
        f"λ < ω₁ (singular perturbation): the loop with a rigid payload moves at {n(rate)} 1/s, the beam's first mode at "
        f"{n(first)} 1/s; λ/ω₁ = {n(rate / first)}, and the beam follows better the smaller that is.",
        rate < first,
    )


def stability_limit(delay: int) -> float:
    """Largest λT_c of a stable sampled loop, 1: its fastest rate times its control period; `delay`: d, samples.

    x(k+1) = x(k) - λT_c x(k-d) is stable up to λT_c = 2 sin(π/(2 (2d + 1))) (Levin and May 1976).
    """
    return 2 * each(sin, [np.pi / (4 * delay + 2)])[0]


def sampled_in_time(around: Circumstances) -> tuple[Condition, ...]:
    """Whether held torques act in time, within the `stability_limit`; no condition for a continuous law."""
    law = around.scenario.controller
    if law.control_period is None:
        return ()
    product, limit = around.fastest_rate * law.control_period, stability_limit(law.input_delay)
    return (
        Condition(
            f"λ T_c ≤ {n(limit)}: the loop's fastest rate times the control period is {n(product)} with "
            f"{counted(law.input_delay, 'sample')} of delay.",
            bool(product <= limit),
        ),
    )


def fed_modes(around: Circumstances, gains: tuple[float, float]) -> tuple[Condition, ...]:
    """Whether rate feedback with gains k_v, k_θ of hᵀq̇, gᵀq̇ drives a mode, because held torques act late.

    A torque held over T_c after d samples reaches a mode ω with sinc(ωT_c/2) cos(ω (d + ½) T_c) of its strength, which is
    negative, with one sample of delay, from 1/(6 T_c) to 1/(2 T_c). No condition for a continuous law.
    """
    law = around.scenario.controller
    if law.control_period is None:
        return ()
    late = (law.input_delay + 0.5) * law.control_period
    reaching = np.sinc(around.omega * law.control_period / (2 * np.pi)) * np.cos(around.omega * late)
    strength = gains[0] * around.loads[0] ** 2 + gains[1] * around.loads[1] ** 2
    growth = -0.5 * strength * reaching - 0.5 * around.damping
    worst = int(np.argmax(growth))
    turns = f"late by {n(1e3 * late)} ms, rate feedback feeds modes from {n(1 / (4 * late))} Hz on"
    frequency = n(around.omega[worst] / (2 * np.pi))
    grows = bool(growth[worst] > 0)
    told = f"and {frequency} Hz grows at {n(growth[worst])} 1/s" if grows else "but none against its own damping"
    return (Condition(f"f < 1/(4 (d + ½) T_c): {turns}, {told}.", not grows),)
