"""Mechanics of mass points, energy along whole runs, and the order of each integrator."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from scipy.integrate import simpson
from scipy.linalg import block_diag, eigh

from flexlab.analysis.validation.check import (
    DAMPING,
    FINE,
    MOVING,
    PERIOD,
    Check,
    Runs,
    above,
    alike,
    balanced,
    below,
    close,
    general,
    run_of,
    subject,
)
from flexlab.analysis.validation.mass_points import (
    MassPoints,
    christoffel,
    coordinates,
    residual_force,
    slopes,
    time_derivative,
)
from flexlab.analysis.validation.paper import desired, paper_law
from flexlab.physics.internal_force import payload_matrices
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.commands import ChangeScenario, Pull
from flexlab.sim.geometry import arm_points, beam_points, link_points
from flexlab.sim.samples import Run, Samples
from flexlab.sim.world import World

KEPT = 2
"""Number of modes that move in a run with few of them."""


@subject("Mechanics of mass points", 2)
def mass_points(runs: Runs) -> Iterator[Check]:
    """Lagrange's equations along general motions, for the paper's boundary and for one without symmetry."""
    for run in (runs.general_pinned, runs.general):
        for check in _of(run):
            yield replace(check, statement=f"{run.scenario.payload.boundary}: {check.statement}")
    # Stiffness damping C = β K_F, and modal damping 2ζω, both from matrices of mass points.
    for words, field, number in (("stiffness", "coefficient", 1e-5), ("modal", "ratio", 0.2)):
        run = general(f"the run with {words} damping", {"payload.damping": {"kind": words, field: number}})
        points, n = MassPoints(run.scenario), run.beam_rates.shape[1]
        straight = np.concatenate([run.pose[0], np.zeros(n)])
        K = points.bending
        M = points.payload_inertia(straight)[3:, 3:]
        square, V = eigh(K, M)
        D = number * K if words == "stiffness" else M @ V * (2 * number * np.sqrt(square)) @ V.T @ M
        statement = f"{words} damping acts on the beam as it should: relative residual"
        yield below(statement, 1e-6, lagrange_residual(run, points, D))
    yield from _few_modes()


def _few_modes() -> Iterator[Check]:
    """A beam of which only the slowest modes move, under a law and with a static deflection of the whole beam."""
    run = general(
        "the run with few modes",
        {
            "payload.mode_count": KEPT,
            "payload.boundary": "clamped-pinned",
            "initial.beam_coordinates": (0.006, -0.02, -0.03),
        },
    )
    points, n = MassPoints(run.scenario), run.beam_rates.shape[1]
    straight = np.concatenate([run.pose[0], np.zeros(n)])
    V = eigh(points.bending, points.payload_inertia(straight)[3:, 3:])[1][:, :KEPT]
    onto = block_diag(np.eye(3), V)
    statement = f"{KEPT} of {n} modes kept: Lagrange's equations hold for them: relative residual"
    yield below(statement, 1e-6, lagrange_residual(run, points, DAMPING * np.eye(n), onto).max())
    last = len(run) - 1
    u = paper_law(points, run, last, run.bound_estimates[last])[0]
    yield alike("and the law knows the whole beam: relative error", 1e-7, run.arm_input[last], u)
    goal, _, change = (part[0] for part in desired(run.time[last:], run.scenario.trajectory))
    held = points.static_deflection(goal, change)
    yield close("as does the quasi-static deflection", held, run.quasi_static_deflection[last], "m", relative=1e-9)


def _of(run: Run) -> Iterator[Check]:
    """Inertia, energy, Lagrange's equations and joint torques along a run of `general`."""
    points = MassPoints(run.scenario)
    p, rate, rows = coordinates(run)
    yield from _inertia(run, points, p, rate)
    energy = [0.5 * rate[k] @ points.inertia(p[k]) @ rate[k] for k in rows]
    yield alike("kinetic energy is ½ Σ m |Ṙ|²: relative error", 1e-10, energy, run.kinetic_energy[rows])
    potential = np.array([points.potential(p[k]) for k in rows])
    stored = run.elastic_energy[rows] + run.gravity_energy[rows]
    yield alike("bending and weight store what mass points do: relative error", 1e-10, potential, stored)

    static = [
        points.static_deflection(goal[0], change[0])
        for goal, _, change in (desired(run.time[k : k + 1], run.scenario.trajectory) for k in rows)
    ]
    statement = "weight and ẍ_d hold the quasi-static deflection: relative error"
    yield alike(statement, 1e-9, run.quasi_static_deflection[rows], static)

    error = lagrange_residual(run, points, DAMPING * np.eye(p.shape[1] - 3))
    yield below("Lagrange's equations (16) hold for x0, y0, θ: relative residual", 1e-6, error[:3].max())
    yield below("and for the beam's q: relative residual", 1e-6, error[3:].max())
    changes, accelerations = time_derivative(run.pose_rate, FINE), run.pose_acceleration
    yield alike("the sampled ẍ is the change of ẋ: relative error", 1e-6, changes, accelerations[2:-2], accelerations)
    turning = time_derivative(run.joint_angle, FINE)
    joints = np.einsum("nij,nij->n", run.joint_torque[2:-2], turning)
    inputs = np.einsum("nij,nj->n", run.arm_input[2:-2], run.pose_rate[2:-2])
    yield alike("joint torques give the power Σ τᵀθ̇ = Σ uᵀẋ: relative error", 1e-6, joints, inputs)
    yield below("arms and beam are drawn where mass points are: largest difference, m", 1e-12, _drawn(run, points))


def _drawn(run: Run, points: MassPoints) -> np.ndarray:
    """Differences of drawn joints and beam points from those of mass points, m."""
    last, scenario, apart = run.take(slice(-1, None)), run.scenario, []
    x, p = last.pose[0], np.concatenate([last.pose[0], last.beam_coordinates[0]])
    joints, half = arm_points(scenario, last)[0], scenario.payload.length / 2
    for index, arm in enumerate(scenario.arms):
        turned = np.cumsum(points.joint_angles(x, index))
        links = np.column_stack([np.cos(turned), np.sin(turned)]) * np.array(arm.link_length)[:, None]
        apart.append(joints[index] - np.cumsum([arm.base, *links], axis=0))
    ends = np.array([points.beam_point(p, side * half) for side in (-1, 1)])
    apart += [joints[:, 3] - ends, link_points(scenario, last.pose)[0] - ends]
    places = np.linspace(-half, half, 9)
    apart.append(beam_points(scenario, last, 9)[0] - [points.beam_point(p, s) for s in places])
    return np.concatenate(apart)


def lagrange_residual(run: Run, points: MassPoints, D: np.ndarray, onto: np.ndarray | None = None) -> np.ndarray:
    """The `residual_force` of the arms' inputs and the beam's damping, (Σu, -D q̇)."""

    def force(k: int) -> np.ndarray:
        return np.concatenate([run.arm_input[k].sum(axis=0), -D @ run.beam_rates[k]])

    return residual_force(run, lambda k: (points.inertia, points.potential), force, onto)


def _inertia(run: Run, points: MassPoints, p: np.ndarray, rate: np.ndarray) -> Iterator[Check]:
    beam, state, v = build_beam(run.scenario.payload).matrices, p[50], rate[50]
    A, B, _ = payload_matrices(beam, state[:3], v[:3], state[3:], v[3:])
    exact = points.payload_inertia(state)
    yield alike("A(p) of Eq. (8) is that of mass points: relative error", 1e-10, A, exact)
    yield above("A(p) is positive definite: least eigenvalue", 0.0, np.linalg.eigvalsh(A).min())

    def inertia(t: np.ndarray) -> np.ndarray:
        moved = state + t * v
        return payload_matrices(beam, moved[:3], v[:3], moved[3:], v[3:])[0]

    skew = slopes(inertia, np.zeros(1))[0] - 2 * B
    yield below("Ȧ - 2B is skew: largest entry of its symmetric part", 1e-9, skew + skew.T)
    by_points = christoffel(points.payload_inertia, state, v)
    yield alike("B is the Christoffel matrix of A: relative error", 1e-7, by_points, B)


STEPS = {"rk4": (4, 1e-4), "etdrk4": (4, 2.5e-4), "generalized-alpha": (2, 1.25e-4)}
"""Integrator → its order, and a step, s."""
RINGING = {
    "controller.boundary_layer": 10.0,
    "payload.bending_stiffness": 10.0,
    "payload.boundary": "pinned-clamped",
    "gravity": 9.81,
}
"""A beam without symmetry, whose modes all steps resolve, and s within the boundary layer, where the law is smooth."""
SMOOTH_BUT_FOR: dict[str, dict[str, Any]] = {
    "": {},
    ", under a clock": {"controller.control_period": 0.002},
    ", where the path's acceleration jumps within samples": {
        "trajectory": {"kind": "bang-bang", "to": (0.01, 0.76, 0.02), "start": 0.0213, "duration": 0.0331}
    },
}
"""In words → changes of that motion, whose inputs jump between the steps."""
SPUN = MOVING | {
    "payload.bending_stiffness": 20.0,
    "payload.axial_load": "first-order",
    "simulation.integrator": "etdrk4",
    "simulation.accuracy": 1e-11,
}
"""A motion in which the centrifugal force and the force along the beam change its bending and its loss within a step."""
FADING = {
    "payload.damping": {"kind": "stiffness", "coefficient": 0.01},
    "controller.kind": "computed-torque",
    "trajectory.frequency": (3.0, 2.0, 2.5),
    "trajectory.center": (0.0, 0.75, 0.5),
    "initial.pose_rate": None,
    "simulation.integrator": "etdrk4",
    "simulation.step": PERIOD,
}
"""A smooth motion of a beam whose modes but the first are damped by e^-15 or more within a step."""
CALM = 100
"""Samples after which what the start excites has faded."""
LOOSE = {"controller.kind": "none", "gravity": 9.81, "payload.damping.coefficient": 0.0}
HANDS = {
    "the beam": Pull(-0.1, (0.1, 0.9), 400.0),
    "a first link": Pull(0.5, (0.4, 0.6), 400.0, (2, 1)),
    "a second link": Pull(0.25, (-0.9, 0.9), 400.0, (1, 2)),
    "a last link": Pull(0.1, (0.6, 1.0), 400.0, (2, 3)),
}
"""Held part → the hand that holds it: place, m; target, m; stiffness, N/m."""
TICK, TICKS = 0.002, 50
"""Sample period, s, and number of samples."""


@subject("Energy and convergence", 4)
def energy_and_convergence(runs: Runs) -> Iterator[Check]:
    """Energy balance with control and damping, conservation without, and the order of each integrator."""
    run = runs.paper
    yield balanced("paper's run: energy gained = work put in - energy damped, as a part of what moved", run)
    damped = run.dissipated_energy
    yield above("damping takes energy out, J", 0.0, damped[-1])
    yield below("and never gives any back: least change, as a part", 1e-12, -np.diff(damped).min() / damped[-1])
    for elements, bent in ((2, MOVING["initial.beam_coordinates"]), (18, None)):
        spun = run_of(
            "the soft beam", {**SPUN, "payload.element_count": elements, "initial.beam_coordinates": bent}, 0.1, PERIOD
        )
        statement = (
            f"soft beam, {elements} elements, spins fast: energy gained = work put in - energy damped, as a part"
        )
        yield balanced(statement, spun)
    yield from _fast_modes()
    free = runs.free
    drift = free.total_energy / free.total_energy[0] - 1
    yield below("no motors, no damping: relative drift of the energy in 2 s", 1e-6, drift)
    yield above("while the beam holds of it up to", 0.3, free.elastic_energy.max() / free.total_energy[0])
    yield from _pulled()
    for words, motion in SMOOTH_BUT_FOR.items():
        exact = _course("etdrk4", TICK / 256, motion)
        for integrator, (order, step) in STEPS.items():
            whole, half = (np.abs(_course(integrator, each, motion) - exact).max(axis=0) for each in (step, step / 2))
            statement = f"{integrator}{words}: errors of pose, b̂ and work fall with the step to the power {order}"
            yield below(f"{statement}: largest difference from it", 0.35, np.log2(whole / half) - order)


def _fast_modes() -> Iterator[Check]:
    """The rates of modes that are damped faster than the step, beside differences of their deflections, and their loss."""
    run = run_of("the run with strong damping", FADING, 0.25, PERIOD)
    points, n = MassPoints(run.scenario), run.beam_rates.shape[1]
    straight = np.concatenate([run.pose[0], np.zeros(n)])
    M = points.payload_inertia(straight)[3:, 3:]
    fast = M @ eigh(points.bending, M)[1][:, 1:]
    told, changed = run.beam_rates[2:-2][CALM:] @ fast, time_derivative(run.beam_coordinates, PERIOD)[CALM:] @ fast
    missed = np.abs(told - changed).max(axis=0) / np.abs(changed).max(axis=0)
    yield below("etdrk4: modes damped faster than its step: η̇ is the change of η: relative error", 2.5e-4, missed)
    damping, rates = FADING["payload.damping"]["coefficient"] * points.bending, run.beam_rates[CALM:]
    lost = simpson(np.einsum("ni,ij,nj->n", rates, damping, rates), x=run.time[CALM:])
    told = run.dissipated_energy[-1] - run.dissipated_energy[CALM]
    yield close("and their damping takes ∫q̇ᵀDq̇ dt", float(lost), float(told), "J", relative=0.002)


def _pulled() -> Iterator[Check]:
    """A hand's spring, a system without motors and dampers, and what the engine counts as the hand's work."""
    for grips, (words, hand) in product(("rigid", "compliant"), HANDS.items()):
        world = World(load_preset("paper").replace({**LOOSE, "grips.model": grips}))
        world.apply(hand)
        run = world.run(200)
        point = _held_point(world.scenario, hand, run)
        stored = 0.5 * hand.stiffness * np.sum((point - hand.target) ** 2, axis=1)
        given, gained = stored[0] - stored, run.total_energy - run.total_energy[0]
        lost = run.dissipated_energy + run.own.get("grip_loss", 0.0)
        statement = f"a hand pulls {words}, {grips} grips: energy gained and lost = energy that its spring gives"
        yield below(statement, 1e-6, (gained + lost - given) / np.ptp(stored))
        yield below("and that is the work put in: relative error", 1e-6, (run.input_work - given) / np.ptp(stored))
        world.apply(replace(hand, stiffness=0.0))
        before, run = (run.total_energy + lost)[-1], world.advance(20)
        kept = run.total_energy + run.dissipated_energy + run.own.get("grip_loss", 0.0)
        yield below("which stays once it has let go: relative change", 1e-8, kept / before - 1)
    yield _softened()
    links = [HANDS["a first link"], HANDS["a second link"]]  # of the right arm, then of the left
    run = general("the run with hands on links", {}, [(0.0, links[0]), (0.0015, links[1])])
    changes = time_derivative(run.pose_rate, FINE)
    apart = (changes - run.pose_acceleration[2:-2])[np.abs(run.time[2:-2] - 0.0015) > 2.5 * FINE]
    statement = "a hand on one arm, then on the other: the sampled ẍ is the change of ẋ: relative error"
    yield below(statement, 1e-6, apart / np.abs(changes).max())
    many = {**LOOSE, "payload.damping.coefficient": DAMPING, "payload.element_count": 18}
    world = World(load_preset("paper").replace(many), TICK / 20)
    world.apply(HANDS["the beam"])
    run = world.run(400)
    lost = float(simpson(DAMPING * np.sum(run.beam_rates**2, axis=1), x=run.time))
    yield close("the damping of a held beam takes ∫q̇ᵀDq̇ dt", lost, float(run.dissipated_energy[-1]), "J", 1e-4)


def _softened() -> Check:
    """A beam that gets softer while a hand holds it."""
    world, hand = World(load_preset("paper").replace(LOOSE)), HANDS["the beam"]
    world.apply(hand)
    world.advance(50)
    world.apply(ChangeScenario({"payload.bending_stiffness": 10.0}))
    run = world.run(100)
    point = _held_point(world.scenario, hand, run)
    stored = 0.5 * hand.stiffness * np.sum((point - hand.target) ** 2, axis=1)
    off = run.total_energy - run.total_energy[0] - stored[0] + stored
    statement = "a held beam gets softer: from then on, energy gained = energy that the hand's spring gives"
    return below(statement, 1e-6, off / np.ptp(stored))


def _held_point(scenario: Scenario, hand: Pull, run: Samples) -> np.ndarray:
    """The place (N, 2) of a hand along a run, from the pose and the deflection there, or from the joint angles, m."""
    if hand.link is None:
        turn, across = run.pose[:, 2], run.beam_coordinates @ MassPoints(scenario).shapes(hand.position)
        c, s = np.cos(turn), np.sin(turn)
        return run.pose[:, :2] + np.column_stack([hand.position * c - across * s, hand.position * s + across * c])
    index, link = hand.link[0] - 1, hand.link[1]
    arm, turned = scenario.arms[index], np.cumsum(run.joint_angle[:, index], axis=1)[:, :link]
    outwards = np.array([*arm.link_length[: link - 1], hand.position])
    return np.array(arm.base) + np.column_stack([np.cos(turned) @ outwards, np.sin(turned) @ outwards])


def _course(integrator: str, step: float, motion: dict[str, Any]) -> np.ndarray:
    """Pose, b̂ and work put in at every sample, (N, 7)."""
    changes = {**RINGING, **motion, "simulation.integrator": integrator, "simulation.step": step}
    run = World(load_preset("paper").replace(changes), TICK).run(TICKS)
    return np.column_stack([run.pose, run.bound_estimates, run.input_work])
