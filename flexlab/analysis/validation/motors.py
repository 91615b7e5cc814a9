"""Motors that are late and have a speed, against closed forms: a held torque, a coasting arm, the limit of no lag, energy."""

from collections.abc import Iterator

import numpy as np

from flexlab.analysis.internal_force import internal_force_eq_26
from flexlab.analysis.linearize import linearize
from flexlab.analysis.validation.check import Check, Runs, above, below, close, run_of
from flexlab.analysis.validation.invariants import imbalance
from flexlab.analysis.validation.joints import moment_of_momentum
from flexlab.presets import load_preset
from flexlab.sim.world import World

SUBJECT, PLACE = "Motors", 12

LATE, PERIOD = 0.004, 0.001
"""T_m and control period, s."""
STALL, FREE = (450.0, 250.0, 90.0), (7.0, 6.0, 9.0)
"""N·m, rad/s: the paper's start asks for more, its steady motion for less."""
CURVE = {"joints.motor.stall_torque": STALL, "joints.motor.no_load_speed": FREE}
WHOLE = {**CURVE, "joints.motor.time_constant": LATE, "joints.friction.viscous": (5.0, 5.0, 2.0)}
SLOW, WEAK = 0.01, 0.05
"""rad/s and N·m: a coasting arm turns faster than such a motor would without load."""
OFFSET, INSTANTS = (1e-4, -5e-5, 8e-5), 30
"""m, m, rad; and control periods in which it is led back."""


def checks(runs: Runs) -> Iterator[Check]:
    """Lag, torque-speed curve, energy, internal force, linear model."""
    yield from _lag()
    yield from _ideal_limit(runs)
    yield from _curve()
    for name in ("etdrk4", "rk4", "generalized-alpha"):
        changes = {**WHOLE, "simulation.integrator": name, "simulation.step": 1e-5}
        run = run_of(f"the run with motors ({name})", changes, 0.2, 0.001)
        yield below(
            f"{name}: energy gained = the motors' work - energy damped - loss in the joints, as a part of the work",
            1e-6,
            imbalance(run) / float(np.ptp(run.input_work)),
        )
    run = run_of("the run with motors", WHOLE, 0.1, 1e-4)
    middle = (run.joint_torque[1:] + run.joint_torque[:-1]) / 2
    work = np.cumsum((middle * np.diff(run.joint_angle, axis=0)).sum(axis=(1, 2)))
    away = float(np.abs(work - (run.input_work[1:] - run.input_work[0])).max() / np.ptp(run.input_work))
    yield below("work put in = ∫Στ dθ of what motors give, as a part", 1e-4, away)
    away = float(np.abs(internal_force_eq_26(run) - run.internal_force).max() / np.abs(run.internal_force).max())
    yield below(
        "internal force with motors, by Eq. (26) and by Eqs. (13)-(15): largest difference, as a part", 1e-9, away
    )
    yield from _linear_model()


def _asked(run) -> np.ndarray:
    """(N, arms, 3)."""
    return np.stack([run.own["left_asked_torque"], run.own["right_asked_torque"]], axis=1)


def _lag() -> Iterator[Check]:
    """What is asked for stands still for a control period."""
    changes = {"controller.control_period": PERIOD, "joints.motor.time_constant": LATE, "simulation.step": 1e-5}
    run = run_of("the clocked run with late motors", changes, 0.1, PERIOD)
    asked, given = _asked(run), run.joint_torque
    expected = asked[:-1] + (given[:-1] - asked[:-1]) * np.exp(-PERIOD / LATE)
    yield below(
        "a torque that is asked for is reached as 1 - exp(-t/T_m): largest error, as a part of it",
        1e-8,
        float(np.abs(given[1:] - expected).max() / np.abs(asked).max()),
    )
    yield below("motors begin with no torque, N·m", 1e-12, given[0])


def _ideal_limit(runs: Runs) -> Iterator[Check]:
    """A lag that becomes short changes the run in proportion to it."""
    away = []
    for late in (2e-4, 1e-4):
        run = run_of("the run with a short lag", {"joints.motor.time_constant": late}, 1.0, 0.001)
        away.append(float(np.abs(run.pose - runs.paper.pose[: len(run.time)]).max()))
    yield close("half the time constant: half the way from the paper's run, 1", 2.0, away[0] / away[1], relative=0.02)


def _curve() -> Iterator[Check]:
    turned, fallen, time = moment_of_momentum(
        {"joints.motor.stall_torque": (WEAK, 0.0, 0.0), "joints.motor.no_load_speed": (SLOW, 1.0, 1.0)}
    )
    yield close(
        "one arm coasts faster than its motor's no-load speed: its moment of momentum falls by τ_s (angle/ω_0 - t), N·m·s",
        WEAK * (turned / SLOW - time),
        fallen,
        relative=1e-6,
    )
    run = run_of("the run with weak motors", CURVE, 0.05, 1e-5)
    rate, asked = np.gradient(run.joint_angle, run.time, axis=0), _asked(run)
    stall, fall = np.array(STALL), np.array(STALL) / np.array(FREE)
    possible = np.clip(asked, -stall - fall * rate, stall - fall * rate)
    inside = slice(2, -2)
    yield below(
        "motors give what is asked for between -τ_s (1 + θ̇/ω_0) and τ_s (1 - θ̇/ω_0): largest error, as a part",
        1e-4,
        float(np.abs(run.joint_torque - possible)[inside].max() / np.abs(possible).max()),
    )
    yield above("instants at which they give less", 100, int((np.abs(asked - possible) > 1.0).any(axis=(1, 2)).sum()))


def _linear_model() -> Iterator[Check]:
    pose = (0.0, 0.75, 0.0)
    still = {"trajectory": {"kind": "hold", "pose": pose}, "controller.control_period": PERIOD}
    gains = {"controller.kind": "pd", "controller.position_gain": 8000.0, "controller.velocity_gain": 900.0}
    scenario = load_preset("paper").replace({**gains, **still, "joints.motor.time_constant": LATE})
    A = np.asarray(linearize(scenario, pose=pose, inputs="desired_pose", outputs="pose").A)
    z = np.zeros(len(A))
    z[:3] = OFFSET
    for _ in range(INSTANTS):
        z = A @ z
    start = tuple(np.add(pose, OFFSET))
    world = World(scenario.replace({"initial.pose": start, "initial.pose_rate": (0.0, 0.0, 0.0)}), PERIOD)
    led_back = world.advance(INSTANTS).pose[-1] - pose
    away = float(np.abs(z[:3] - led_back).max() / np.abs(OFFSET).max())
    yield below("PD with late motors: pose 30 instants after an offset, by the linear model, as a part", 1e-3, away)
