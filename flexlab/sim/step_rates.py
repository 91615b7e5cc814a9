"""The rates that bound the step: those of the law and of the beam in its arms, at poses of the path."""

import math
from typing import NamedTuple

import numpy as np

from flexlab.compiled import compiled, inlined
from flexlab.control.conditions import stability_limit
from flexlab.control.law_kernels import fastest_control_rate
from flexlab.control.motion import poses
from flexlab.control.path import Trajectory
from flexlab.control.rates import largest_form_ratio
from flexlab.numerics.eigenvalues import spectral_radius
from flexlab.numerics.elementary import exponentials
from flexlab.numerics.linear_algebra import product
from flexlab.physics.dynamics import configure_arms, rigid_inertia
from flexlab.physics.grips import carried_arms, grip_forms
from flexlab.physics.joints import friction_form
from flexlab.physics.mass_change import mass_factor, note_lightest
from flexlab.physics.plant import G, Workspace
from flexlab.sim.build import Beam
from flexlab.sim.closed_loop import System, scratch_workspace

POSES_TRIED = 16
"""Instants of the first period at which the rates are evaluated."""
FADED = 2.5e-4
"""Decay time of a mode, s, that counts exp(-1) times as much as one that rings for ever."""
STABLE_CREEP = 1.0
"""Largest number that the grips may add to the inverse mass of modes that are damped faster than the step. Such a mode follows at
once the grips' motion in the stage before, so that above about 1.3 each stage amplifies the last one."""
STEPS_TRIED = np.outer(2e-3 * np.ldexp(1.0, -np.arange(16)), [1.0, math.sqrt(0.5)]).ravel()
"""Steps that are tried for `STABLE_CREEP`, from the longest to less than the shortest in use, s."""


class Rates(NamedTuple):
    """What bounds the step and depends on no gain: the beam's rates in arms that give way, at poses of the path."""

    poses: np.ndarray
    """`POSES_TRIED` desired poses, (k, 3)."""
    held: float
    """Rate of the beam's fastest mode with its grips held, 1/s."""
    beam: float
    """Rate of its fastest mode in the arms, 1/s."""
    coupling: float
    """Norm of the modes' coupling through the motion of the beam's ends, 1/s."""
    lasting: float
    """As `coupling`, of modes that ring on, 1/s."""
    overdamped: float
    """Longest step with which overdamped modes are stable although the beam's ends move, s."""
    forms: np.ndarray
    """As `coupling_forms` of the beam, (3, 3, 3)."""


class GripRates(NamedTuple):
    """Bounds of the rates of compliant grips with the arms and the payload that they hold; 0 for rigid grips."""

    ringing: float = 0.0
    """Fastest vibration of the springs between the arms and the payload's ends, 1/s."""
    slow: float = 0.0
    """Fastest vibration of these springs with a rigid beam, 1/s."""
    fading: float = 0.0
    """Fastest decay by the dampers, 1/s."""


def find_rates(beam: Beam, system: System, trajectory: Trajectory, known: Rates | None = None) -> Rates:
    """The rates of a beam in its arms on its path; `known`: those of the same beam elsewhere."""
    lightest = note_lightest(system.plant, scratch_workspace(system))
    held = held_beam_rate(beam, lightest) if known is None else known.held
    forms = coupling_forms(system, beam) if known is None else known.forms
    desired = desired_poses(system, trajectory)
    gives, coupling, lasting = giving_way(system, desired, forms)
    if system.plant.grips is None:
        creeping = longest_creeping_step(system, desired, beam, gives)
    else:  # rk4, the only integrator for compliant grips, propagates nothing exactly.
        coupling, lasting, creeping = 0.0, 0.0, math.inf
    # The arms give way in units of the beam's own inverse mass 1/s at its lightest.
    return Rates(desired, held, held * math.sqrt(1 + lightest * gives), coupling, lasting, creeping, forms)


def desired_poses(system: System, trajectory: Trajectory) -> np.ndarray:
    """`POSES_TRIED` desired poses of the first period, (k, 3)."""
    times = trajectory.window[0] + np.arange(POSES_TRIED) * (trajectory.fastest_period / POSES_TRIED)
    return np.ascontiguousarray(poses(system.trajectory, times)[:, 0])


def control_rate(system: System, desired: np.ndarray) -> float:
    """Fastest rate of the closed loop that the law states, 1/s, at rest at desired poses (k, 3) and with an empty memory."""
    memory = np.zeros(system.control.memory_size)
    return fastest_rate_at(system.plant, system.control, desired, memory, _lightest_workspace(system))


def _lightest_workspace(system: System) -> Workspace:
    """A scratch workspace with the payload at its lightest, so that all rates are at their fastest."""
    ws = scratch_workspace(system)
    note_lightest(system.plant, ws)
    return ws


def joint_rate(system: System, desired: np.ndarray) -> float:
    """Fastest rate at which friction, or motors at their limits, slow joints at desired poses (k, 3), 1/s; 0 for ideal joints."""
    if system.plant.joints is None:
        return 0.0
    return fastest_joint_rate_at(system.plant, desired, _lightest_workspace(system))


def motor_rate(system: System) -> float:
    """Rate at which motors follow what they are asked for, 1/s; 0 if they follow at once."""
    return 0.0 if system.plant.joints is None else system.plant.joints.lag_rate


@inlined
def _straight_inertia(plant, arm_count, ws):
    """Fill ws.S of a straight beam and the first `arm_count` arms, after `configure_arms`."""
    factor, trig = mass_factor(plant.mass_change, ws), ws.arm.trig
    rigid_inertia(plant, factor, ws.arm, arm_count, trig[0], trig[1], 0.0, 0.0, ws.S)


def grip_rates(system: System, desired: np.ndarray) -> GripRates:
    """Rates of the grips at desired poses (k, 3)."""
    if system.plant.grips is None:
        return GripRates()
    found = np.zeros((3, 2))
    fastest_grips_at(system.plant, desired, _lightest_workspace(system), found)
    ringing, slow, fading = found.sum(axis=1)
    return GripRates(math.sqrt(ringing), math.sqrt(slow), float(fading))


@compiled
def fastest_grips_at(plant, desired, ws, found):
    """Raise found (3, 2) to the largest eigenvalues of the springs' forms, of these with a stiff beam, and of the dampers'.

    They are relative to the payload's inertia, then to an arm's: no eigenvalue of both together exceeds the sum. Poses (k, 3)
    that the arms cannot take are left out.
    """
    scratch, own = ws.truth[0].scratch, ws.grips.inertia
    for k in range(len(desired)):
        if configure_arms(plant, desired[k], ws.arm, ws.fault) == 0:
            c, s, factor = ws.arm.trig[0], ws.arm.trig[1], mass_factor(plant.mass_change, ws)
            for what in range(3):
                of = plant.grips.damping if what == 2 else plant.grips.stiffness
                _straight_inertia(plant, 0, ws)
                if what == 1:
                    ws.S[0, 0], ws.S[1, 1], ws.S[2, 2] = factor * plant.m, factor * plant.m, factor * plant.I
                    ws.S[1, 0] = ws.S[2, 0] = ws.S[2, 1] = 0.0
                for held in range(-1, len(plant.arms)):
                    scratch[0:3] = 0.0
                    for i in range(len(plant.arms)):
                        if held < 0 or held == i:
                            grip_forms(plant.arms[i], plant.length, c, s, of, scratch[0:3])
                    for a in range(3):
                        for b in range(3):
                            own[a, b] = ws.S[a, b] if held < 0 else ws.arm.M[held, a, b]
                    at = 0 if held < 0 else 1
                    found[what, at] = max(found[what, at], largest_form_ratio(own, scratch[0:3], scratch[3:6]))


@compiled
def fastest_joint_rate_at(plant, desired, ws):
    """The largest eigenvalue of S⁻¹Σ𝒥ᵀB'𝒥, 1/s, B' the steepest slopes of friction, at poses (k, 3) that the arms can take."""
    fastest, scratch = 0.0, ws.truth[0].scratch
    for k in range(len(desired)):
        if configure_arms(plant, desired[k], ws.arm, ws.fault) == 0:
            _straight_inertia(plant, len(plant.arms), ws)
            friction_form(plant.joints, ws.arm, scratch)
            fastest = max(fastest, largest_form_ratio(ws.S, scratch[0:3], scratch[3:6]))
    return fastest


def instability(system: System, desired: np.ndarray, period: float, delay: int) -> float:
    """Fastest rate of a loop sampled every `period`, s, over its limit of stability with so many periods of delay, 1.

    0 if the law is continuous (period 0) or the motors are off.
    """
    return control_rate(system, desired) * period / stability_limit(delay) if period > 0 else 0.0


@compiled
def fastest_rate_at(plant, control, desired, memory, ws):
    """The largest of the law's fastest rates, 1/s, at rest at the desired poses (k, 3) that the arms can take."""
    now, fastest = ws.truth[0], 0.0
    now.gravity = plant.gravity
    for k in range(len(desired)):
        if configure_arms(plant, desired[k], ws.arm, ws.fault) == 0:
            _straight_inertia(plant, len(plant.arms), ws)
            for a in range(3):
                now.x[a] = now.desired[0, a] = desired[k, a]
                now.v[a] = now.desired[1, a] = now.desired[2, a] = 0.0
            fastest = max(fastest, fastest_control_rate(control, now, memory, ws.S, plant.kappa))
    return fastest


def held_beam_rate(beam: Beam, factor: float) -> float:
    """Fastest rate of the beam with its grips held, 1/s: the largest |eigenvalue| of (η, π) → (π, -Ω²η - Dπ).

    `factor`: its mass over the mass for which the modes were computed, 1.
    """
    omega, D, starts = beam.modes.omega / math.sqrt(factor), beam.modes.D / factor, beam.modes.block_start
    alone = D.diagonal() / 2
    creeping = np.sqrt(np.maximum(alone * alone - omega * omega, 0.0))
    fastest = float(
        np.where(alone < omega, omega, alone + creeping)[starts[:-1][np.diff(starts) == 1]].max(initial=0.0)
    )
    for low, high in zip(starts[:-1], starts[1:], strict=True):
        if high - low > 1:
            own = slice(low, high)
            stiff = np.diag(omega[own])
            fastest = max(fastest, spectral_radius(np.block([[np.zeros_like(stiff), stiff], [-stiff, -D[own, own]]])))
    return fastest


def giving_way(system: System, desired: np.ndarray, forms: np.ndarray) -> tuple[float, float, float]:
    """How the motion of the beam's ends, with the inertias S at desired poses (k, 3), acts on the beam: 1, 1/s and 1/s.

    It adds C S⁻¹Cᵀ to the inverse mass, and so at most the largest eigenvalue of that to ω². It also couples the modes by at most
    the largest eigenvalue of S⁻¹(CᵀΩC): of all modes, and of those that ring on. `forms`: of `coupling_forms`.
    """
    found = np.zeros(len(forms))
    largest_ratios_at(system.plant, desired, forms, _lightest_workspace(system), found)
    gives, coupling, lasting = map(float, found)
    return gives, coupling, lasting


def longest_creeping_step(system: System, desired: np.ndarray, beam: Beam, gives: float) -> float:
    """Longest of `STEPS_TRIED` with which the overdamped modes stay within `STABLE_CREEP`, s.

    Infinite if they do so with all; the shortest, which is not taken, if with none. `gives`: the first of `giving_way`.
    """
    loads, D = system.plant.modal[: G + 1], beam.modes.D.diagonal()
    creeps = beam.modes.omega < D / 2
    if gives <= STABLE_CREEP or not creeps.any():
        return math.inf
    forms = []
    for step in STEPS_TRIED:
        (hh, hg), (_, gg) = product(loads * (creeps * np.minimum(step * D, 1.0)), loads.T)
        forms.append(_in_pose(hh, hg, gg))
    found = np.zeros(len(forms))
    largest_ratios_at(system.plant, desired, np.stack(forms), _lightest_workspace(system), found)
    allowed = STEPS_TRIED[found <= STABLE_CREEP]
    return math.inf if len(allowed) == len(STEPS_TRIED) else float(max(allowed, default=STEPS_TRIED[-1]))


def coupling_forms(system: System, beam: Beam) -> np.ndarray:
    """CᵀC and CᵀΩC for C = (h, g), the latter of all modes and of those that ring on, over the pose, (3, 3, 3)."""
    loads, omega = system.plant.modal[: G + 1], beam.modes.omega
    forms = [_in_pose(*system.plant.kappa)]
    for weight in (omega, omega * exponentials(-FADED * ring_decay(beam))):
        (hh, hg), (_, gg) = product(loads * weight, loads.T)
        forms.append(_in_pose(hh, hg, gg))
    return np.stack(forms)


def ring_decay(beam: Beam) -> np.ndarray:
    """Decay rate of each mode's slower part with its own damping alone, 1/s, (n_m,)."""
    half = beam.modes.D.diagonal() / 2
    return half - np.sqrt(np.maximum(half * half - beam.modes.omega * beam.modes.omega, 0.0))


@compiled
def largest_ratios_at(plant, desired, forms, ws, largest):
    """Raise `largest` (m,) to the eigenvalues of S⁻¹ form, forms (m, 3, 3) ≥ 0, at the poses (k, 3) that the arms can take.

    S is that of a straight beam.
    """
    scratch = ws.truth[0].scratch
    for k in range(len(desired)):
        if configure_arms(plant, desired[k], ws.arm, ws.fault) == 0:
            _straight_inertia(plant, carried_arms(plant.grips, plant.arms), ws)
            for m in range(len(forms)):
                for a in range(3):
                    for b in range(3):
                        scratch[a, b] = forms[m, a, b]
                largest[m] = max(largest[m], largest_form_ratio(ws.S, scratch[0:3], scratch[3:6]))


def _in_pose(hh: float, hg: float, gg: float) -> np.ndarray:
    """A quadratic form in (lateral, angular) as a bound in (x, y, θ), (3, 3), for every angle: lateral counts on both axes."""
    return np.array([[hh, 0, hg], [0, hh, hg], [hg, hg, gg]])
