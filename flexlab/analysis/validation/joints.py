"""Joints that are not ideal: friction, encoders and motors, against closed forms."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexlab.analysis.linearize import linearize
from flexlab.analysis.validation.check import (
    STILL,
    Check,
    Runs,
    above,
    alike,
    balanced,
    below,
    close,
    run_of,
    same_internal_force,
    subject,
    true,
)
from flexlab.analysis.validation.mass_points import MassPoints, pose_by_angles, time_derivative
from flexlab.physics.plant import P
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.closed_loop import own_states_of
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

PERIOD = 0.001
"""Control period, s."""
SHORT = 1e-4
"""Sample period of the run whose friction is compared with the formula, s."""
INTEGRATORS = ("etdrk4", "rk4", "generalized-alpha")
COASTING = {"controller.kind": "none", "initial.pose_rate": (-0.3, 0.1, 0.4), "initial.beam_coordinates": None}
"""The preset single-arm with motors off."""
VISCOUS, COULOMB = 4.0, 0.3
"""Friction in the first joint, N·m·s/rad and N·m, under which the arm does not come to rest within the run."""
FRICTION = {
    "joints.friction.viscous": (5.0, 5.0, 2.0),
    "joints.friction.coulomb": (8.0, 6.0, 2.0),
    "joints.friction.static_factor": 1.5,
}
HELD, CREEP = (300.0, 200.0, 50.0), 0.01
"""Static friction, N·m, larger than the torque of the weight; and v_0, rad/s."""


@subject("Joints that are not ideal", 11)
def friction(runs: Runs) -> Iterator[Check]:
    """Momentum, creep, compensation, energy and internal force with friction in the joints."""
    yield from _coasting()
    yield from _creeping()
    known = simulate(load_preset("paper").replace({**FRICTION, "controller.model.friction_factor": 1.0}), 1.0)
    statement = "the paper's run with friction that its controller knows: pose beside that without friction, m or rad"
    yield below(statement, 1e-9, known.pose - runs.paper.pose[: len(known.time)])
    yield from _energy("friction", FRICTION, "work put in")
    run = run_of("the run with friction", FRICTION, 0.1, SHORT)
    rate = time_derivative(run.joint_angle, SHORT)
    torque = _stribeck(run.scenario.joints.friction, rate)
    told = np.stack([run.own["left_joint_friction"], run.own["right_joint_friction"]], axis=1)[2:-2]
    yield alike("the torque of friction, arm by arm: largest error, as a part", 1e-4, told, torque)
    lost = np.sum(torque * rate, axis=(1, 2))
    statement = (
        "friction takes Στ_f θ̇, τ_f = Bθ̇ + C [1 + (σ_f - 1)/(1 + (θ̇/v_s)²)] θ̇/√(θ̇² + v_0²): largest error, as a part"
    )
    yield alike(statement, 1e-4, time_derivative(run.own["friction_loss"], SHORT), lost)
    statement = "internal force with friction, by Eq. (26) and by Eqs. (13)-(15): largest difference, as a part"
    yield same_internal_force(statement, run)


def _stribeck(friction: Any, rate: np.ndarray) -> np.ndarray:
    """Friction torque of each joint, N·m, that turns with `rate`, rad/s, (…, 3)."""
    rising = (friction.static_factor - 1) / (1 + (rate / friction.stribeck_speed) ** 2)
    sliding = np.array(friction.coulomb) * (1 + rising) * rate / np.hypot(rate, friction.smoothing_speed)
    return np.array(friction.viscous) * rate + sliding


def _energy(what: str, joints: dict[str, Any], work: str) -> Iterator[Check]:
    """The balance of energy of the paper's run with such joints, under each integrator."""
    for name in INTEGRATORS:
        changes = {**joints, "simulation.integrator": name, "simulation.step": 1e-5}
        run = run_of(f"the run with {what} ({name})", changes, 0.2, 0.001)
        statement = f"{name}: energy gained = {work} - energy damped - loss in the joints, as a part of the work"
        yield balanced(statement, run, float(np.ptp(run.input_work)))


def _coasting() -> Iterator[Check]:
    """The arm's moment of momentum about its base changes by the torque of the first joint alone."""
    turned, fallen = moment_of_momentum({"joints.friction.viscous": (VISCOUS, 2.0, 1.0)})
    statement = "its moment of momentum falls by B times the angle of its first joint, N·m·s"
    yield close(f"one arm coasts with viscous friction B: {statement}", VISCOUS * turned, fallen, relative=1e-7)
    dry = {"joints.friction.coulomb": (COULOMB, 0.05, 0.01), "joints.friction.smoothing_speed": CREEP}
    _, fallen = moment_of_momentum(dry, 0.2)
    yield close("the same with Coulomb friction C: by C times the time, N·m·s", COULOMB * 0.2, fallen, relative=1e-3)
    run = simulate(load_preset("single-arm").replace({**COASTING, **dry}), 0.2)
    idle = float(np.abs(run.input_work).max() / run.own["friction_loss"][-1])
    yield below("its motors, which are off, do no work, as a part of friction's loss", 1e-6, idle)


def moment_of_momentum(joints: dict[str, object], duration: float = 0.5) -> tuple[float, float]:
    """Angle of a coasting arm's first joint, rad, and loss of its moment of momentum, N·m·s, within a duration, s."""
    world = World(load_preset("single-arm").replace({**COASTING, **joints}))
    x, y = world.scenario.left_arm.base

    def moment() -> float:
        state = world.state().y
        return float(state[P + 1] * (state[0] - x) - state[P] * (state[1] - y) + state[P + 2])

    angle, before = world.observe().joint_angle[-1, 0, 0], moment()
    turned = float(world.advance(round(duration / world.tick_period)).joint_angle[-1, 0, 0] - angle)
    return abs(turned), float(np.sign(turned) * (before - moment()))


def _creeping() -> Iterator[Check]:
    """Joints that stick under the weight creep by v_0 r/√(1 - r²), r: weight's torque over static friction."""
    changes = {
        "controller.kind": "none",
        "gravity": 9.81,
        "initial.pose_rate": (0.0, 0.0, 0.0),
        "joints.friction.coulomb": HELD,
        "joints.friction.smoothing_speed": CREEP,
    }
    run = simulate(load_preset("single-arm").replace(changes), 1.1, 0.01)
    near = run.joint_angle[-20:, 0]
    rate = (near[-1] - near[0]) / (run.time[-1] - run.time[-20])
    share = _weight(run.scenario.left_arm, run.scenario.payload, near.mean(axis=0)) / np.array(HELD)
    for joint, (r, found) in enumerate(zip(share, rate, strict=True), start=1):
        statement = f"motors off, weight: joint {joint} sticks and creeps by v_0 r/√(1 - r²)"
        yield close(statement, -CREEP * r / np.sqrt(1 - r * r), found, "rad/s", 1e-3)


def _weight(arm, payload, angle: np.ndarray) -> np.ndarray:
    """Torque of the weight about each joint, N·m, for relative angles (3,), the beam straight."""
    turned = np.cumsum(angle)
    mass = [*arm.link_mass, payload.linear_density * payload.length]
    outwards = [*arm.link_center[:2], arm.link_center[2], arm.link_length[2] + payload.length / 2]
    joints = np.concatenate([[0.0], np.cumsum(np.array(arm.link_length[:2]) * np.cos(turned[:2]))])
    places = [joints[min(k, 2)] + outwards[k] * np.cos(turned[min(k, 2)]) for k in range(4)]
    carried = [[k for k in range(4) if min(k, 2) >= j] for j in range(3)]
    return 9.81 * np.array([sum(mass[k] * (places[k] - joints[j]) for k in carried[j]) for j in range(3)])


COUNTS = (20000.0, 16384.0, 9000.0)  # per turn of each joint
CLOCKED = {"controller.control_period": PERIOD, "joints.encoders.counts": COUNTS}
READ = 2000
"""Number of control instants at which encoders are read."""
GAINS = {"controller.kind": "pd", "controller.position_gain": 8000.0, "controller.velocity_gain": 900.0}
FINEST = (1e9, 1e9, 1e9)
"""Counts per turn so fine that rounding does not show."""
OFFSET, INSTANTS = (1e-4, -5e-5, 8e-5), 30
"""Initial offset of the pose, m, m, rad, and number of control periods in which the loop reduces it."""


@subject("Encoders", 12)
def encoders(_: Runs) -> Iterator[Check]:
    """The pose that encoders give, its rate, and the effect of the rate's lag on a loop."""
    for words, scenario in (
        ("one arm", load_preset("single-arm").replace({**CLOCKED, "controller.control_period": PERIOD / 5})),
        ("two arms", load_preset("paper").replace(CLOCKED)),
    ):
        count = _count(scenario)
        arms = len(scenario.arms)
        told, now = _readings(scenario, READ)
        pose, angle = (np.array([each[name][-1] for each in now]) for name in ("pose", "joint_angle"))
        statement = f"encoders of {words}: what they tell is the mean of the poses of rounded angles, m or rad"
        yield below(statement, 1e-12, told - _read(scenario, angle))
        off = (told - pose)[:, 2]
        yield below(f"{words}: θ is off by half a count of each joint at most, as a part", 1.0, off / (count.sum() / 2))
        statement = f"{words}: mean square of what rounding does to θ, ΣΔ²/12 over the arms, rad²"
        yield close(statement, float(np.sum(count**2) / 12 / arms), float(np.mean(off**2)), relative=0.06)
    alone = load_preset("paper").replace({**CLOCKED, "joints.encoders.counts": (0, 0, COUNTS[2])})
    told, now = _readings(alone, 20)
    angle = np.array([each["joint_angle"][-1] for each in now])
    yield below(
        "encoders of the last joints alone: the others tell their angles, m or rad", 1e-12, told - _read(alone, angle)
    )
    # A law that responds to the rate alone shows the rate that encoders give.
    law = {"controller": {"kind": "pd", "position_gain": 0.0, "velocity_gain": 1.0, "control_period": PERIOD}}
    moving = {"initial.pose_rate": (0.1, -0.2, 0.3), "joints.encoders.counts": COUNTS}
    for words, grips in (("", {}), ("in compliant grips: ", {"grips.model": "compliant"})):
        scenario = load_preset("paper").replace({**law, **STILL, **moving, **grips})
        told, samples = _readings(scenario, 100)
        answers = [-now.arm_input[-1].sum(axis=0) for now in samples]
        # Before the first instant the pose is taken to have moved at its present rate.
        points, ago = MassPoints(scenario), samples[0].pose[-1] - PERIOD * samples[0].pose_rate[-1]
        first = _read(scenario, np.array([[points.joint_angles(ago, arm) for arm in range(2)]]))
        differences = np.diff(told, axis=0, prepend=first) / PERIOD
        statement = f"{words}the rate is the difference of two readings over T_c, from the first instant on"
        yield alike(f"{statement}: largest error, as a part", 1e-3, answers, differences)
    readings = _read(scenario, np.array([now.joint_angle[-1] for now in samples]))
    yield below("and they are those of each arm's own angles, m or rad", 1e-12, told - readings)
    # Without the previous pose among its states, the linear model would damp as if the rate did not lag by T_c/2.
    statement = "PD with differenced rates: pose 30 instants after an offset, by the linear model, as a part"
    yield _led_back(statement, {"joints.encoders.counts": FINEST})


def _count(scenario: Scenario) -> np.ndarray:
    """Angle of a count of each joint, rad, (3,); 0: exact."""
    return np.array([2 * np.pi / number if number else 0.0 for number in scenario.joints.encoders.counts])


def _read(scenario: Scenario, angle: np.ndarray) -> np.ndarray:
    """The mean over the arms (N, 3) of the poses of rounded joint angles (N, arms, 3)."""
    count = _count(scenario)
    read = np.where(count > 0, np.round(angle / np.maximum(count, 1e-9)) * count, angle)
    return np.mean([pose_by_angles(scenario, arm, read[:, arm]) for arm in range(len(scenario.arms))], axis=0)


def _readings(scenario: Scenario, count: int) -> tuple[np.ndarray, list[Samples]]:
    """The pose that encoders give, (N, 3), and the samples, at control instants from t = 0 on."""
    world, told, samples = World(scenario, scenario.controller.control_period), [], []
    for _ in range(count):
        samples.append(world.observe())
        told.append(own_states_of(world.system, world.state().y)["reading"].copy())
        world.advance(1)
    return np.array(told), samples


def _led_back(statement: str, joints: dict[str, Any]) -> Check:
    """The pose 30 control periods after an offset under PD, by the linear model and by the simulation."""
    scenario = load_preset("paper").replace({**GAINS, **STILL, "controller.control_period": PERIOD, **joints})
    pose = scenario.trajectory.pose
    A = np.asarray(linearize(scenario, pose=pose, inputs="desired_pose", outputs="pose").A)
    z = np.zeros(len(A))
    z[:3] = OFFSET
    if scenario.joints.encoders.active:  # The law remembers the previous pose: the model's last three states.
        z[-3:] = OFFSET
    z = np.linalg.matrix_power(A, INSTANTS) @ z
    start = tuple(np.add(pose, OFFSET))
    world = World(scenario.replace({"initial.pose": start, "initial.pose_rate": (0.0, 0.0, 0.0)}), PERIOD)
    led_back = world.advance(INSTANTS).pose[-1] - pose
    return alike(statement, 1e-3, z[:3], led_back, OFFSET)


LATE = 0.004  # T_m, s
STALL, FREE = (450.0, 250.0, 90.0), (7.0, 6.0, 9.0)
"""Stall torques, N·m, and no-load speeds, rad/s; the paper's run needs more at its start, and less later."""
CURVE = {"joints.motor.stall_torque": STALL, "joints.motor.no_load_speed": FREE}
WHOLE = {**CURVE, "joints.motor.time_constant": LATE, "joints.friction.viscous": (5.0, 5.0, 2.0)}
SLOW, WEAK = 0.01, 0.05
"""No-load speed, rad/s, slower than a coasting arm turns, and stall torque, N·m."""


@subject("Motors", 13)
def motors(runs: Runs) -> Iterator[Check]:
    """Lag, torque-speed curve, energy, internal force and linear model of motors."""
    yield from _lag()
    away = []
    for late in (2e-4, 1e-4):
        run = run_of("the run with a short lag", {"joints.motor.time_constant": late}, 1.0, 0.001)
        away.append(float(np.abs(run.pose - runs.paper.pose[: len(run.time)]).max()))
    yield close("half the time constant: half the way from the paper's run, 1", 2.0, away[0] / away[1], relative=0.02)
    yield from _curve()
    yield from _energy("motors", WHOLE, "the motors' work")
    run = run_of("the run with motors", WHOLE, 0.1, 1e-4)
    middle = (run.joint_torque[1:] + run.joint_torque[:-1]) / 2
    work = np.cumsum((middle * np.diff(run.joint_angle, axis=0)).sum(axis=(1, 2)))
    away = float(np.abs(work - (run.input_work[1:] - run.input_work[0])).max() / np.ptp(run.input_work))
    yield below("work put in = ∫Στ dθ of what motors give, as a part", 1e-4, away)
    statement = "internal force with motors, by Eq. (26) and by Eqs. (13)-(15): largest difference, as a part"
    yield same_internal_force(statement, run)
    statement = "PD with late motors: pose 30 instants after an offset, by the linear model, as a part"
    yield _led_back(statement, {"joints.motor.time_constant": LATE})


def _asked(run) -> np.ndarray:
    """The torques that the law asks for, N·m, (N, arms, 3)."""
    return np.stack([run.own["left_asked_torque"], run.own["right_asked_torque"]], axis=1)


def _lag() -> Iterator[Check]:
    """The motors' torques between control instants, while the torques asked for are constant."""
    changes = {"controller.control_period": PERIOD, "joints.motor.time_constant": LATE, "simulation.step": 1e-5}
    run = run_of("the clocked run with late motors", changes, 0.1, PERIOD)
    asked, given = _asked(run), run.joint_torque
    expected = asked[:-1] + (given[:-1] - asked[:-1]) * np.exp(-PERIOD / LATE)
    statement = "a torque that is asked for is reached as 1 - exp(-t/T_m): largest error, as a part of it"
    yield alike(statement, 1e-8, given[1:], expected, asked)
    yield below("motors begin with no torque, N·m", 1e-12, given[0])


def _curve() -> Iterator[Check]:
    weak = {"joints.motor.stall_torque": (WEAK, 0.0, 0.0), "joints.motor.no_load_speed": (SLOW, 1.0, 1.0)}
    turned, fallen = moment_of_momentum(weak, 0.5)
    statement = "its moment of momentum falls by τ_s (angle/ω_0 - t), N·m·s"
    statement = f"one arm coasts faster than its motor's no-load speed: {statement}"
    yield close(statement, WEAK * (turned / SLOW - 0.5), fallen, relative=1e-6)
    run = run_of("the run with weak motors", CURVE, 0.05, 1e-5)
    rate, asked = np.gradient(run.joint_angle, run.time, axis=0), _asked(run)
    stall, fall = np.array(STALL), np.array(STALL) / np.array(FREE)
    possible = np.clip(asked, -stall - fall * rate, stall - fall * rate)
    statement = "motors give what is asked for between -τ_s (1 + θ̇/ω_0) and τ_s (1 - θ̇/ω_0): largest error, as a part"
    yield alike(statement, 1e-4, run.joint_torque[2:-2], possible[2:-2], possible)
    less = np.abs(asked - possible)[2:-2].max(axis=(1, 2))
    yield above("instants at which they give less", 100, int((less > 1.0).sum()))
    sure = (less == 0) | (less > 1.0)  # A difference in between may be the derivative's error.
    yield true("which the run says at each instant", np.array_equal(run.saturated[2:-2][sure], less[sure] > 1.0))
