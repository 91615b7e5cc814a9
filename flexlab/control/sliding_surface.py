"""The sliding surface s = ė + Λe and the reference velocity r = ẋ - s of several laws (Section III)."""

import numpy as np

from flexlab.compiled import inlined
from flexlab.control.rates import largest_ratio


@inlined
def sliding_variable(Lambda, x, v, desired, s):
    """s = ẋ - ẋ_d + Λe (3,); returns ‖s‖."""
    norm2 = 0.0
    for a in range(3):
        s[a] = v[a] - desired[1, a] + Lambda[a] * (x[a] - desired[0, a])
        norm2 += s[a] * s[a]
    return np.sqrt(norm2)


@inlined
def aim_at_surface(Lambda, now):
    """Fill ṙ, r and s, (3,) each, in the first three rows of now.scratch; returns ‖s‖."""
    r_dot, r, s, v, desired = now.scratch[0], now.scratch[1], now.scratch[2], now.v, now.desired
    s_norm = sliding_variable(Lambda, now.x, v, desired, s)
    for a in range(3):
        r[a] = v[a] - s[a]
        r_dot[a] = desired[2, a] - Lambda[a] * (v[a] - desired[1, a])
    return s_norm


@inlined
def layer_rate(K, Lambda, per_speed, now, S):
    """Fastest rate of s, 1/s: that of S⁻¹(K + per_speed), plus Λ; per_speed: further force per s, N·s/m."""
    gain = now.scratch[0]
    for a in range(3):
        gain[a] = K[a] + per_speed
    return largest_ratio(S, gain, now.scratch[3:6]) + max(Lambda)


def slope_of(law) -> np.ndarray:
    """Λ (3,) of a law's model."""
    return np.array(np.broadcast_to(law.sliding_slope, 3), dtype=float)


def layer_of(law) -> dict[str, dict[str, float]]:
    """The level to draw in plots: the boundary layer, within which a law is smooth."""
    return {"sliding_variable": {"boundary layer ε (m/s)": law.boundary_layer}}
