"""The sampled laws with a Kalman observer (composite and lqr) in NumPy and SciPy, on the plant of `flexible_system`."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, expm, solve_discrete_are

from flexlab.scenario import Scenario
from reference.control_laws import LAWS, start
from reference.flexible_system import OPTIONS, FlexibleSystem, Seen, e
from reference.lagrangian import hermite

POSE_NOISE, RATE_NOISE, STRAIN_NOISE = 1e-6, 1e-4, 1e-7
"""Sensor noise that the Kalman filter assumes where the scenario has less."""


def held(A: np.ndarray, B: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """e^{At} and ∫e^{As}B ds."""
    n, k = B.shape
    both = expm(time * np.block([[A, B], [np.zeros((k, n + k))]]))
    return both[:n, :n], both[:n, n:]


class ObservedSystem(FlexibleSystem):
    """A scenario with an observer; the slow law of a composite law comes from `reference.control_laws`."""

    def __init__(self, scenario: Scenario):
        law = scenario.controller
        slow = law.slow if law.kind == "composite" else None
        super().__init__(scenario, LAWS[slow.kind if slow else "none"], start)
        self.own = scenario if slow is None else self._alone(scenario)
        self.period, self.delay, n = law.control_period, law.input_delay, law.observer.observer_modes
        density = scenario.payload.linear_density * law.model.linear_density_factor
        believed = FlexibleSystem(scenario.replace({"payload.linear_density": density}), self.law, start)
        values, V = eigh(believed.K, believed.M_q)
        V, self.modes = V[:, :n], n
        h, g = V.T @ believed.h, V.T @ believed.g
        center = np.array(scenario.trajectory.center)
        still = np.concatenate([center, np.zeros(3 + 2 * len(self.K))])
        M = np.eye(3 + n)
        M[:3, :3] = self.see(0.0, still).sums()[0].sum(0)
        M[:3, :3] += np.diag([believed.mass.sum(), believed.mass.sum(), believed.mass @ believed.s**2])
        M[:3, 3:] = np.outer(-e(center[2])[1] * np.array([1, 0, 0]) + e(center[2])[0] * np.array([0, 1, 0]), h)
        M[2, 3:] = g
        M[3:, :3] = M[:3, 3:].T
        K, D = np.zeros_like(M), np.zeros_like(M)
        K[3:, 3:], D[3:, 3:] = np.diag(values[:n]), V.T @ believed.D @ V
        m = 3 + n
        inverse = np.linalg.inv(M)
        self.dynamics = np.block([[np.zeros((m, m)), np.eye(m)], [-inverse @ K, -inverse @ D]])
        B = np.vstack([np.zeros((m, m)), inverse])
        self.B, self.by_weight = B[:, :3], B[:, 3:] @ -h
        self.transition, every = held(self.dynamics, B, self.period)
        places = scenario.payload.length * np.array(law.observer.gauges)
        curved = np.delete(hermite(scenario.payload, places)[1], [0, 2 * scenario.payload.element_count], axis=1)
        self.gauges = -scenario.payload.thickness / 2 * curved
        self.C = np.zeros((6 + len(places), 2 * m))
        self.C[:3, :3] = self.C[3:6, m : m + 3] = np.eye(3)
        self.C[6:, 3:m] = self.gauges @ V
        unknown = np.diag([*law.observer.unknown_force, *np.full(n, law.observer.unknown_modal_force)]) ** 2
        R = np.diag([POSE_NOISE] * 3 + [RATE_NOISE] * 3 + [STRAIN_NOISE] * len(places)) ** 2
        P = solve_discrete_are(self.transition.T, self.C.T, every @ unknown @ every.T, R)
        self.gain = P @ self.C.T @ np.linalg.inv(self.C @ P @ self.C.T + R)
        self.steps: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        """`held` by the part of a period."""
        self.rates_of = np.zeros((2, 2 * m))
        self.rates_of[0, m + 3 :], self.rates_of[1, m + 3 :] = h, g
        if slow is None:
            by_force = every[:, :3]
            beam = np.full(n, law.vibration_weight)
            Q = np.diag([*law.pose_weight, *(beam * values[:n]), *law.pose_rate_weight, *beam])
            P = solve_discrete_are(self.transition, by_force, Q, np.diag(law.force_weight))
            size = np.diag(law.force_weight) + by_force.T @ P @ by_force
            self.regulator = np.linalg.solve(size, by_force.T @ P @ self.transition)

    @staticmethod
    def _alone(scenario: Scenario) -> Scenario:
        law = scenario.controller
        shared = {name: getattr(law, name) for name in ("model", "load_share", "control_period", "input_delay")}
        return scenario.replace({"controller": {**shared, **dict(law.slow)}})

    def net(self, seen: Seen, torque: np.ndarray | None, u: np.ndarray | None = None) -> np.ndarray:
        """Generalized force on the pose after subtracting velocity terms and weight."""
        inputs = u if torque is None else [at.R.T @ each for at, each in zip(seen.arms, torque, strict=True)]
        _, C, G = seen.sums()
        return np.sum(np.array(inputs), axis=0) - C.sum(0) @ seen.v - G.sum(0) - [0, seen.m * self.scenario.gravity, 0]

    def ahead(self, z: np.ndarray, seen: Seen, forces: list[np.ndarray], parts: list[float]) -> np.ndarray:
        """The estimate z after forces that act one after the other, each for its part of a period."""
        weight = self.scenario.gravity * e(seen.x[2])[0]
        for force, part in zip(forces, parts, strict=True):
            if part not in self.steps:
                self.steps[part] = held(self.dynamics, np.column_stack([self.B, self.by_weight]), part * self.period)
            over, by = self.steps[part]
            z = over @ z + by @ [*force, weight]
        return z

    def asked(self, seen: Seen, z: np.ndarray, line: list[np.ndarray], memory: np.ndarray):
        """u_i and the slow law's memory rate."""
        forces = [self.net(seen, torque) for torque in line]
        law, (M, C, G), weight = self.scenario.controller, seen.sums(), [0, seen.m * self.scenario.gravity, 0]
        horizon, regulates = law.observer.horizon, law.kind == "lqr"
        if horizon is None:
            horizon = self.delay + (0.0 if regulates else 0.5)
        parts = [min(1.0, horizon - k) for k in range(int(np.ceil(horizon)))]
        if regulates:
            _, v_d, a_d = seen.desired
            u = M @ a_d + C @ v_d + G + seen.share[:, None] * (seen.A @ a_d + weight)
        else:
            u, rate = self.law(seen._replace(scenario=self.own), memory)
        # First the torques still in the delay line, then those commanded now; of a regulator only the feedforward.
        forces += [self.net(seen, None, u)] * len(parts)
        z = self.ahead(z, seen, forces[: len(parts)], parts)
        if regulates:
            aim = np.zeros_like(z)
            aim[:3], aim[3 + self.modes : 6 + self.modes] = seen.coming[:2]
            return u - seen.share[:, None] * (self.regulator @ (z - aim)), np.zeros(len(memory))
        lateral, turn = np.array([law.lateral_vibration_gain, law.angular_vibration_gain]) * (self.rates_of @ z)
        push = np.array([-e(seen.x[2])[1] * lateral, e(seen.x[2])[0] * lateral, turn])
        return u + seen.share[:, None] * (M.sum(0) @ push), rate

    def run(self, duration: float) -> np.ndarray:
        """State after `duration` s."""
        state, n, idle = self.begin(), len(self.K), np.zeros((len(self.scenario.arms), 3))
        line, torque, z = [idle] * self.delay, idle, None
        for k in range(round(duration / self.period)):
            t = k * self.period
            seen = self.see(t, state)
            if z is None:
                z = np.concatenate([seen.x, np.zeros(self.modes), seen.v, np.zeros(self.modes)])
            else:
                z = self.ahead(z, seen, [self.net(seen, torque)], [1.0])
            z = z + self.gain @ (np.concatenate([seen.x, seen.v, self.gauges @ state[6 : 6 + n]]) - self.C @ z)
            u, rate = self.asked(seen, z, line, state[6 + 2 * n :])
            push = self.scenario.controller.wanted_internal_force * np.array([*e(seen.x[2]), 0])
            u = u + np.array([push, -push])
            state[6 + 2 * n :] += self.period * rate
            line.append(np.array([np.linalg.solve(at.R.T, each) for at, each in zip(seen.arms, u, strict=True)]))
            torque = line.pop(0)
            state = solve_ivp(self.rates, (t, t + self.period), state, args=(torque,), **OPTIONS).y[:, -1]
        return state
