"""The paper's law, Eqs. (23) and (25): adaptive sliding mode with a boundary layer."""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import inlined
from flexlab.control.load_sharing import drive_arms


class AdaptiveGains(NamedTuple):
    """Gains of the law."""

    K: np.ndarray
    """N·s/m, N·s/m, N·m·s/rad, (3,)."""
    Lambda: np.ndarray
    """Λ, 1/s, (3,)."""
    epsilon: float
    """Boundary layer of ‖s‖."""
    k: np.ndarray
    """k0, k1, k2, (3,)."""


@inlined
def sliding_variable(Lambda, x, v, desired, s):
    """s = ẋ - ẋ_d + Λe (3,); returns ‖s‖."""
    norm2 = 0.0
    for a in range(3):
        s[a] = v[a] - desired[1, a] + Lambda[a] * (x[a] - desired[0, a])
        norm2 += s[a] * s[a]
    return np.sqrt(norm2)


@inlined
def adaptive_sliding_mode(gains, payload, gravity, x, v, terms, desired, b_hat, scratch, u, b_rate):
    """Fill u_i (arms, 3) and db̂/dt (3,) for the pose x, its rate v and the estimates b̂ (3,)."""
    r_dot, r, feedback, A = scratch[0], scratch[1], scratch[2], scratch[3:6]
    s_norm = sliding_variable(gains.Lambda, x, v, desired, feedback)
    x_norm2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    v_norm2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    x_norm = np.sqrt(x_norm2)
    bound = (b_hat[0] + b_hat[1] * x_norm + b_hat[2] * v_norm2) / max(s_norm, gains.epsilon)
    for a in range(3):
        r[a] = v[a] - feedback[a]
        r_dot[a] = desired[2, a] - gains.Lambda[a] * (v[a] - desired[1, a])
        feedback[a] *= -(gains.K[a] + bound)
    drive_arms(payload, gravity, terms, r_dot, r, feedback, A, u)
    # The proof needs ‖x‖ and ‖ẋ‖² here; the print of Eq. (23) has one dot too many in each.
    b_rate[0] = s_norm / gains.k[0]
    b_rate[1] = s_norm * x_norm / gains.k[1]
    b_rate[2] = s_norm * v_norm2 / gains.k[2]
