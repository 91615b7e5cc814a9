"""Which integrator and which step a scenario gets."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from flexlab.compiled import compiled
from flexlab.control.law_kernels import fastest_control_rate
from flexlab.control.motion import poses
from flexlab.control.path import Trajectory
from flexlab.control.rates import largest_form_ratio
from flexlab.errors import ScenarioError
from flexlab.physics.dynamics import configure_arms, rigid_inertia
from flexlab.physics.plant import G
from flexlab.scenario import Scenario
from flexlab.scenario.scenario import SMALLEST_STEP
from flexlab.sim.build import Beam
from flexlab.sim.closed_loop import System, scratch_workspace
from flexlab.sim.integrators.etdrk4 import Functions, beam_operators, block_functions
from flexlab.sim.integrators.generalized_alpha import effective_inverse
from flexlab.sim.integrators.rk4 import STABILITY_LIMIT
from flexlab.sim.integrators.scheme import ORDER, GeneralizedAlpha, Scheme

REFERENCE_STEP = 1e-3
REFERENCE_ERROR = {"rk4": 6e-8, "etdrk4": 3e-8, "generalized-alpha": 6e-6}
"""Pose error of the paper run with `REFERENCE_STEP` (s), m, that no mesh exceeds (`flexlab bench`)."""

SHORTEST_STEP = 1e-5
"""Shortest automatic step, s: a second-order method asked for more accuracy than that would never get there."""

LONGEST_STEP = 2e-3
"""s: beyond it the 1 kHz samples of the live lab would lie within steps."""

DEFAULT_ACCURACY = 1e-10
"""Pose accuracy, m, for which the limits below are given."""

CONTROL_LIMIT, COARSEST_CONTROL_LIMIT = 0.2, 0.4
"""Longest step times fastest closed-loop rate for the default accuracy, so that start-up transients are exact to a few 1e-6,
and for any: well inside the methods' stability (2.8)."""

CONTROLLED_STEP = 2e-5
"""s: below it, only stability counts. What a loop does in less than that, no arm follows."""

COUPLING_LIMIT, COUPLED_STEP = 0.1, 1e-5
"""Longest step times the rate at which light arms give way to the beam's modes, the part of the beam that etdrk4 does not
propagate exactly, for the default accuracy; never asked for below the second number, s: there, only the highest modes gain."""

FADING_LIMIT = 0.3
"""`COUPLING_LIMIT` of modes that ring no longer than `FADED`: of a smooth motion they show their quasi-static bending, and what
follows a start or a change has shorter steps (`step_levels`)."""

FADED = 2.5e-4
"""s: what rings as long counts for exp(-1) of what rings for ever."""

STABLE_COUPLING = 1.0
"""Longest step times that rate with which etdrk4 is stable, with a margin of two."""

SHORTEST_CHOSEN = SMALLEST_STEP
"""s: a shorter step is not taken, neither at the start nor in a run."""

RINGING_LIMIT, RINGING_DECAY = 0.01, 1.0
"""`COUPLING_LIMIT` where nothing fades, so that errors of the modes add up: where no mode decays faster than this, 1/s."""

POSES_TRIED = 16
"""Instants of the first period at which the inertia that the controller works against is looked at."""

RESOLVED, RESOLVED_MODES, RESOLVED_ANGLE = 0.5, 3, 0.05
"""Part of its stability limit, and step times frequency of its third mode, at which rk4 runs by itself. rk4 takes (ωΔt)⁶/72 of
a mode's energy per step: with these the modes that a motion excites keep theirs to 1e-6 over 10 s."""

SOFT_BEAM = 0.03
"""Step times the beam's fastest rate below which rk4's error in its stiffest mode is under 1e-9 of its amplitude a step."""

SMALLEST_COMMON_STEP = 1e-6
"""Shortest step that aligning samples with control instants may force, s."""


class Rates(NamedTuple):
    """What bounds the step and no gain changes: inertias on the way, and the beam's rates with arms that give way."""

    poses: np.ndarray
    """`POSES_TRIED` desired poses, (k, 3)."""
    beam: float
    """Of the beam's fastest mode, 1/s."""
    coupling: float
    """Norm of the modes' coupling through grips that give way, 1/s."""
    lasting: float
    """The same of modes that ring on, 1/s."""
    forms: np.ndarray
    """As `coupling_forms` of the beam, (3, 3, 3)."""


def find_rates(
    beam: Beam, system: System, trajectory: Trajectory, free_rate: float, forms: np.ndarray | None = None
) -> Rates:
    """The rates of a beam in its arms on its path; `free_rate`: that of `free_beam_rate`, 1/s; `forms`: if they are known."""
    desired, forms = desired_poses(system, trajectory), coupling_forms(system, beam) if forms is None else forms
    gives, coupling, lasting = giving_way(system, desired, forms)
    return Rates(desired, free_rate * math.sqrt(1 + gives), coupling, lasting, forms)


def desired_poses(system: System, trajectory: Trajectory) -> np.ndarray:
    """`POSES_TRIED` desired poses of the first period, (k, 3)."""
    times = trajectory.window[0] + np.arange(POSES_TRIED) * (trajectory.fastest_period / POSES_TRIED)
    return np.ascontiguousarray(poses(system.trajectory, times)[:, 0])


def control_rate(system: System, desired: np.ndarray) -> float:
    """Fastest rate of the part of the closed loop that the law shapes, 1/s.

    As the law says it, at rest at desired poses (k, 3) and with an empty memory.
    """
    memory = np.zeros(system.control.memory_size)
    return fastest_rate_at(system.plant, system.control, desired, memory, scratch_workspace(system))


@compiled
def fastest_rate_at(plant, control, desired, memory, ws):
    """The largest of the law's fastest rates, 1/s, at rest at those of the desired poses (k, 3) that the arms can take."""
    now, fastest = ws.truth[0], 0.0
    now.gravity = plant.gravity
    for k in range(len(desired)):
        if configure_arms(plant, desired[k], ws.arm, ws.fault) == 0:
            rigid_inertia(plant, ws.arm, ws.arm.trig[0], ws.arm.trig[1], 0.0, 0.0, ws.S)
            for a in range(3):
                now.x[a] = now.desired[0, a] = desired[k, a]
                now.v[a] = 0.0
            fastest = max(fastest, fastest_control_rate(control, now, memory, ws.S, plant.kappa))
    return fastest


def free_beam_rate(beam: Beam) -> float:
    """Fastest rate of the beam with its grips held, 1/s: the largest |eigenvalue| of (η, π) → (π, -Ω²η - Dπ)."""
    omega, D, starts = beam.modes.omega, beam.modes.D, beam.modes.block_start
    fastest = 0.0
    for size in sorted(set(np.diff(starts).tolist())):
        blocks = starts[:-1][np.diff(starts) == size]
        L = np.zeros((len(blocks), 2 * size, 2 * size))
        for block, low in zip(L, blocks, strict=True):
            own = slice(low, low + size)
            block[:size, size:], block[size:, :size] = np.diag(omega[own]), -np.diag(omega[own])
            block[size:, size:] = -D[own, own]
        fastest = max(fastest, float(np.max(np.abs(np.linalg.eigvals(L)))))
    return fastest


def giving_way(system: System, desired: np.ndarray, forms: np.ndarray) -> tuple[float, float, float]:
    """What grips that give way, at the inertias S of desired poses (k, 3), do to the beam: 1, 1/s and 1/s.

    They add C S⁻¹Cᵀ to the inverse mass, and with it at most its largest eigenvalue to ω². And they couple the modes with the
    norm of the largest eigenvalue of S⁻¹(CᵀΩC): of all modes, and of those that ring on. `forms`: of `coupling_forms`.
    """
    found = np.zeros(len(forms))
    largest_ratios_at(system.plant, desired, forms, scratch_workspace(system), found)
    gives, coupling, lasting = map(float, found)
    return gives, coupling, lasting


def coupling_forms(system: System, beam: Beam) -> np.ndarray:
    """CᵀC and CᵀΩC for C = (h, g), the latter of all modes and of those that ring on, over the pose, (3, 3, 3)."""
    loads, omega = system.plant.modal[: G + 1], beam.modes.omega
    forms = [_in_pose(*system.plant.kappa)]
    for weight in (omega, omega * np.exp(-FADED * ring_decay(beam))):
        (hh, hg), (_, gg) = (loads * weight) @ loads.T
        forms.append(_in_pose(hh, hg, gg))
    return np.stack(forms)


def ring_decay(beam: Beam) -> np.ndarray:
    """Rate at which each mode's slower part fades with its own damping alone, 1/s, (n_m,)."""
    half = beam.modes.D.diagonal() / 2
    return half - np.sqrt(np.maximum(half**2 - beam.modes.omega**2, 0.0))


@compiled
def largest_ratios_at(plant, desired, forms, ws, largest):
    """Raise `largest` (m,) to the eigenvalues of S⁻¹ form, forms (m, 3, 3) ≥ 0, at those poses (k, 3) that the arms can take.

    S is that of a straight beam.
    """
    scratch = ws.truth[0].scratch
    for k in range(len(desired)):
        if configure_arms(plant, desired[k], ws.arm, ws.fault) == 0:
            rigid_inertia(plant, ws.arm, ws.arm.trig[0], ws.arm.trig[1], 0.0, 0.0, ws.S)
            for m in range(len(forms)):
                for a in range(3):
                    for b in range(3):
                        scratch[a, b] = forms[m, a, b]
                largest[m] = max(largest[m], largest_form_ratio(ws.S, scratch[0:3], scratch[3:6]))


def _in_pose(hh: float, hg: float, gg: float) -> np.ndarray:
    """A form in (lateral, angular) as one in (x, y, θ), (3, 3), for every angle: the lateral load counts on both axes."""
    return np.array([[hh, 0, hg], [0, hh, hg], [hg, hg, gg]])


class Choice(NamedTuple):
    """Integrator and step."""

    integrator: str
    step: float
    """The longest, s."""
    bound: str
    """What it was chosen by: "beam", "law", "given" or, in `steps_per_tick`, "period"."""


def choose_step(scenario: Scenario, system: System, beam: Beam, rates: Rates) -> Choice:
    """Integrator and longest step that accuracy, stability and the scenario's wishes give.

    Raises `ScenarioError` for a wished step that is unstable.
    """
    simulation, beam_speed, control_speed = scenario.simulation, rates.beam, control_rate(system, rates.poses)
    integrator = simulation.integrator
    if integrator == "auto":
        # Only a beam so slow that rk4 resolves all its modes saves by not propagating them exactly.
        step = simulation.step or _accurate_step("rk4", simulation.accuracy, control_speed)
        integrator = "rk4" if step * beam_speed < SOFT_BEAM else "etdrk4"
    stable = STABILITY_LIMIT / beam_speed if integrator == "rk4" else math.inf
    if simulation.step is None:
        ease = (simulation.accuracy / DEFAULT_ACCURACY) ** (1 / ORDER[integrator])
        fades = float(beam.modes.D.diagonal().max()) / 2 > RINGING_DECAY
        coupled, coupling = math.inf, rates.coupling
        if coupling > 0:
            lasting = (COUPLING_LIMIT if fades else RINGING_LIMIT) / max(rates.lasting, 1e-9 * coupling)
            coupled = max(min(COUPLED_STEP, STABLE_COUPLING / coupling), ease * min(lasting, FADING_LIMIT / coupling))
        if integrator == "rk4":
            stable = min(RESOLVED * stable, RESOLVED_ANGLE / float(np.sort(beam.modes.omega)[:RESOLVED_MODES][-1]))
        step = min(stable, coupled, _accurate_step(integrator, simulation.accuracy, control_speed))
        bound = "beam" if step == min(stable, coupled) else "law"
        _refuse_tiny(step, integrator, bound)
        return Choice(integrator, step, bound)
    if simulation.step > stable:
        raise ScenarioError(
            [
                (
                    "simulation.step",
                    f"simulation.step = {simulation.step:g} s is unstable with rk4: the stiffest mode of this beam allows "
                    f"at most {stable:.3g} s. Choose a shorter step, etdrk4, or null for an automatic step.",
                )
            ]
        )
    return Choice(integrator, simulation.step, "given")


def _refuse_tiny(step: float, integrator: str, bound: str) -> None:
    """Raise `ScenarioError` for a step that nobody would live to see the end of."""
    if step >= SHORTEST_CHOSEN:
        return
    cause, cure = "the controller's gains", "Lower the gains"
    if bound == "beam":
        cause, cure = "the beam's fastest mode in these arms", "Choose a softer or less damped beam or fewer elements"
    if integrator != "etdrk4":
        cure += ", or the integrator auto"
    needs = (
        f"{cause} would need a step of {step:.2g} s with {integrator}, below the {SHORTEST_CHOSEN:g} s that is allowed"
    )
    raise ScenarioError(
        [("simulation.step", f"simulation.step = null: {needs}. {cure}, or set simulation.step yourself.")]
    )


def control_limits(integrator: str, accuracy: float) -> tuple[float, float]:
    """Longest step times fastest closed-loop rate for a pose accuracy, m, and for any accuracy."""
    ease = (accuracy / DEFAULT_ACCURACY) ** (1 / ORDER[integrator])
    return CONTROL_LIMIT * ease, COARSEST_CONTROL_LIMIT


def _accurate_step(integrator: str, accuracy: float, control_speed: float) -> float:
    """Longest step for a pose accuracy, m, that also resolves the closed loop's fastest rate, 1/s."""
    wish = REFERENCE_STEP * (accuracy / REFERENCE_ERROR[integrator]) ** (1 / ORDER[integrator])
    period = 1 / max(control_speed, 1e-3 / LONGEST_STEP)
    wished, coarsest = control_limits(integrator, accuracy)
    controlled = min(coarsest * period, max(wished * period, CONTROLLED_STEP))
    return min(LONGEST_STEP, max(wish, SHORTEST_STEP), controlled)


def steps_per_tick(scenario: Scenario, tick_period: float, step: float) -> tuple[int, int]:
    """Steps per sample and per control period (0: continuous), so that both lie on steps no longer than `step`.

    Raises `ScenarioError` if the two periods have no common step worth taking.
    """
    control_period = scenario.controller.control_period
    if control_period is None:
        return max(1, math.ceil(tick_period / step - 1e-9)), 0
    tick, control = (Fraction(period).limit_denominator(10**9) for period in (tick_period, control_period))
    common = Fraction(math.gcd(tick.numerator * control.denominator, control.numerator * tick.denominator)) / (
        tick.denominator * control.denominator
    )
    if common < SMALLEST_COMMON_STEP:
        raise ScenarioError(
            [
                (
                    "controller.control_period",
                    f"controller.control_period = {control_period:g} s and the sample period {tick_period:g} s have no "
                    f"common step above {SMALLEST_COMMON_STEP:g} s: choose a multiple of {SMALLEST_COMMON_STEP:g} s.",
                )
            ]
        )
    step_count = max(1, math.ceil(float(common) / step - 1e-9))
    return int(tick / common) * step_count, int(control / common) * step_count


def build_scheme(integrator: str, beam: Beam, dt: float, known: Sequence[Sequence[Functions]] = ()) -> Scheme:
    """The integrator's constants for step dt; `known`: what `block_functions` says of dt and dt/2, if it has been asked."""
    modes = beam.modes
    loads = np.stack([modes.V.T @ beam.matrices.h, modes.V.T @ beam.matrices.g])
    if integrator == "etdrk4":
        linear = (modes.omega, modes.D, modes.block_start)
        functions = known or [block[:2] for block in block_functions(*linear, dt)]
        return Scheme(etdrk4=beam_operators(*linear, loads, dt, functions))
    if integrator == "generalized-alpha":
        inverse = effective_inverse(modes.omega, modes.D, modes.block_start, dt)
        return Scheme(generalized_alpha=GeneralizedAlpha(inverse, loads @ inverse))
    return Scheme(rk4=True)
