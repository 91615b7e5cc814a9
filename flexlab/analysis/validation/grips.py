"""Grips that give way: mass points between springs and dampers, energy, the paper's limit, and closed forms."""

from collections.abc import Iterator
from functools import partial

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
    COMPLEX_STEP,
    MassPoints,
    coordinates,
    lagrange,
    pose_by_angles,
    residual_force,
    time_derivative,
)
from flexlab.presets import load_preset
from flexlab.sim.commands import Tap
from flexlab.sim.world import World

STIFFNESS, DAMPERS = np.array((4e4, 3e4, 2e3)), np.array((40.0, 30.0, 2.0))
"""Stiffness, N/m, N/m, N·m/rad, and damping, N·s/m, N·s/m, N·m·s/rad, of the grips in the fine run."""
FIRM = (1.6e7, 6.4e7)
"""Stiffnesses of nearly rigid grips, N/m and N·m/rad."""
BEGUN = 40
"""Samples after which the ring of a start in firm grips has faded."""
HEAVY, SOFT, FADING, HIT = 1e4, 5e3, 3.0, 1e-4
"""Mass of links that hardly move, kg; stiffness, N/m, and damping, N·s/m, of the grips; impulse of a tap, N·s."""


@subject("Grips that give way", 14)
def grips(_: Runs) -> Iterator[Check]:
    """Lagrange's equations of each body, energy, the limit of stiff grips, a ring and a sag in closed form."""
    yield from _along_a_motion()
    run = run_of("the run with compliant grips", {"grips.model": "compliant", "gravity": 9.81}, 0.4, 0.001)
    moved = float(np.abs(np.diff(run.input_work)).sum() + np.ptp(run.own["grip_loss"]))
    yield balanced("energy gained = work - energy damped - loss in the grips, as a part of what moved", run, moved)
    yield from _stiff()
    yield from _ring()
    yield from _sag()


def apart(z: np.ndarray, side: float) -> np.ndarray:
    """δ of a grip at `side`, m, of a payload and an arm with these poses (6,), (3,)."""
    along, across = np.array([np.cos(z[2]), np.sin(z[2])]), np.array([-np.sin(z[2]), np.cos(z[2])])
    gap = z[3:5] + side * np.array([np.cos(z[5]), np.sin(z[5])]) - z[:2] - side * along
    return np.array([along @ gap, across @ gap, z[5] - z[2]])


def pull(z: np.ndarray, rate: np.ndarray, side: float) -> np.ndarray:
    """The forces of springs and dampers on both poses, (6,): -∂/∂z ½Σk δ² - ∂/∂ż ½Σc δ̇²."""
    steps = 1j * COMPLEX_STEP * np.eye(6)
    J = np.stack([apart(z + step, side).imag / COMPLEX_STEP for step in steps], axis=1)
    return -J.T @ (STIFFNESS * apart(z, side) + DAMPERS * (J @ rate))


def _along_a_motion() -> Iterator[Check]:
    """Every body's own equations along a run of `general`, with poses from the joint angles."""
    given = {"model": "compliant", "stiffness": tuple(STIFFNESS), "damping": tuple(DAMPERS)}
    run = general("the general run with compliant grips", {"grips": given})
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
    energy, pulls = [], {}
    for k in rows:
        own = sum(0.5 * rates[i][k] @ points.arm_inertia(poses[i][k], i) @ rates[i][k] for i in range(2))
        own += 0.5 * rate[k] @ points.payload_inertia(p[k]) @ rate[k] + points.payload_potential(p[k])
        own += sum(points.arm_potential(poses[i][k], i) for i in range(2))
        both = [np.concatenate([run.pose[k], poses[i][k]]) for i in range(2)]
        moving = [np.concatenate([run.pose_rate[k], rates[i][k]]) for i in range(2)]
        energy.append(own + sum(0.5 * STIFFNESS @ apart(both[i], sides[i]) ** 2 for i in range(2)))
        pulls[k] = np.array([pull(both[i], moving[i], sides[i]) for i in range(2)])
    yield alike("T + V is that of mass points and springs: relative error", 1e-9, run.total_energy[rows], energy)
    grip_force, pulled = run.internal_force[rows] + run.moving_force[rows][:, None], np.array(list(pulls.values()))
    yield alike("the internal force is made of the grips' pulls: relative error", 1e-7, grip_force, pulled[:, :, :3])

    def force(k: int) -> np.ndarray:
        return np.concatenate([pulls[k][:, :3].sum(axis=0), -DAMPING * rate[k, 3:]])

    error = residual_force(run, lambda _: (points.payload_inertia, points.payload_potential), force)
    yield below("Lagrange's equations of the payload between the grips: relative residual", 1e-6, error)
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


def _stiff() -> Iterator[Check]:
    """The run comes to the paper's as k → ∞, at first order in 1/k."""
    found, calm = [], {"initial.pose_rate": None}
    exact = run_of("the paper's run without its jerk", {**calm, "simulation.step": 2e-5}, 0.2, 0.001)
    for stiffness in FIRM:
        firm = {"model": "compliant", "stiffness": (stiffness,) * 3, "damping": (stiffness**0.5,) * 3}
        run = run_of("the run with stiff grips", {**calm, "grips": firm}, 0.2, 0.001)
        force = np.abs(run.internal_force - exact.internal_force)[BEGUN:].max() / np.abs(exact.internal_force).max()
        found.append((np.abs(run.pose - exact.pose)[BEGUN:].max(), force))
    slope = np.log(np.divide(*found)) / np.log(FIRM[1] / FIRM[0])
    yield close(
        "stiffer grips: the pose comes to the paper's with 1/k to the power", 1.0, float(slope[0]), absolute=0.03
    )
    yield close("and the internal force", 1.0, float(slope[1]), absolute=0.1)
    yield below("beside which it is, as a part of its peak", 1e-3, float(found[1][1]))


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
    yield alike(
        "tapped between heavy arms: x0 = J/(mω) e^(-ct/m) sin ωt, ω² = 2k/m - c²/m²", 1e-3, run.pose[:, 0], expected
    )


def _sag() -> Iterator[Check]:
    """Deflection of the grips at rest under gravity."""
    soft = {"model": "compliant", "stiffness": (1e5, 4e4, 5e3), "damping": (200.0, 200.0, 20.0)}
    run = run_of("the run at rest in compliant grips", {**STILL, "gravity": 9.81, "grips": soft}, 2.0, 0.001)
    for name in ("left", "right"):
        found = float(run.own[f"{name}_grip_displacement"][-1, 1])
        yield close(
            f"at rest under gravity the {name} grip gives way across by mg/2k", 9.81 / 2 / 4e4, found, "m", 1e-5
        )
