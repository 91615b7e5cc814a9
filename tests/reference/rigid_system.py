"""Two arms and a rigid bar under the paper's law, without gravity: arms from Pinocchio, integrated by SciPy.

The bar has mass ρL and inertia ρL³/12; the law keeps the flexible beam's hᵀM_q⁻¹h terms, as Eq. (25) says.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from flexlab.scenario import Scenario
from reference.pinocchio_arms import pinocchio_arms


class RigidRun(NamedTuple):
    """One row per requested instant."""

    pose: np.ndarray
    pose_rate: np.ndarray
    bound_estimates: np.ndarray


class RigidSystem:
    """`kappa`: hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g of the beam that the controller believes in."""

    def __init__(self, scenario: Scenario, kappa: np.ndarray):
        self.scenario, self.kappa, self.arms = scenario, kappa, pinocchio_arms(scenario)
        payload = scenario.payload
        self.m = payload.linear_density * payload.length
        self.inertia = np.diag([self.m, self.m, self.m * payload.length**2 / 12])

    def desired(self, t: float) -> np.ndarray:
        """x_d, ẋ_d, ẍ_d."""
        path = self.scenario.trajectory
        rate = 2 * np.pi * np.array(path.frequency)
        angle, size = rate * t + path.phase, np.array(path.amplitude)
        return np.array(
            [path.center + size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)]
        )

    def rates(self, t: float, state: np.ndarray) -> np.ndarray:
        """d/dt of (x, ẋ, b̂)."""
        law = self.scenario.controller
        x, v, b_hat = state[:3], state[3:6], state[6:]
        terms = [arm.in_task_space(x, v) for arm in self.arms]
        M, C, G = (sum(part) for part in zip(*terms, strict=True))
        x_d, v_d, a_d = self.desired(t)
        e, e_dot = x - x_d, v - v_d
        s = e_dot + law.sliding_slope * e
        size, speed2, norm = np.linalg.norm(x), v @ v, np.linalg.norm(s)
        bound = (b_hat[0] + b_hat[1] * size + b_hat[2] * speed2) / max(norm, law.boundary_layer)
        lateral, turn = np.array([-np.sin(x[2]), np.cos(x[2]), 0]), np.array([0, 0, 1])
        hh, hg, gg = self.kappa
        beam = hh * np.outer(lateral, lateral) + hg * (np.outer(lateral, turn) + np.outer(turn, lateral))
        beam = beam + gg * np.outer(turn, turn)
        u = (M + self.inertia - beam) @ (a_d - law.sliding_slope * e_dot) + C @ (v - s) + G
        u = u - law.feedback_gain * s - bound * s
        acceleration = np.linalg.solve(M + self.inertia, u - C @ v - G)
        return np.concatenate([v, acceleration, norm * np.array([1, size, speed2]) / np.array(law.adaptation)])

    def run(self, times: np.ndarray) -> RigidRun:
        """Run from rest on the trajectory; the solver restarts where s enters the boundary layer."""
        start = np.concatenate([self.desired(0.0)[0], np.zeros(6)])

        def edge(t, state):
            s = (
                state[3:6]
                - self.desired(t)[1]
                + self.scenario.controller.sliding_slope * (state[:3] - self.desired(t)[0])
            )
            return s @ s - self.scenario.controller.boundary_layer**2

        edge.terminal, edge.direction = True, -1.0
        t, options = 0.0, {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}
        first = solve_ivp(self.rates, (t, times[-1]), start, events=edge, dense_output=True, **options)
        rows = [first.sol(instant) for instant in times if instant <= first.t[-1]]
        if first.status == 1:
            second = solve_ivp(self.rates, (first.t[-1], times[-1]), first.y[:, -1], dense_output=True, **options)
            rows += [second.sol(instant) for instant in times if instant > first.t[-1]]
        states = np.array(rows)
        return RigidRun(states[:, :3], states[:, 3:6], states[:, 6:])
