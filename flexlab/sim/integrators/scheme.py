"""The constants that an integrator computes once per step size.

Kernels get the members of a `Scheme` one by one. The one that is not None selects the integrator: numba drops the branches of
the others, and so compiles each integrator separately, when it is first used.
"""

from typing import NamedTuple

import numpy as np

ORDER = {"rk4": 4, "etdrk4": 4, "generalized-alpha": 2}
"""Declared order of accuracy of each integrator."""
STATE = 5
"""Row of `Workspace.stage` with the state at which stages after the first need the rates."""


class Etdrk4(NamedTuple):
    """Constants of `etdrk4`."""

    operators: np.ndarray
    """The five matrix functions of the beam's linear part, one per row, block after block, (5, Σ 4k²); only the last, (1, Σ
    4k²), if the others are `forced`."""
    forced: np.ndarray
    """The first four as `forcing.forced_columns`, (4, Σ 2k (k + 3)); (4, 0) if few modes are coupled."""
    soft_modes: np.ndarray
    """As `forcing.soft_modes`, (blocks,); empty if few modes are coupled."""
    flow: np.ndarray
    """The rows of `beam_flow`, (25, n_m); (25, 0) without damping."""


class GeneralizedAlpha(NamedTuple):
    """Constants of `generalized_alpha`."""

    inverse: np.ndarray
    """Inverse of the beam's effective mass, block diagonal, (n_m, n_m)."""
    coupling: np.ndarray
    """That inverse times Vᵀh and Vᵀg, (2, n_m)."""


class Scheme(NamedTuple):
    """The constants of one integrator for one step size; the others are None."""

    etdrk4: Etdrk4 | None = None
    generalized_alpha: GeneralizedAlpha | None = None
    rk4: bool | None = None
    """True for rk4, which has no constants."""

    @property
    def notes_rates(self) -> bool:
        """Whether its steps note the beam's true rates behind the state."""
        return self.etdrk4 is not None and self.etdrk4.flow.shape[1] > 0
