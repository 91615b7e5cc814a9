"""The motion of a beam of many coupled modes under its few fixed forces.

A few numbers determine what moves a beam of many coupled modes, so that matrix functions act on it at a fraction of their cost.
Without its linear part the beam's rate is, by `physics.plant`,

    N = (-h, Dh) v2 + (-g, Dg) ω + (0, -h) (ω v1 + gravity cos θ) + (0, s),    s = ω²η + what a hand puts on it,

so that φ(hL) N needs the responses to three fixed forces, and otherwise only the columns of modes in which s is notable: rotation
takes ω²/Ω² of a mode's stiffness. A dense product of all reads more numbers than fit into a processor's cache.
"""

import numpy as np

from flexlab.compiled import disjoint, inlined
from flexlab.numerics.linear_algebra import product
from flexlab.physics.axial_load import STIFF_MODE
from flexlab.physics.plant import DG, DH, ETA, H

FEWEST_COUPLED = 16
"""Smallest number of coupled modes for which this pays: with fewer, dense matrices are as fast."""
COMMON = 3
"""Fixed forces: lateral and angular velocity of the grips, and their lift ω v1 + gravity cos θ."""


def is_factored(block_start: np.ndarray) -> bool:
    """Whether a beam with these blocks of modes is moved by its responses to fixed forces."""
    return int(np.diff(block_start).max(initial=0)) >= FEWEST_COUPLED


def forced_columns(function: np.ndarray, damping: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """φ (2k, 2k) of one block, in (η, π), times the fixed forces, then times a unit force on each mode, (3 + k, 2k)."""
    k = len(damping)
    moving = np.concatenate([-loads, product(loads, damping.T)], axis=1)
    common = np.concatenate([moving, [np.concatenate([np.zeros(k), -loads[0]])]])
    return np.concatenate([product(common, function.T), function[:, k:].T])


def soft_modes(omega: np.ndarray, block_start: np.ndarray) -> np.ndarray:
    """Number of modes in each block, ordered by frequency, in which rotation is notable, (blocks,).

    Above `STIFF_MODE` it takes about a billionth of the stiffness, at 10 rad/s.
    """
    blocks = zip(block_start[:-1], block_start[1:], strict=True)
    return np.array([np.count_nonzero(omega[low:high] <= STIFF_MODE) for low, high in blocks], dtype=np.int64)


@inlined
def factor_rates(plant, ws, N):
    """Overwrite the beam's part of rates N with their factors: v2, ω and the lift in place of its first η̇, s in that of π̇."""
    n, c, s, v = plant.modal.shape[1], ws.arm.trig[0], ws.arm.trig[1], ws.velocity
    lateral, turn, lift = c * v[1] - s * v[0], v[2], v[2] * (c * v[0] + s * v[1]) + plant.gravity * c
    for k in range(n):
        N[ETA + n + k] += plant.modal[H, k] * lift - plant.modal[DH, k] * lateral - plant.modal[DG, k] * turn
    N[ETA], N[ETA + 1], N[ETA + 2] = lateral, turn, lift


@disjoint
def add_two(a, column, b, other, on_eta, on_pi):
    """Add two columns (2k,) times two numbers to η and π (k,)."""
    k = len(on_eta)
    first, second, third, fourth = column[:k], column[k : 2 * k], other[:k], other[k : 2 * k]
    for i in range(k):
        on_eta[i] += a * first[i] + b * third[i]
    for i in range(k):
        on_pi[i] += a * second[i] + b * fourth[i]


@disjoint
def add_four(a, b, columns, c, d, others, on_eta, on_pi):
    """Add four columns (2k,) times four numbers to η and π (k,); `columns` and `others` hold two each.

    Elements are independent: the bits are the same however many of them a vector unit takes at once.
    """
    k = len(on_eta)
    a1, a2, b1, b2 = columns[:k], columns[k : 2 * k], columns[2 * k : 3 * k], columns[3 * k : 4 * k]
    c1, c2, d1, d2 = others[:k], others[k : 2 * k], others[2 * k : 3 * k], others[3 * k : 4 * k]
    for i in range(k):
        on_eta[i] += (a * a1[i] + b * b1[i]) + (c * c1[i] + d * d1[i])
    for i in range(k):
        on_pi[i] += (a * a2[i] + b * b2[i]) + (c * c2[i] + d * d2[i])


@inlined
def add_forced(starts, n, forced, soft, hand_pulls, z, out):
    """out += φ N in (η, π), (2 n_m,), for rates z that `factor_rates` has overwritten.

    `forced`: `forced_columns`, block after block. `soft`: `soft_modes`; a hand at the beam may move all modes.
    """
    at = 0
    for block in range(len(starts) - 1):
        low, k = starts[block], starts[block + 1] - starts[block]
        on_eta, on_pi, force = out[low : low + k], out[low + n : low + n + k], z[low + n : low + n + k]
        common, own = forced[at : at + 2 * COMMON * k], forced[at + 2 * COMMON * k : at + 2 * (COMMON + k) * k]
        add_two(z[0], common, z[1], common[2 * k :], on_eta, on_pi)
        moved = k if hand_pulls else soft[block]
        # The lift together with the first mode's force, so that the others can be added by fours.
        add_two(z[2], common[4 * k :], force[0], own, on_eta, on_pi)
        j = 1
        while j + 3 < moved:
            first, third = own[2 * k * j :], own[2 * k * (j + 2) :]
            add_four(force[j], force[j + 1], first, force[j + 2], force[j + 3], third, on_eta, on_pi)
            j += 4
        while j < moved:
            other = min(j + 1, moved - 1)
            add_two(force[j], own[2 * k * j :], force[other] if other > j else 0.0, own[2 * k * other :], on_eta, on_pi)
            j += 2
        at += 2 * (COMMON + k) * k
