"""Arms, flexible payload and a control law in plain NumPy, in nodal coordinates, integrated by SciPy.

The matrices of inertia and Christoffel symbols are ∫ JᵀJ dm and ∫ JᵀJ̇ dm, as sums over the Jacobians J of mass points. Of
flexlab, only the scenario's numbers are used.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from flexlab.scenario import Scenario
from reference.lagrangian import hermite

OPTIONS = {"method": "DOP853", "rtol": 1e-6, "atol": 1e-9}
"""Of `solve_ivp`: with a ten-thousandth of these tolerances, poses at 0.04 s change by 5e-13."""


def e(angle: float) -> np.ndarray:
    """Unit vector."""
    return np.array([np.cos(angle), np.sin(angle)])


def normal(angle: float) -> np.ndarray:
    """Derivative of the unit vector with respect to the angle."""
    return np.array([-np.sin(angle), np.cos(angle)])


class ArmAt(NamedTuple):
    """One arm at a pose and pose rate; M, C and G per kilogram of each link (first axis)."""

    M: np.ndarray
    C: np.ndarray
    G: np.ndarray
    R: np.ndarray
    """Maps ẋ to the relative joint rates, (3, 3)."""
    angle: np.ndarray
    """Relative joint angles, (3,)."""


def inverse_kinematics(scenario: Scenario, index: int, x: np.ndarray) -> np.ndarray:
    """Absolute angles (3,) of an arm's links at a pose."""
    arm, side = scenario.arms[index], (-1 if index == 0 else 1)
    l1, l2, l3 = arm.link_length
    wrist = x[:2] + side * (scenario.payload.length / 2 + l3) * e(x[2]) - arm.base
    bend = arm.elbow * np.arccos((wrist @ wrist - l1**2 - l2**2) / (2 * l1 * l2))
    first = np.arctan2(wrist[1], wrist[0]) - np.arctan2(l2 * np.sin(bend), l1 + l2 * np.cos(bend))
    return np.array([first, first + bend, x[2] + (np.pi if side > 0 else 0)])


def arm_at(scenario: Scenario, index: int, x: np.ndarray, v: np.ndarray) -> ArmAt:
    """Matrices of one arm in the coordinates of the pose."""
    arm, side = scenario.arms[index], (-1 if index == 0 else 1)
    l1, l2, l3 = arm.link_length
    reach, alpha = side * (scenario.payload.length / 2 + l3), inverse_kinematics(scenario, index, x)
    links = np.array([l1, l2])
    inverse = np.linalg.inv(links * normal(alpha[:2]))
    J = np.zeros((3, 3))
    J[:2, :2], J[:2, 2] = inverse, inverse @ (reach * normal(x[2]))
    J[2, 2] = 1
    rate = J @ v
    end = (links * e(alpha[:2]) * rate[:2]) @ J[:2]
    end[:, 2] -= reach * e(x[2]) * v[2]
    J_dot = np.zeros((3, 3))
    J_dot[:2] = inverse @ end
    centers = np.array([[arm.link_center[0], 0, 0], [l1, arm.link_center[1], 0], [l1, l2, arm.link_center[2]]])
    gyration = np.array(arm.inertia) / np.array(arm.link_mass)
    turning, falling = normal(alpha) * centers[:, None], e(alpha) * rate * centers[:, None]
    # Jacobian of each link's centre of mass, and its rate, (link, axis, coordinate).
    P, P_dot = turning @ J, turning @ J_dot - falling @ J
    spin = gyration[:, None, None] * J[:, :, None]
    M = P.transpose(0, 2, 1) @ P + spin * J[:, None, :]
    C = P.transpose(0, 2, 1) @ P_dot + spin * J_dot[:, None, :]
    G = scenario.gravity * P[:, 1]
    differences = np.array([[1, 0, 0], [-1, 1, 0], [0, -1, 1]])
    return ArmAt(M, C, G, differences @ J, differences @ alpha)


class Seen(NamedTuple):
    """What a control law can use."""

    scenario: Scenario
    arms: list[ArmAt]
    x: np.ndarray
    v: np.ndarray
    desired: np.ndarray
    share: np.ndarray
    m: float
    A: np.ndarray
    """Believed A11 - A12 A22⁻¹A21 at q = 0, (3, 3)."""
    beam_rate: np.ndarray
    """hᵀq̇, gᵀq̇."""
    coming: np.ndarray
    """`desired` at the time when the torques that are commanded now begin to act."""

    def sums(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """M̄_i, C̄_i, Ḡ_i of all arms (first axis) with their true masses."""
        masses = [np.array(arm.link_mass) for arm in self.scenario.arms]
        pairs = list(zip(masses, self.arms, strict=True))
        M = np.array([(mass @ at.M.reshape(3, 9)).reshape(3, 3) for mass, at in pairs])
        C = np.array([(mass @ at.C.reshape(3, 9)).reshape(3, 3) for mass, at in pairs])
        return M, C, np.array([mass @ at.G for mass, at in pairs])


Law = Callable[[Seen, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Maps what the law sees and its memory to u_i, (arms, 3), and the memory's rate."""


class FlexibleSystem:
    """A scenario (pinned-pinned or clamped-free beam, nodal damping, sine path) with its law."""

    def __init__(self, scenario: Scenario, law: Law, start: Callable[[Seen], np.ndarray]):
        self.scenario, self.law, self.start = scenario, law, start
        payload, n = scenario.payload, scenario.payload.element_count
        held = [0, 2 * n] if payload.boundary == "pinned-pinned" else [0, 1]
        self.s, self.N, self.mass, self.K = self._points(payload, held)
        self.M_q = (self.N.T * self.mass) @ self.N
        self.D = payload.damping.coefficient * np.eye(len(self.K))
        self.h, self.g = self.mass @ self.N, (self.mass * self.s) @ self.N
        model = scenario.controller.model
        other = payload.model_copy(
            update={
                "length": payload.length * model.length_factor,
                "linear_density": payload.linear_density * model.linear_density_factor,
            }
        )
        s, N, mass, _ = self._points(other, held)
        loads = np.array([mass @ N, (mass * s) @ N])
        kappa = loads @ np.linalg.solve((N.T * mass) @ N, loads.T)
        self.m, self.A = mass.sum(), np.diag([mass.sum(), mass.sum(), mass @ s**2])
        self.A[1:, 1:] -= kappa
        share = scenario.controller.load_share
        self.share = np.array([share, 1 - share]) if len(scenario.arms) == 2 else np.ones(1)

    @staticmethod
    def _points(payload: Any, held: list[int]) -> tuple[np.ndarray, ...]:
        x, weight = np.polynomial.legendre.leggauss(4)
        edges = np.linspace(-payload.length / 2, payload.length / 2, payload.element_count + 1)
        middle, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
        s, part = (middle[:, None] + width[:, None] * x).ravel(), (width[:, None] * weight).ravel()
        N, N2 = (np.delete(rows, held, axis=1) for rows in hermite(payload, s))
        return s, N, payload.linear_density * part, payload.bending_stiffness * (N2.T * part) @ N2

    def desired(self, t: float) -> np.ndarray:
        """x_d, ẋ_d, ẍ_d."""
        path = self.scenario.trajectory
        rate = 2 * np.pi * np.array(path.frequency)
        angle, size = rate * t + path.phase, np.array(path.amplitude)
        return np.array(
            [path.center + size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)]
        )

    def see(self, t: float, state: np.ndarray) -> Seen:
        """What the law sees at a state (x, ẋ, q, q̇, …)."""
        n, x, v = len(self.K), state[:3], state[3:6]
        q_dot = state[6 + n : 6 + 2 * n]
        arms = [arm_at(self.scenario, i, x, v) for i in range(len(self.scenario.arms))]
        rate = np.array([self.h @ q_dot, self.g @ q_dot])
        law = self.scenario.controller
        coming = self.desired(t + law.input_delay * (law.control_period or 0.0))
        return Seen(
            self.scenario, arms, x, v, self.desired(t), self.share, self.m, self.believed_inertia(x[2]), rate, coming
        )

    def believed_inertia(self, theta: float) -> np.ndarray:
        """`Seen.A` at the payload angle `theta`."""
        c, s = e(theta)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        return turn @ self.A @ turn.T

    def inputs(self, seen: Seen, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """u_i of the law plus the wanted internal force, and the memory's rate."""
        u, rate = self.law(seen, memory)
        if len(u) == 2:
            push = self.scenario.controller.wanted_internal_force * np.array([*e(seen.x[2]), 0])
            u = u + np.array([push, -push])
        return u, rate

    def accelerations(self, seen: Seen, state: np.ndarray, u: np.ndarray) -> np.ndarray:
        """p̈ (3 + n_q,), Eq. (16)."""
        n, gravity = len(self.K), self.scenario.gravity
        q, q_dot, theta, omega = state[6 : 6 + n], state[6 + n : 6 + 2 * n], state[2], state[5]
        w, w_dot = self.N @ q, self.N @ q_dot
        J, J_dot = np.zeros((2, len(self.s), 2, 3 + n))
        J[:, :, :2] = np.eye(2)
        J[:, :, 2] = self.s[:, None] * normal(theta) - w[:, None] * e(theta)
        J[:, :, 3:] = normal(theta)[None, :, None] * self.N[:, None, :]
        J_dot[:, :, 2] = -(self.s * omega + w_dot)[:, None] * e(theta) - (w * omega)[:, None] * normal(theta)
        J_dot[:, :, 3:] = -omega * e(theta)[None, :, None] * self.N[:, None, :]
        flat = J.reshape(-1, 3 + n)
        weighted = flat.T * np.repeat(self.mass, 2)
        A, B = weighted @ flat, weighted @ J_dot.reshape(-1, 3 + n)
        force = -B @ np.concatenate([state[3:6], q_dot]) - gravity * self.mass @ J[:, 1]
        force[3:] -= self.K @ q + self.D @ q_dot
        M, C, G = seen.sums()
        A[:3, :3] += M.sum(0)
        force[:3] += u.sum(0) - C.sum(0) @ seen.v - G.sum(0)
        return np.linalg.solve(A, force)

    def rates(self, t: float, state: np.ndarray, torque: np.ndarray | None) -> np.ndarray:
        """d/dt of (x, ẋ, q, q̇, memory); `torque`: held joint torques (arms, 3), None for the continuous law."""
        n, seen = len(self.K), self.see(t, state)
        memory_rate = np.zeros(len(state) - 6 - 2 * n)
        if torque is None:
            u, memory_rate = self.inputs(seen, state[6 + 2 * n :])
        else:
            u = np.array([at.R.T @ tau for at, tau in zip(seen.arms, torque, strict=True)])
        a = self.accelerations(seen, state, u)
        return np.concatenate([state[3:6], a[:3], state[6 + n : 6 + 2 * n], a[3:], memory_rate])

    def begin(self) -> np.ndarray:
        """State at t = 0: at rest on the path, with a straight beam and the law's initial memory."""
        state = np.concatenate([self.desired(0.0)[0], np.zeros(3 + 2 * len(self.K))])
        return np.concatenate([state, self.start(self.see(0.0, state))])

    def run(self, duration: float) -> np.ndarray:
        """State after `duration` s under the scenario's law, which is continuous or sampled."""
        law, state = self.scenario.controller, self.begin()
        if law.control_period is None:
            return solve_ivp(self.rates, (0, duration), state, args=(None,), **OPTIONS).y[:, -1]
        n, line = len(self.K), [np.zeros((len(self.scenario.arms), 3))] * law.input_delay
        for k in range(round(duration / law.control_period)):
            t = k * law.control_period
            seen = self.see(t, state)
            u, rate = self.inputs(seen, state[6 + 2 * n :])
            state[6 + 2 * n :] += law.control_period * rate
            line.append(np.array([np.linalg.solve(at.R.T, each) for at, each in zip(seen.arms, u, strict=True)]))
            state = solve_ivp(self.rates, (t, t + law.control_period), state, args=(line.pop(0),), **OPTIONS).y[:, -1]
        return state
