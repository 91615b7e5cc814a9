"""Eigenvalues of a gain on an inertia, with which laws state their fastest rate."""

import numpy as np

from flexlab.compiled import inlined


@inlined
def largest_ratio(S, gain, B):
    """Largest eigenvalue of S⁻¹ diag(gain) for a symmetric positive definite S (3, 3) and gains (3,) ≥ 0; B: scratch (3, 3).

    It is that of the symmetric B = √gain S⁻¹ √gain.
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
    return largest_eigenvalue(B)


@inlined
def largest_form_ratio(S, Q, B):
    """Largest eigenvalue of S⁻¹Q for symmetric S > 0 and Q ≥ 0 (3, 3), of which Q is overwritten; B: scratch (3, 3).

    It is that of the symmetric L⁻¹ Q L⁻ᵀ with S = LLᵀ.
    """
    l00 = np.sqrt(S[0, 0])
    l10, l20 = S[1, 0] / l00, S[2, 0] / l00
    l11 = np.sqrt(S[1, 1] - l10 * l10)
    l21 = (S[2, 1] - l20 * l10) / l11
    l22 = np.sqrt(S[2, 2] - l20 * l20 - l21 * l21)
    for b in range(3):  # columns of L⁻¹Q, and then its rows, which are the columns of its transpose
        _forward(l00, l10, l20, l11, l21, l22, Q[:, b], B[:, b])
    for b in range(3):
        _forward(l00, l10, l20, l11, l21, l22, B[b], Q[b])
    return largest_eigenvalue(Q)


@inlined
def _forward(l00, l10, l20, l11, l21, l22, b, z):
    """Solve L z = b, (3,)."""
    z[0] = b[0] / l00
    z[1] = (b[1] - l10 * z[0]) / l11
    z[2] = (b[2] - l20 * z[0] - l21 * z[1]) / l22


@inlined
def largest_eigenvalue(B):
    """Largest eigenvalue of a symmetric B (3, 3), given its upper triangle, in closed form (Smith, Commun. ACM 4 (1961) 168)."""
    mean = (B[0, 0] + B[1, 1] + B[2, 2]) / 3
    off = B[0, 1] * B[0, 1] + B[0, 2] * B[0, 2] + B[1, 2] * B[1, 2]
    x, y, z = B[0, 0] - mean, B[1, 1] - mean, B[2, 2] - mean
    p = np.sqrt((x * x + y * y + z * z + 2 * off) / 6)
    if p == 0:
        return mean
    half = x * (y * z - B[1, 2] * B[1, 2]) - B[0, 1] * (B[0, 1] * z - B[1, 2] * B[0, 2])
    half += B[0, 2] * (B[0, 1] * B[1, 2] - y * B[0, 2])
    half /= 2 * p * p * p
    return mean + 2 * p * third_of_angle(np.sqrt(max(0.0, 0.5 + 0.5 * half)))


@inlined
def third_of_angle(u):
    """cos(⅔ arccos u), 0 ≤ u ≤ 1, to 7e-15, by a polynomial; u = √((1 + h)/2) gives cos(⅓ arccos h).

    Interpolated at the Chebyshev points of 0 to 1. It is smooth in u, but not in h.
    """
    u = min(u, 1.0)
    w = u * u
    z = w * w
    a = (0.5000000000000069 + u * 0.5773502691861132) + w * (-0.11111111080995631 + u * 0.053458347977806624)
    b = (-0.03292162493555988 + u * 0.02286624897897111) + w * (-0.017055565944752826 + u * 0.013293041113790259)
    c = (-0.010550248345813997 + u * 0.008209146896930546) + w * (-0.005920999638576625 + u * 0.0036912026322573066)
    d = (-0.0018389155831255988 + u * 0.0006676246164836521) + w * (
        -0.00015425694291050363 + u * 1.6840798339836843e-05
    )
    return (a + z * b) + (z * z) * (c + z * d)
