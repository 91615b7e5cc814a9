"""What a step needs besides the system: the method and the constants it computes once per step size."""

from typing import NamedTuple

import numpy as np

RK4, ETDRK4, GENERALIZED_ALPHA = range(3)
NAMES = {"rk4": RK4, "etdrk4": ETDRK4, "generalized-alpha": GENERALIZED_ALPHA}
ORDER = {"rk4": 4, "etdrk4": 4, "generalized-alpha": 2}
"""Declared order of accuracy of each integrator."""


class Scheme(NamedTuple):
    """Method number and its constants for one step size."""

    kind: int
    operators: np.ndarray
    """etdrk4: the five matrix functions of the beam's linear part, by row, block after block, (5, Σ 4k²)."""
    inverse: np.ndarray
    """generalized-alpha: inverse of the beam's effective mass, block diagonal, (n_m, n_m)."""
    coupling: np.ndarray
    """generalized-alpha: that inverse times Vᵀh and Vᵀg, (2, n_m)."""
    flow: np.ndarray
    """etdrk4 of a damped beam: the rows of `beam_flow`, (15, n_m); (15, 0) where nothing is damped."""
