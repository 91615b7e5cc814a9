"""Every control law written in NumPy as its equation reads: it maps what it sees to u_i and the rate of its memory."""

import numpy as np

from reference.flexible_system import Law, Seen, inverse_kinematics


def _three(value: object) -> np.ndarray:
    return np.broadcast_to(np.array(value, float), 3)


def _surface(seen: Seen) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """s, r, ṙ."""
    slope = _three(seen.scenario.controller.sliding_slope)
    x_d, v_d, a_d = seen.desired
    r = v_d - slope * (seen.x - x_d)
    return seen.v - r, r, a_d - slope * (seen.v - v_d)


def _weight(seen: Seen) -> np.ndarray:
    return np.array([0, seen.m * seen.scenario.gravity, 0])


def _shared(seen: Seen, acceleration: np.ndarray, rate: np.ndarray, force: np.ndarray) -> np.ndarray:
    """u_i, (arms, 3): the arm's own terms, and its share of the payload's inertia and weight and of `force`."""
    M, C, G = seen.sums()
    common = seen.A @ acceleration + _weight(seen) + force
    return M @ acceleration + C @ rate + G + seen.share[:, None] * common


def adaptive_sliding_mode(seen: Seen, b_hat: np.ndarray):
    law, (s, r, r_dot) = seen.scenario.controller, _surface(seen)
    growth, norm = np.array([1, np.linalg.norm(seen.x), seen.v @ seen.v]), np.linalg.norm(s)
    force = -_three(law.feedback_gain) * s - b_hat @ growth * s / max(norm, law.boundary_layer)
    return _shared(seen, r_dot, r, force), norm * growth / law.adaptation - law.leakage * b_hat


def vibration_damping(seen: Seen, b_hat: np.ndarray):
    law = seen.scenario.controller
    u, rate = adaptive_sliding_mode(seen, b_hat)
    lateral, turn = np.array([law.lateral_vibration_gain, law.angular_vibration_gain]) * seen.beam_rate
    push = np.array([-np.sin(seen.x[2]) * lateral, np.cos(seen.x[2]) * lateral, turn])
    return u + seen.share[:, None] * (seen.sums()[0].sum(0) @ push), rate


def sliding_mode(seen: Seen, memory: np.ndarray):
    law, (s, r, r_dot) = seen.scenario.controller, _surface(seen)
    force = -_three(law.feedback_gain) * s - law.bound * s / max(np.linalg.norm(s), law.boundary_layer)
    return _shared(seen, r_dot, r, force), np.zeros(3)


def super_twisting(seen: Seen, w: np.ndarray):
    law, (s, r, r_dot) = seen.scenario.controller, _surface(seen)
    size = max(np.linalg.norm(s), law.boundary_layer)
    force = -_three(law.proportional_gain) * s / np.sqrt(size) + w
    return _shared(seen, r_dot, r, force), -_three(law.integral_gain) * s / size


def _momentum(seen: Seen) -> np.ndarray:
    return (seen.sums()[0].sum(0) + seen.A) @ seen.v


def disturbance_observer(seen: Seen, memory: np.ndarray):
    law, (s, r, r_dot) = seen.scenario.controller, _surface(seen)
    d_hat = law.observer_gain * (_momentum(seen) - memory[:3] - memory[3:])
    u = _shared(seen, r_dot, r, -_three(law.feedback_gain) * s - d_hat)
    _, C, G = seen.sums()
    known = C.sum(0).T @ seen.v - G.sum(0) - _weight(seen)
    return u, np.concatenate([np.zeros(3), u.sum(0) + known + d_hat])


def regressor(seen: Seen, r: np.ndarray, r_dot: np.ndarray) -> np.ndarray:
    """Y_i of each arm, (arms, 3, 2 + 3 arms): its share of the payload's columns, and the columns of its own links."""
    columns = np.zeros((len(seen.arms), 3, 2 + 3 * len(seen.arms)))
    for i, at in enumerate(seen.arms):
        columns[i, :, 0] = seen.share[i] * np.array([r_dot[0], r_dot[1] + seen.scenario.gravity, 0])
        columns[i, :, 1] = seen.share[i] * np.array([0, 0, r_dot[2]])
        for k in range(3):
            columns[i, :, 2 + 3 * i + k] = at.M[k] @ r_dot + at.C[k] @ r + at.G[k]
    return columns


def regressor_adaptive(seen: Seen, estimates: np.ndarray):
    law, (s, r, r_dot) = seen.scenario.controller, _surface(seen)
    Y = regressor(seen, r, r_dot)
    u = Y @ estimates - seen.share[:, None] * _three(law.feedback_gain) * s
    gains = [law.adaptation_gain_mass, law.adaptation_gain_inertia] + 3 * len(seen.arms) * [law.adaptation_gain_links]
    return u, -np.array(gains) * (Y.sum(0).T @ s)


def computed_torque(seen: Seen, memory: np.ndarray):
    law, (x_d, v_d, a_d) = seen.scenario.controller, seen.desired
    a = a_d - _three(law.velocity_gain) * (seen.v - v_d) - _three(law.position_gain) * (seen.x - x_d)
    return _shared(seen, a, seen.v, np.zeros(3)), np.zeros(3)


def pd(seen: Seen, memory: np.ndarray):
    law, (x_d, v_d, _) = seen.scenario.controller, seen.desired
    force = -_three(law.velocity_gain) * (seen.v - v_d) - _three(law.position_gain) * (seen.x - x_d)
    return seen.sums()[2] + seen.share[:, None] * (_weight(seen) + force), np.zeros(3)


def joint_pd(seen: Seen, memory: np.ndarray):
    law, step, (x_d, v_d, _) = seen.scenario.controller, 1e-5, seen.desired
    u, differences = [], np.array([[1, 0, 0], [-1, 1, 0], [0, -1, 1]])
    for i, at in enumerate(seen.arms):
        angle = [differences @ inverse_kinematics(seen.scenario, i, x_d + k * step * v_d) for k in (0, 2, 1, -1, -2)]
        rate = (8 * (angle[2] - angle[3]) - (angle[1] - angle[4])) / (12 * step)
        tau = -_three(law.position_gain) * (at.angle - angle[0]) - _three(law.velocity_gain) * (at.R @ seen.v - rate)
        u.append(at.R.T @ tau)
    return np.array(u) + seen.sums()[2] + seen.share[:, None] * _weight(seen), np.zeros(3)


def none(seen: Seen, memory: np.ndarray):
    return np.zeros((len(seen.arms), 3)), np.zeros(3)


LAWS: dict[str, Law] = {
    "adaptive-sliding-mode": adaptive_sliding_mode,
    "vibration-damping": vibration_damping,
    "sliding-mode": sliding_mode,
    "super-twisting": super_twisting,
    "disturbance-observer": disturbance_observer,
    "regressor-adaptive": regressor_adaptive,
    "computed-torque": computed_torque,
    "pd": pd,
    "joint-pd": joint_pd,
    "none": none,
}


def truth(seen: Seen) -> np.ndarray:
    """True values of what the regressor law estimates: the payload's mass and inertia, and the masses of all links."""
    payload = seen.scenario.payload
    m = payload.linear_density * payload.length
    return np.array([m, m * payload.length**2 / 12, *(mass for arm in seen.scenario.arms for mass in arm.link_mass)])


def start(seen: Seen) -> np.ndarray:
    """Memory of a law at t = 0."""
    law = seen.scenario.controller
    if law.kind == "regressor-adaptive":
        return law.initial_estimate_factor * truth(seen)
    if law.kind == "disturbance-observer":
        return np.concatenate([_momentum(seen), np.zeros(3)])
    return np.zeros(3)
