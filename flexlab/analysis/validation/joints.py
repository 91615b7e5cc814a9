"""Joints with friction, against closed forms: momentum of a coasting arm, creep under load, what a controller compensates."""

from collections.abc import Iterator

import numpy as np

from flexlab.analysis.internal_force import internal_force_eq_26
from flexlab.analysis.validation.check import Check, Runs, below, close, run_of
from flexlab.analysis.validation.invariants import imbalance
from flexlab.physics.plant import P
from flexlab.presets import load_preset
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

SUBJECT, PLACE = "Joints that are not ideal", 10

COASTING = {
    "controller.kind": "none",
    "initial.pose_rate": (-0.3, 0.1, 0.4),
    "initial.beam_coordinates": None,
}
"""One arm whose motors are off."""
VISCOUS, COULOMB = 4.0, 0.3
"""N·m·s/rad and N·m in the first joint: the arm turns on for longer than it is looked at."""
FRICTION = {
    "joints.friction.viscous": (5.0, 5.0, 2.0),
    "joints.friction.coulomb": (8.0, 6.0, 2.0),
    "joints.friction.static_factor": 1.5,
}
HELD, CREEP = (300.0, 200.0, 50.0), 0.001
"""N·m: more than the weight of arm and beam asks for; and v_0, rad/s."""


def checks(runs: Runs) -> Iterator[Check]:
    """Momentum, creep, compensation, energy and internal force."""
    yield from _coasting()
    yield from _creeping()
    known = simulate(load_preset("paper").replace({**FRICTION, "controller.model.friction_factor": 1.0}), 1.0)
    yield below(
        "the paper's run with friction that its controller knows: pose beside that without friction, m or rad",
        1e-9,
        float(np.abs(known.pose - runs.paper.pose[: len(known.time)]).max()),
    )
    for name in ("etdrk4", "rk4", "generalized-alpha"):
        changes = {**FRICTION, "simulation.integrator": name, "simulation.step": 1e-5}
        run = run_of(f"the run with friction ({name})", changes, 0.2, 0.001)
        yield below(
            f"{name}: energy gained = work put in - energy damped - loss in the joints, as a part of the work",
            1e-6,
            imbalance(run) / float(np.ptp(run.input_work)),
        )
    run = run_of("the run with friction", FRICTION, 0.1, 0.001)
    away = float(np.abs(internal_force_eq_26(run) - run.internal_force).max() / np.abs(run.internal_force).max())
    yield below(
        "internal force with friction, by Eq. (26) and by Eqs. (13)-(15): largest difference, as a part", 1e-9, away
    )


def _coasting() -> Iterator[Check]:
    """The arm's moment of momentum about its base changes by the torque of the first joint alone."""
    turned, fallen, _ = moment_of_momentum({"joints.friction.viscous": (VISCOUS, 2.0, 1.0)})
    yield close(
        "one arm coasts with viscous friction B: its moment of momentum falls by B times the angle of its first joint, N·m·s",
        VISCOUS * turned,
        fallen,
        relative=1e-7,
    )
    dry = {"joints.friction.coulomb": (COULOMB, 0.05, 0.01), "joints.friction.smoothing_speed": CREEP}
    _, fallen, _ = moment_of_momentum(dry, 0.2)
    yield close("the same with Coulomb friction C: by C times the time, N·m·s", COULOMB * 0.2, fallen, relative=1e-3)
    run = simulate(load_preset("single-arm").replace({**COASTING, **dry}), 0.2)
    idle = float(np.abs(run.input_work).max() / run.own["friction_loss"][-1])
    yield below("its motors, which are off, do no work, as a part of friction's loss", 1e-6, idle)


def moment_of_momentum(joints: dict[str, object], duration: float = 0.5) -> tuple[float, float, float]:
    """Of an arm that coasts: angle by which its first joint turns, rad, fall of its moment of momentum, N·m·s, and time, s."""
    world = World(load_preset("single-arm").replace({**COASTING, **joints}))
    x, y = world.scenario.left_arm.base

    def moment() -> float:
        state = world.state().y
        return float(state[P + 1] * (state[0] - x) - state[P] * (state[1] - y) + state[P + 2])

    angle, before = world.observe().joint_angle[-1, 0, 0], moment()
    end = world.advance(round(duration / world.tick_period))
    sign = np.sign(end.joint_angle[-1, 0, 0] - angle)
    return float(sign * (end.joint_angle[-1, 0, 0] - angle)), float(sign * (before - moment())), duration


def _creeping() -> Iterator[Check]:
    """Joints that stick under the weight creep by v_0 r/√(1 - r²), r: weight's torque over static friction."""
    changes = {
        "controller.kind": "none",
        "gravity": 9.81,
        "initial.pose_rate": (0.0, 0.0, 0.0),
        "joints.friction.coulomb": HELD,
        "joints.friction.smoothing_speed": CREEP,
    }
    run = simulate(load_preset("single-arm").replace(changes), 1.5, 0.01)
    near = run.joint_angle[-20:, 0]
    rate = (near[-1] - near[0]) / (run.time[-1] - run.time[-20])
    share = _weight(run.scenario.left_arm, run.scenario.payload, near.mean(axis=0)) / np.array(HELD)
    for joint, (r, found) in enumerate(zip(share, rate, strict=True), start=1):
        expected = -CREEP * r / np.sqrt(1 - r * r)
        yield close(
            f"motors off, weight: joint {joint} sticks and creeps by v_0 r/√(1 - r²)", expected, found, "rad/s", 1e-3
        )


def _weight(arm, payload, angle: np.ndarray) -> np.ndarray:
    """Torque of the weight about each joint, N·m, for relative angles (3,), the beam straight."""
    turned = np.cumsum(angle)
    mass = [*arm.link_mass, payload.linear_density * payload.length]
    outwards = [*arm.link_center[:2], arm.link_center[2], arm.link_length[2] + payload.length / 2]
    joints = np.concatenate([[0.0], np.cumsum(np.array(arm.link_length[:2]) * np.cos(turned[:2]))])
    places = [joints[min(k, 2)] + outwards[k] * np.cos(turned[min(k, 2)]) for k in range(4)]
    return np.array(
        [9.81 * sum(mass[k] * (places[k] - joints[j]) for k in range(4) if min(k, 2) >= j) for j in range(3)]
    )
