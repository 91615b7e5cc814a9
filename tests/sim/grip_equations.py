"""Independent Newton-Euler equations of arms, a flexible beam and compliant grips, in plain numpy.

From `flexlab.physics` they take only the beam's matrices M_q, K_F, h and g, which have tests of their own. The coordinates are
the absolute link angles of each arm, and the payload's pose and nodal coordinates. Springs and dampers act between points in
the plane.
"""

import numpy as np
from scipy.integrate import solve_ivp

from flexlab.physics.beam import beam_matrices


class Machine:
    """Arms, beam and grips under constant joint torques."""

    def __init__(self, scenario, D: np.ndarray | None = None):
        payload = scenario.payload
        self.scenario, self.gravity = scenario, scenario.gravity
        self.beam = beam_matrices(
            payload.length, payload.linear_density, payload.bending_stiffness, payload.element_count, payload.boundary
        )
        self.L, self.n = payload.length, len(self.beam.h)
        self.D = np.zeros((self.n, self.n)) if D is None else D
        self.k, self.c = np.array(scenario.grips.stiffness), np.array(scenario.grips.damping)

    def arm_start(self, i: int, pose: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Absolute link angles and their rates with the arm's grip point at the beam's end, by the law of cosines."""
        arm, side = self.scenario.arms[i], (-0.5, 0.5)[i] * self.L
        a, b, last = arm.link_length
        phi = pose[2] + (0.0, np.pi)[i]
        tip = pose[:2] + side * np.array([np.cos(pose[2]), np.sin(pose[2])])
        wrist = tip - last * np.array([np.cos(phi), np.sin(phi)])
        r = wrist - np.array(arm.base)
        inner = np.arccos((r @ r - a * a - b * b) / (2 * a * b)) * arm.elbow
        first = np.arctan2(r[1], r[0]) - np.arctan2(b * np.sin(inner), a + b * np.cos(inner))
        angles = np.array([first, first + inner, phi])
        tip_rate = rate[:2] + side * rate[2] * np.array([-np.sin(pose[2]), np.cos(pose[2])])
        wrist_rate = tip_rate - last * rate[2] * np.array([-np.sin(phi), np.cos(phi)])
        columns = np.array(
            [[-a * np.sin(first), -b * np.sin(first + inner)], [a * np.cos(first), b * np.cos(first + inner)]]
        )
        return angles, np.array([*np.linalg.solve(columns, wrist_rate), rate[2]])

    def arm_acceleration(self, i, angles, rates, force, moment, tau):
        """Accelerations of the link angles; `force` and `moment` act on the arm at its grip, tau (3,) in the joints."""
        arm = self.scenario.arms[i]
        across = np.stack([-np.sin(angles), np.cos(angles)], axis=1)
        inward = -np.stack([np.cos(angles), np.sin(angles)], axis=1)
        mass, reach = np.diag(arm.inertia), np.array(arm.link_length)
        right = reach * (across @ force) + np.array([tau[0] - tau[1], tau[1] - tau[2], tau[2] + moment])
        for link, m in enumerate(arm.link_mass):
            # arms[j] = d(centre of `link`)/d(angle j): the forces at the centre enter by their virtual power.
            lengths, moved = np.array([*reach[:link], arm.link_center[link]]), slice(link + 1)
            arms = lengths[:, None] * across[moved]
            bent = (lengths * rates[moved] ** 2) @ inward[moved]
            mass[moved, moved] += m * arms @ arms.T
            right[moved] -= m * (arms @ bent + self.gravity * arms[:, 1])
        return np.linalg.solve(mass, right)

    def grip(self, i, angles, rates, x, v):
        """Force (2,) and moment of grip i on the payload, the arm's grip point (2,), and the grip's displacement (3,)."""
        arm, side = self.scenario.arms[i], (-0.5, 0.5)[i] * self.L
        e1, e2 = np.array([np.cos(x[2]), np.sin(x[2])]), np.array([-np.sin(x[2]), np.cos(x[2])])
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        turned = np.stack([-np.sin(angles), np.cos(angles)], axis=1)
        point = np.array(arm.base) + np.array(arm.link_length) @ directions
        speed = np.array(arm.link_length) @ (rates[:, None] * turned)
        apart = point - x[:2] - side * e1
        parting = speed - v[:2] - side * v[2] * e2
        delta = np.array([apart @ e1, apart @ e2, angles[2] - (0.0, np.pi)[i] - x[2]])
        rate = np.array([parting @ e1 + v[2] * delta[1], parting @ e2 - v[2] * delta[0], rates[2] - v[2]])
        f = self.k * delta + self.c * rate
        return f[0] * e1 + f[1] * e2, f[2], point, delta

    def payload_acceleration(self, x, q, v, q_dot, force, moment):
        """Accelerations of pose and nodal coordinates under the total force (2,) and moment about (x, y) of all grips."""
        beam, w = self.beam, v[2]
        c, s = np.cos(x[2]), np.sin(x[2])
        e1, e2 = np.array([c, s]), np.array([-s, c])
        w_bar, w_rate, Mq = beam.h @ q, beam.h @ q_dot, beam.M_q @ q
        # The acceleration of a point, by hand: R'' + (s e1 + w e2)'' with (s e1 + w e2)'' = (s w' + w_tt - w w'^2) e2 - (...) e1.
        A = np.zeros((3 + self.n, 3 + self.n))
        A[0, 0] = A[1, 1] = beam.m
        A[:2, 2] = A[2, :2] = -w_bar * e1
        A[2, 2] = beam.I + q @ Mq
        A[:2, 3:], A[2, 3:], A[3:, 3:] = np.outer(e2, beam.h), beam.g, beam.M_q
        A[3:, :3] = A[:3, 3:].T
        bias = np.zeros(3 + self.n)
        bias[:2] = -2 * w * w_rate * e1 - w * w * w_bar * e2
        bias[2] = 2 * w * (Mq @ q_dot)
        bias[3:] = -w * w * Mq
        load = np.zeros(3 + self.n)
        load[:2], load[2] = force + np.array([0, -beam.m * self.gravity]), moment + self.gravity * s * w_bar
        load[3:] = -beam.K_F @ q - self.D @ q_dot - self.gravity * c * beam.h
        return np.linalg.solve(A, load - bias)

    def rates(self, y, torques):
        """Time derivative of the state: x, q, v, q̇, then the link angles and rates of each arm."""
        n = self.n
        x, q, v, q_dot = np.split(y[: 6 + 2 * n], [3, 3 + n, 6 + n])
        force, moment, parts = np.zeros(2), 0.0, []
        for i in range(len(self.scenario.arms)):
            angles, rate = y[6 + 2 * n + 6 * i :][:3], y[6 + 2 * n + 6 * i :][3:6]
            pull, turn, point, _ = self.grip(i, angles, rate, x, v)
            lever = point - x[:2]
            force, moment = force + pull, moment + lever[0] * pull[1] - lever[1] * pull[0] + turn
            parts += [rate, self.arm_acceleration(i, angles, rate, -pull, -turn, torques[i])]
        return np.concatenate([v, q_dot, self.payload_acceleration(x, q, v, q_dot, force, moment), *parts])

    def start(self, pose, rate, q):
        """The state with undeformed grips and q̇ = 0."""
        arms = [part for i in range(len(self.scenario.arms)) for part in self.arm_start(i, pose, rate)]
        return np.concatenate([pose, q, rate, np.zeros(self.n), *arms])

    def run(self, y, torques, times):
        """States at these times under constant joint torques (arms, 3)."""
        found = solve_ivp(
            lambda _, at: self.rates(at, torques), times[[0, -1]], y, "LSODA", times, rtol=1e-10, atol=1e-12
        )
        return found.y.T
