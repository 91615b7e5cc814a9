"""How fast a gain moves an inertia: what laws say their fastest rate with."""

import numpy as np

from flexlab.compiled import inlined


@inlined
def largest_ratio(S, gain, B):
    """Largest eigenvalue of S⁻¹ diag(gain) for a symmetric positive definite S (3, 3) and gains (3,) ≥ 0; B: scratch (3, 3).

    It is that of the symmetric B = √gain S⁻¹ √gain, in closed form (Smith, Commun. ACM 4 (1961) 168).
    """
    d0 = S[1, 1] * S[2, 2] - S[1, 2] * S[1, 2]
    d1 = S[0, 2] * S[1, 2] - S[0, 1] * S[2, 2]
    d2 = S[0, 1] * S[1, 2] - S[0, 2] * S[1, 1]
    determinant = S[0, 0] * d0 + S[0, 1] * d1 + S[0, 2] * d2
    B[0, 0], B[0, 1], B[0, 2] = d0, d1, d2
    B[1, 1] = S[0, 0] * S[2, 2] - S[0, 2] * S[0, 2]
    B[1, 2] = S[0, 1] * S[0, 2] - S[0, 0] * S[1, 2]
    B[2, 2] = S[0, 0] * S[1, 1] - S[0, 1] * S[0, 1]
    for a in range(3):
        for b in range(a, 3):
            B[a, b] *= np.sqrt(gain[a] * gain[b]) / determinant
    mean = (B[0, 0] + B[1, 1] + B[2, 2]) / 3
    off = B[0, 1] * B[0, 1] + B[0, 2] * B[0, 2] + B[1, 2] * B[1, 2]
    x, y, z = B[0, 0] - mean, B[1, 1] - mean, B[2, 2] - mean
    p = np.sqrt((x * x + y * y + z * z + 2 * off) / 6)
    if p == 0:
        return mean
    half = x * (y * z - B[1, 2] * B[1, 2]) - B[0, 1] * (B[0, 1] * z - B[1, 2] * B[0, 2])
    half += B[0, 2] * (B[0, 1] * B[1, 2] - y * B[0, 2])
    half /= 2 * p * p * p
    return mean + 2 * p * np.cos(np.arccos(min(1.0, max(-1.0, half))) / 3)
