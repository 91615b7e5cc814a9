"""The control law of Eqs. (23) and (25) and the internal force of Eqs. (13)-(15) and (26), computed again from mass points."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from flexlab.analysis.internal_force import internal_force_eq_26
from flexlab.analysis.validation.check import FINE, Check, Runs, alike, below
from flexlab.analysis.validation.mass_points import MassPoints, time_derivative
from flexlab.sim.samples import Run

SUBJECT, PLACE = "Control law and internal force", 3

EVERY = 60
GAIN, SLOPE, LAYER, ADAPTATION = 200.0, 50.0, 0.1, 10.0
"""K, Λ, ε and k_j of Section IV."""


def desired(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x_d, ẋ_d, ẍ_d of Section IV, (N, 3) each."""
    phase, w = 2 * np.pi * t, 2 * np.pi
    sine, cosine = np.sin(phase)[:, None] * 0.2 * np.ones(3), np.cos(phase)[:, None] * 0.2 * np.ones(3)
    return sine + np.array([0.0, 0.75, 0.0]), w * cosine, -(w**2) * sine


def checks(runs: Runs) -> Iterator[Check]:
    """For the paper's boundary, and for one without symmetry."""
    for run in (runs.general_pinned, runs.general):
        for check in _of(run):
            yield replace(check, statement=f"{run.scenario.payload.boundary}: {check.statement}")


def _of(run: Run) -> Iterator[Check]:
    """Signals of the law, its inputs arm by arm, adaptation, and the internal force by both routes."""
    points, scenario = MassPoints(run.scenario), run.scenario
    goal, goal_rate, goal_acceleration = desired(run.time)
    e, e_dot = run.pose - goal, run.pose_rate - goal_rate
    s = e_dot + SLOPE * e
    yield below("e = x - x_d with the path of Section IV: largest error", 1e-12, run.tracking_error - e, "m")
    yield below("s = ẋ - r, r = ẋ_d - Λe: largest error", 1e-10, run.sliding_variable - s, "m/s")
    r, r_dot = goal_rate - SLOPE * e, goal_acceleration - SLOPE * e_dot
    size = np.linalg.norm(s, axis=1)
    b = run.bound_estimates
    rates = time_derivative(b, FINE)
    x_size, v_size = np.linalg.norm(run.pose, axis=1), np.linalg.norm(run.pose_rate, axis=1)
    wanted = (size[:, None] * np.stack([np.ones(len(run)), x_size, v_size**2], axis=1) / ADAPTATION)[2:-2]
    yield alike("b̂ adapts by ‖s‖/k0, ‖s‖‖x‖/k1, ‖s‖‖ẋ‖²/k2: relative error", 1e-6, rates, wanted)

    inputs, forces = [], []
    rows = range(0, len(run), EVERY)
    weight = np.array([0.0, scenario.payload.linear_density * scenario.payload.length * scenario.gravity, 0.0])
    for k in rows:
        x, v = run.pose[k], run.pose_rate[k]
        rigid = points.rigid_inertia(x)
        bound = b[k] @ np.array([1.0, x_size[k], v_size[k] ** 2])
        common = rigid @ r_dot[k] + weight - GAIN * s[k] - bound * s[k] / max(size[k], LAYER)
        terms = [points.arm_terms(x, v, index) for index in range(2)]
        inputs.append([M @ r_dot[k] + C @ r[k] + G + common / 2 for M, C, G in terms])
        pushes = [
            run.arm_input[k, index] - M @ run.pose_acceleration[k] - C @ v - G for index, (M, C, G) in enumerate(terms)
        ]
        forces.append([push - sum(pushes) / 2 for push in pushes])
    found, u = run.internal_force[rows], run.arm_input
    yield alike("u_i of Eqs. (23), (25), arm by arm: relative error", 1e-7, inputs, u[rows], u)
    yield alike("internal force of Eqs. (13)-(15): error as a part of u", 1e-7, forces, found, u)
    by_eq_26 = internal_force_eq_26(run, EVERY)
    yield alike("internal force by Eq. (26), without ẍ: difference as a part of u", 1e-9, by_eq_26, found, u)
    yield alike("F_1 + F_2 = 0: sum as a part of u", 1e-12, run.internal_force.sum(axis=1), 0.0, u)
