"""Grips that give way: mass points at each instant, energy, the limit of stiff grips, closed forms."""

from collections.abc import Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from flexlab.analysis.validation.check import (
    DAMPING,
    FINE,
    STILL,
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
    coordinates,
    jacobian,
    lagrange,
    pose_by_angles,
    residual_force,
    slopes,
    time_derivative,
)
from flexlab.analysis.validation.paper import paper_law
from flexlab.analysis.validation.sampled_loop import joint_torques
from flexlab.presets import load_preset
from flexlab.sim.commands import Tap
from flexlab.sim.world import World

STIFFNESS, DAMPERS = np.array((4e4, 3e4, 2e3)), np.array((40.0, 30.0, 2.0))
"""Stiffness, N/m, N/m, N·m/rad, and damping, N·s/m, N·s/m, N·m·s/rad, of the grips in the fine run."""
FIRM = (1.6e7, 6.4e7)
"""Stiffnesses of nearly rigid grips, N/m and N·m/rad."""
BEGUN = 40
"""Samples after which the ring of a start in firm grips has faded."""
LOSSY = {
    "joints.motor.time_constant": 0.004,
    "joints.friction.viscous": (5.0, 5.0, 2.0),
    "payload.mass_change": {"factor": 3.0, "begin": 0.05, "duration": 0.2},
}
"""Joints and a payload with states of their own, beside those of the grips."""
KNOWN = 0.7
"""Share of that friction that a law knows."""
HEAVY, SOFT, FADING, HIT = 1e4, 5e3, 3.0, 1e-4
"""Mass of links that hardly move, kg; stiffness, N/m, and damping, N·s/m, of the grips; impulse of a tap, N·s."""


@subject("Grips that give way", 15)
def grips(_: Runs) -> Iterator[Check]:
    """Lagrange's equations of each body, energy, the limit of stiff grips, a ring and a sag in closed form."""
    yield from _compliant_motion()
    run = run_of(
        "the run with compliant grips",
        {"grips.model": "compliant", "gravity": 9.81, **LOSSY},
        0.4,
        0.001,
    )
    moved = float(np.abs(np.diff(run.input_work)).sum() + np.ptp(run.own["grip_loss"]))
    statement = (
        "late motors, friction and filling: energy gained = work - energy damped - losses + what material brought"
    )
    yield balanced(f"{statement}, as a part of what moved", run, moved)
    yield _measured_under_a_clock("payload")
    yield _measured_under_a_clock("arms")
    yield from _stiff()
    yield from _ring()
    yield from _sag()


def apart(z: np.ndarray, side: float) -> np.ndarray:
    """Displacement δ, (3,), of a grip at `side`, m, for the poses of payload and arm, (6,)."""
    along, across = np.array([np.cos(z[2]), np.sin(z[2])]), np.array([-np.sin(z[2]), np.cos(z[2])])
    gap = z[3:5] + side * np.array([np.cos(z[5]), np.sin(z[5])]) - z[:2] - side * along
    return np.array([(along * gap).sum(axis=0), (across * gap).sum(axis=0), z[5] - z[2]])


def pull(z: np.ndarray, rate: np.ndarray, side: float) -> np.ndarray:
    """The forces of springs and dampers on both poses, (6,): -∂/∂z ½Σk δ² - ∂/∂ż ½Σc δ̇²."""
    J = jacobian(lambda at: apart(at, side), z)
    return -J.T @ (STIFFNESS * apart(z, side) + DAMPERS * (J @ rate))


def _compliant_motion() -> Iterator[Check]:
    """Every body's own equations along a run of `general`, with poses from the joint angles."""
    given = {"model": "compliant", "stiffness": tuple(STIFFNESS), "damping": tuple(DAMPERS)}
    run = general("the general run with compliant grips", {"grips": given, "payload.axial_load": "first-order"})
    points, half = MassPoints(run.scenario), run.scenario.payload.length / 2
    p, rate, rows = coordinates(run)
    poses = [pose_by_angles(run.scenario, index, run.joint_angle[:, index]) for index in range(2)]
    rates = [np.pad(time_derivative(pose, FINE), ((2, 2), (0, 0))) for pose in poses]
    sides = (-half, half)
    for index, name in enumerate(("left", "right")):
        z = np.hstack([run.pose, poses[index]])
        statement = f"δ of the {name} grip is the gap between the ends, from the joint angles: difference, m or rad"
        gaps = [apart(at, sides[index]) for at in z]
        yield below(statement, 1e-12, run.own[f"{name}_grip_displacement"] - gaps)
    yield above("which it is, m or rad, at most", 1e-4, np.abs(run.own["left_grip_displacement"]).max())
    energy, stored, pulls = [], [], {}
    for k in rows:
        own = sum(0.5 * rates[i][k] @ points.arm_inertia(poses[i][k], i) @ rates[i][k] for i in range(2))
        own += 0.5 * rate[k] @ points.payload_inertia(p[k]) @ rate[k] + points.payload_potential(p[k])
        own += sum(points.arm_potential(poses[i][k], i) for i in range(2))
        both = [np.concatenate([run.pose[k], poses[i][k]]) for i in range(2)]
        moving = [np.concatenate([run.pose_rate[k], rates[i][k]]) for i in range(2)]
        stored.append(sum(0.5 * STIFFNESS @ apart(both[i], sides[i]) ** 2 for i in range(2)))
        energy.append(own + stored[-1])
        pulls[k] = np.array([pull(both[i], moving[i], sides[i]) for i in range(2)])
    yield alike("T + V is that of mass points and springs: relative error", 1e-9, run.total_energy[rows], energy)
    yield alike("of which the springs store ½Σk δ²: relative error", 1e-9, run.own["grip_energy"][rows], stored)
    seen: Any = SimpleNamespace(pose=np.mean(poses, axis=0), pose_rate=np.mean(rates, axis=0), time=run.time)
    seen.scenario = run.scenario
    asked = [joint_torques(points, seen.pose[k], paper_law(points, seen, k, run.bound_estimates[k])[0]) for k in rows]
    statement = "motors give what Eqs. (23), (25) ask for at the mean of the arms' poses: relative error"
    yield alike(statement, 1e-6, run.joint_torque[rows], asked)
    grip_force, pulled = run.internal_force[rows] + run.moving_force[rows][:, None], np.array(list(pulls.values()))
    yield alike("the internal force is made of the grips' pulls: relative error", 1e-7, grip_force, pulled[:, :, :3])

    def force(k: int) -> np.ndarray:
        K_G = points.between_grips(run.pose[k], rate[k, 2], pulls[k][:, :3])
        return np.concatenate([pulls[k][:, :3].sum(axis=0), -DAMPING * rate[k, 3:] - K_G @ p[k, 3:]])

    error = residual_force(run, lambda _: (points.payload_inertia, points.payload_potential), force)
    yield below("Lagrange's equations of the payload between the grips, with K_G: relative residual", 1e-6, error)
    for index, name in enumerate(("left", "right")):
        x, v = poses[index], rates[index]
        momenta = np.array([points.arm_inertia(x[k], index) @ v[k] for k in range(2, len(run) - 2)])
        change, residual = time_derivative(momenta, FINE), []
        own = partial(points.arm_inertia, index=index), partial(points.arm_potential, index=index)
        for k in [k for k in rows if 4 <= k < len(run) - 4]:
            needed = lagrange(*own, x[k], v[k], change[k - 4])
            residual.append(needed - run.arm_input[k, index] - pulls[k][index, 3:])
        error = np.abs(residual).max(axis=0) / np.abs(run.arm_input[:, index]).max(axis=0)
        yield below(f"and those of the {name} arm, with the opposite pull: relative residual", 1e-5, error)


def _measured_under_a_clock(place: str) -> Check:
    """The torques of a sampled law that measures the pose of the payload or the arms' mean one, and knows of friction."""
    grips = {"model": "compliant", "stiffness": tuple(STIFFNESS), "damping": tuple(DAMPERS), "measured_at": place}
    run = general(
        "the sampled run with compliant grips",
        {"grips": grips, "controller.control_period": 0.001, "controller.model.friction_factor": KNOWN, **LOSSY},
    )
    seen: Any = SimpleNamespace(pose=run.pose, pose_rate=run.pose_rate, time=run.time, scenario=run.scenario)
    if place == "arms":
        seen.pose = np.mean([pose_by_angles(run.scenario, arm, run.joint_angle[:, arm]) for arm in range(2)], axis=0)
        # At the start the arms have the payload's rate.
        seen.pose_rate = np.concatenate([run.pose_rate[:2], time_derivative(seen.pose, FINE)])
    points, b_hat, wanted, between = MassPoints(run.scenario), np.zeros(3), [], range(50, len(run), 100)
    for k in between:
        u, rate = paper_law(points, seen, k - 50, b_hat)
        x, v = seen.pose[k - 50], seen.pose_rate[k - 50]
        turning = np.array([v @ slopes(partial(points.joint_angles, index=arm), x) for arm in range(2)])
        wanted.append(joint_torques(points, x, u) + KNOWN * np.array(LOSSY["joints.friction.viscous"]) * turning)
        b_hat = b_hat + 0.001 * rate
    statement = f"measured at the {place}, at control instants: torques asked for are those of its pose: relative error"
    asked = np.stack([run.own[f"{side}_asked_torque"] for side in ("left", "right")], axis=1)
    return alike(statement, 1e-7 if place == "payload" else 1e-5, asked[list(between)], wanted)


def _stiff() -> Iterator[Check]:
    """The run converges to the paper's as k → ∞, at first order in 1/k."""
    found, calm = [], {"initial.pose_rate": None}
    exact = run_of("the paper's run without its jerk", {**calm, "simulation.step": 2e-5}, 0.2, 0.001)
    for stiffness in FIRM:
        firm = {"model": "compliant", "stiffness": (stiffness,) * 3, "damping": (stiffness**0.5,) * 3}
        run = run_of("the run with stiff grips", {**calm, "grips": firm}, 0.2, 0.001)
        force = np.abs(run.internal_force - exact.internal_force)[BEGUN:].max() / np.abs(exact.internal_force).max()
        found.append((np.abs(run.pose - exact.pose)[BEGUN:].max(), force))
    slope = np.log(np.divide(*found)) / np.log(FIRM[1] / FIRM[0])
    yield close("stiffer grips: the pose comes to the paper's with 1/k to the power", 1.0, slope[0], absolute=0.03)
    yield close("and the internal force", 1.0, slope[1], absolute=0.1)
    yield below("beside which it is, as a part of its peak", 1e-3, found[1][1])


def _ring() -> Iterator[Check]:
    """A payload between arms that hardly move is, along itself, one mass on two springs and two dampers."""
    arms = {f"{side}_arm.link_mass": (HEAVY,) * 3 for side in ("left", "right")}
    still = {"controller.kind": "none", "initial.pose": (0.0, 0.75, 0.0), "simulation.step": 1e-5}
    soft = {"grips.model": "compliant", "grips.stiffness": (SOFT, SOFT, SOFT), "grips.damping": (FADING,) * 3}
    world = World(load_preset("paper").replace({**arms, **still, **soft}))
    world.apply(Tap(0.0, (HIT, 0.0)))
    run, m = world.run(300), 1.0
    ring = np.sqrt(2 * SOFT / m - (FADING / m) ** 2)
    expected = HIT / m * np.exp(-FADING / m * run.time) * np.sin(ring * run.time) / ring
    statement = "tapped between heavy arms: x0 = J/(mω) e^(-ct/m) sin ωt, ω² = 2k/m - c²/m²"
    yield alike(statement, 1e-3, run.pose[:, 0], expected)


def _sag() -> Iterator[Check]:
    """Deflection of the grips at rest under gravity."""
    soft = {"model": "compliant", "stiffness": (1e5, 4e4, 5e3), "damping": (200.0, 200.0, 20.0)}
    run = run_of("the run at rest in compliant grips", {**STILL, "gravity": 9.81, "grips": soft}, 2.0, 0.001)
    for name in ("left", "right"):
        found, statement = run.own[f"{name}_grip_displacement"][-1, 1], "grip gives way across by mg/2k"
        yield close(f"at rest under gravity the {name} {statement}", 9.81 / 2 / 4e4, found, "m", 1e-5)
