"""Encoders that count, against rounding by hand, the mean square of rounding, and a loop that differences its pose."""

from collections.abc import Iterator

import numpy as np

from flexlab.analysis.linearize import linearize
from flexlab.analysis.validation.check import Check, Runs, below, close
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.closed_loop import own_states_of
from flexlab.sim.world import World

SUBJECT, PLACE = "Encoders", 11

PERIOD = 0.001
COUNTS = (20000.0, 16384.0, 9000.0)
"""Per turn of each joint."""
COUNT = 2 * np.pi / np.array(COUNTS)
CLOCKED = {"controller.control_period": PERIOD, "joints.encoders.counts": COUNTS}
READ = 2000
"""Instants."""
GAINS = {"controller.kind": "pd", "controller.position_gain": 8000.0, "controller.velocity_gain": 900.0}
FINEST = (1e9, 1e9, 1e9)
"""Counts that round nothing to speak of."""
OFFSET, INSTANTS = (1e-4, -5e-5, 8e-5), 30
"""m, m, rad; and control periods in which it is led back."""


def checks(runs: Runs) -> Iterator[Check]:
    """What is told of the pose and of its rate, and what the rate's lag does to a loop."""
    del runs
    for words, scenario in (
        ("one arm", load_preset("single-arm").replace({**CLOCKED, "controller.control_period": PERIOD / 5})),
        ("two arms", load_preset("paper").replace(CLOCKED)),
    ):
        arms = len(scenario.arms)
        told, pose, angle = _readings(scenario)
        rounded = np.stack([_forward(scenario, i, np.round(angle[:, i] / COUNT) * COUNT) for i in range(arms)])
        yield below(
            f"encoders of {words}: what they tell is the mean of the poses of rounded angles, m or rad",
            1e-12,
            float(np.abs(told - rounded.mean(axis=0)).max()),
        )
        off = (told - pose)[:, 2]
        yield below(f"{words}: θ is off by half a count of each joint at most, as a part", 1.0, _part(off))
        expected = float(np.sum(COUNT**2) / 12 / arms)
        yield close(f"{words}: mean square of what rounding does to θ, ΣΔ²/12 over the arms, rad²", expected,
                    float(np.mean(off**2)), relative=0.06)  # fmt: skip
    yield from _rate()
    yield from _differenced()


def _part(off: np.ndarray) -> float:
    return float(np.abs(off).max() / (COUNT.sum() / 2))


def _readings(scenario: Scenario) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Told pose (N, 3), true pose (N, 3), joint angles (N, arms, 3) at control instants."""
    world, told, poses, angles = World(scenario, scenario.controller.control_period), [], [], []
    for _ in range(READ):
        now = world.advance(1)
        told.append(own_states_of(world.system, world.state().y)["reading"].copy())
        poses.append(now.pose[-1])
        angles.append(now.joint_angle[-1])
    return np.array(told), np.array(poses), np.array(angles)


def _forward(scenario: Scenario, number: int, angle: np.ndarray) -> np.ndarray:
    """Pose (N, 3) of an arm's relative angles (N, 3): the payload's middle is half its length before the grip."""
    arm, side = scenario.arms[number], 1 - 2 * number
    turned = np.cumsum(angle, axis=1)
    outwards = [*arm.link_length[:2], arm.link_length[2] + scenario.payload.length / 2]
    x = arm.base[0] + np.sum(outwards * np.cos(turned), axis=1)
    y = arm.base[1] + np.sum(outwards * np.sin(turned), axis=1)
    return np.stack([x, y, turned[:, 2] - np.pi * (side < 0)], axis=1)


def _rate() -> Iterator[Check]:
    """A law that answers the rate alone shows what it is told."""
    law = {"controller": {"kind": "pd", "position_gain": 0.0, "velocity_gain": 1.0, "control_period": PERIOD}}
    still = {"trajectory": {"kind": "hold", "pose": (0.0, 0.75, 0.0)}, "initial.pose_rate": (0.1, -0.2, 0.3)}
    scenario = load_preset("paper").replace({**law, **still, "joints.encoders.counts": COUNTS})
    world, told, answers = World(scenario, PERIOD), [], []
    for _ in range(100):
        now = world.advance(1)
        told.append(own_states_of(world.system, world.state().y)["reading"].copy())
        answers.append(-now.arm_input[-1].sum(axis=0))
    differences = np.diff(told, axis=0) / PERIOD
    away = float(np.abs(differences - answers[1:]).max() / np.abs(differences).max())
    yield below("the rate is the difference of two readings over T_c: largest error, as a part", 1e-3, away)


def _differenced() -> Iterator[Check]:
    """The linear model remembers the pose before; without, it would damp as if the rate did not lag by T_c/2."""
    pose = (0.0, 0.75, 0.0)
    still = {"trajectory": {"kind": "hold", "pose": pose}, "controller.control_period": PERIOD}
    scenario = load_preset("paper").replace({**GAINS, **still, "joints.encoders.counts": FINEST})
    model = linearize(scenario, pose=pose, inputs="desired_pose", outputs="pose")
    A = np.asarray(model.A)
    z = np.zeros(len(A))
    z[:3] = z[-3:] = OFFSET
    for _ in range(INSTANTS):
        z = A @ z
    start = tuple(np.add(pose, OFFSET))
    world = World(scenario.replace({"initial.pose": start, "initial.pose_rate": (0.0, 0.0, 0.0)}), PERIOD)
    led_back = world.advance(INSTANTS).pose[-1] - pose
    away = float(np.abs(z[:3] - led_back).max() / np.abs(OFFSET).max())
    yield below(
        "PD with differenced rates: pose 30 instants after an offset, by the linear model, as a part", 1e-3, away
    )
