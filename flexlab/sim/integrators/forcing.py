"""What moves a beam of many coupled modes, said in a few numbers: matrix functions act on it at a fraction of their price.

Without its linear part the beam's rate is, as `physics.plant` has it,

    N = (-h, Dh) v2 + (-g, Dg) ω + (0, -h) (ω v1 + gravity cos θ) + (0, s),    s = ω²η + what a hand puts on it,

so that φ(hL) N needs the answers to three fixed forces, and of the rest only the columns of modes in which s is anything:
rotation takes ω²/Ω² of a mode's stiffness. A dense product of the whole reads more numbers than a processor keeps close.
"""

import numpy as np

from flexlab.compiled import inlined
from flexlab.physics.plant import DG, DH, ETA, H

FEWEST_COUPLED = 16
"""Modes that damping couples from which on this pays: with fewer, whole matrices are as fast."""

STIFF_MODE = 3e5
"""rad/s. Of stiffer modes rotation takes about a billionth of the stiffness, at 10 rad/s: that is left out."""

COMMON = 3
"""Fixed forces: lateral and angular velocity of the grips, and their lift ω v1 + gravity cos θ."""


def is_factored(block_start: np.ndarray) -> bool:
    """Whether a beam with these blocks of modes is moved this way."""
    return int(np.diff(block_start).max(initial=0)) >= FEWEST_COUPLED


def forced_columns(function: np.ndarray, damping: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Of one block φ (2k, 2k) in (η, π) times the fixed forces, then times a unit force on each mode, (3 + k, 2k)."""
    k = len(damping)
    h, g = loads
    moving = np.array([np.concatenate([-load, damping @ load]) for load in (h, g)])
    common = np.concatenate([moving, [np.concatenate([np.zeros(k), -h])]])
    return np.concatenate([common @ function.T, function[:, k:].T])


def soft_modes(omega: np.ndarray, block_start: np.ndarray) -> np.ndarray:
    """How many modes of each block, which stand in ascending order, rotation is notable in, (blocks,)."""
    blocks = zip(block_start[:-1], block_start[1:], strict=True)
    return np.array([np.count_nonzero(omega[low:high] <= STIFF_MODE) for low, high in blocks], dtype=np.int64)


@inlined
def factor_rates(plant, ws, N):
    """Write over the beam's part of rates N what they are made of: v2, ω and the lift in place of its first η̇, s for its π̇."""
    n, c, s, v = plant.modal.shape[1], ws.arm.trig[0], ws.arm.trig[1], ws.velocity
    lateral, turn, lift = c * v[1] - s * v[0], v[2], v[2] * (c * v[0] + s * v[1]) + plant.gravity * c
    for k in range(n):
        N[ETA + n + k] += plant.modal[H, k] * lift - plant.modal[DH, k] * lateral - plant.modal[DG, k] * turn
    N[ETA], N[ETA + 1], N[ETA + 2] = lateral, turn, lift


@inlined
def add_forced(starts, n, forced, soft, hand_pulls, z, out):
    """out += φ N on the beam's part, of rates z as `factor_rates` leaves them; `forced`: `forced_columns`, block after block.

    `soft`: of each block, as `soft_modes`; a hand at the beam may move all.
    """
    at = 0
    for block in range(len(starts) - 1):
        low, k = ETA + starts[block], starts[block + 1] - starts[block]
        on_eta, on_pi, force = out[low : low + k], out[low + n : low + n + k], z[low + n : low + n + k]
        for column in range(COMMON + (k if hand_pulls else soft[block])):
            scale = z[ETA + column] if column < COMMON else force[column - COMMON]
            first = at + column * 2 * k
            eta, pi = forced[first : first + k], forced[first + k : first + 2 * k]
            for i in range(k):
                on_eta[i] += scale * eta[i]
            for i in range(k):
                on_pi[i] += scale * pi[i]
        at += (COMMON + k) * 2 * k
