"""Task-space PD with weight compensation: the rival that knows no dynamics."""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import inlined


class FeedbackGains(NamedTuple):
    """Diagonal gains on pose error and its rate, each (3,)."""

    position: np.ndarray
    velocity: np.ndarray


@inlined
def proportional_derivative(gains, payload, gravity, x, v, terms, desired, u):
    """u_i = Ḡ_i + share (weight - P e - D ė), (arms, 3)."""
    share = 1.0 / len(u)
    for i in range(len(u)):
        for a in range(3):
            feedback = gains.position[a] * (x[a] - desired[0, a]) + gains.velocity[a] * (v[a] - desired[1, a])
            u[i, a] = terms.G[i, a] - share * feedback
        u[i, 1] += share * payload.m * gravity
