"""Linear models of a sampled loop against a run of it, its disk margin, and the frequencies that sampling folds."""

from collections.abc import Iterator

import numpy as np
from scipy.signal import dlsim

from flexlab.analysis.linearize import linearize
from flexlab.analysis.modes import fastest_growth, modes, rings_of
from flexlab.analysis.validation.check import CENTER, UNEQUAL, Check, Runs, alike, below, close, run_of, subject
from flexlab.analysis.validation.mass_points import MassPoints, linear_plant
from flexlab.analysis.validation.observers import held_over
from flexlab.analysis.validation.sampled_loop import PERIOD
from flexlab.control.motion import poses
from flexlab.presets import load_preset
from flexlab.sim.target import build_trajectory

LAW = {"kind": "disturbance-observer", "control_period": PERIOD, "input_delay": 2}
"""A law with a memory, whose torques come two periods late."""
GAIN, SLOPE, FORGETS = 200.0, 50.0, 20.0
"""Its K, Λ and ℓ."""
BEGIN, END = np.array((0.05, 0.8, 0.2)), np.array((0.05, 0.8, 0.2)) + (1e-5, 7e-6, 5e-6)
"""Ends of a motion that is so small that linear models hold, m, m, rad."""
SHOWN = ("pose", "joint_torque", "internal_force", "midspan_deflection")
FOLDED = range(4, 8)
"""Modes of eight elements that ring above half the rate of a clock of 1 kHz."""
TOO_LATE = {"kind": "pd", "position_gain": 2e4, "velocity_gain": 200.0, "control_period": 0.02}
"""A law under which the pose swings and grows."""


@subject("Sampled linear models", 20)
def sampled_models(_: Runs) -> Iterator[Check]:
    """A run beside a linear model, the disk margin, growth, folded frequencies."""
    yield from _followed()
    margin = modes(load_preset("paper").replace({"controller": LAW})).disk_margin
    assert margin is not None
    statement = "disk margin of a sampled law with a memory and two samples of delay: α of all motors together"
    yield close(statement, _margin(), margin.alike.alpha, relative=1e-3)
    damping = {"payload.element_count": 8, "payload.damping.coefficient": 0.0, "controller.kind": "vibration-damping"}
    clocked = damping | {"controller.control_period": PERIOD, "controller.input_delay": 1}
    # The clock hardly changes how fast modes ring.
    told, exact = (rings_of(modes(load_preset("paper").replace(changes))) for changes in (clocked, damping))
    off = [told[mode].frequency / exact[mode].frequency - 1 for mode in FOLDED]
    yield below("modes beyond half the clock's rate ring as under a continuous law: relative difference", 0.01, off)
    late = modes(load_preset("paper").replace({"controller": TOO_LATE}))
    fastest, worst = fastest_growth(late), late.poles[np.argmax(late.poles.real)]
    told = [] if fastest is None else [fastest.frequency, fastest.rate]
    statement = "a pose that grows: frequency, Hz, and rate, 1/s, are those of its pole: relative error"
    yield alike(statement, 1e-9, told, [abs(worst.imag) / (2 * np.pi), worst.real])
    rows = [row for row in late.pole_rows() if row.frequency]
    size, ratio = 2 * np.pi * np.array([row.frequency for row in rows]), np.array([row.damping_ratio for row in rows])
    found = size * (-ratio + 1j * np.sqrt(1 - ratio**2))
    apart = np.abs(found[:, None] - late.poles).min(axis=1) / size
    yield below("poles are -ζω ± iω√(1 - ζ²) of the table's frequencies and ratios: relative distance", 1e-9, apart)


def _followed() -> Iterator[Check]:
    """A small motion of unequal arms."""
    path = {"kind": "rest-to-rest", "from": tuple(BEGIN), "to": tuple(END), "start": 0.003, "duration": 0.02}
    changes = {**UNEQUAL, "trajectory": path, "controller": LAW, "initial.pose": tuple(BEGIN)}
    run = run_of("the small motion", {**changes, "initial.pose_rate": (0.0, 0.0, 0.0)}, 0.06, PERIOD)
    inputs = ("desired_pose", "desired_pose_rate", "desired_pose_acceleration")
    model = linearize(run.scenario, tuple(BEGIN), inputs, SHOWN)
    asked = poses(build_trajectory(run.scenario), run.time) - np.array([BEGIN, np.zeros(3), np.zeros(3)])
    told = np.asarray(dlsim(model, asked.reshape(len(run), 9))[1])
    first = 0
    for name in SHOWN:
        values = run[name].reshape(len(run), -1)
        last = first + values.shape[1]
        shown = told[:, first:last] + model.about.output_at_rest[first:last]
        moved = values - values[0]
        statement = f"a small motion of the sampled loop: {name.replace('_', ' ')} by its linear model: relative error"
        yield alike(statement, 1e-3, shown, values, moved)
        first = last


def _margin() -> float:
    """α of the law's z-transform, -(1 + ℓT_c/(z - 1))(KΛx + (K + BΛ)ẋ) - ℓBẋ, on mass points."""
    points, x = MassPoints(load_preset("paper")), np.array(CENTER)
    M, _, A = linear_plant(points)
    n = len(M)
    Phi, Gamma = held_over(A, np.vstack([np.zeros((n, 3)), np.linalg.inv(M)[:, :3]]), PERIOD)
    B = sum((points.arm_inertia(x, arm) for arm in range(2)), points.rigid_inertia(x))
    by_pose, by_rate = GAIN * SLOPE * np.eye(3), GAIN * np.eye(3) + SLOPE * B
    largest = 0.0
    for z in np.exp(1j * PERIOD * np.geomspace(1.0, np.pi / PERIOD, 2000)):
        state = np.linalg.solve(z * np.eye(2 * n) - Phi, Gamma)
        x, rate = state[:3], state[n : n + 3]
        asked = -(1 + FORGETS * PERIOD / (z - 1)) * (by_pose @ x + by_rate @ rate) - FORGETS * B @ rate
        H = asked * z ** -LAW["input_delay"]
        deviation = np.linalg.solve(np.eye(3) - H, np.eye(3) + H) / 2
        largest = max(largest, float(np.abs(np.linalg.eigvals(deviation)).max()))
    return 1 / largest
