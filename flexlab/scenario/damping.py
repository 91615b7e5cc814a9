"""Kinds of damping of the beam: each with its number as a scenario field, and its matrix over the modes.

A new kind is one more class here: the scenario, the menu and the beam's model find it by `DampingKind`.
"""

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flexlab.numerics.linear_algebra import product
from flexlab.quantities import Number, Part, either, quantity


class DampingKind(Part):
    """Base of all kinds of damping."""

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV (n_m, n_m), 1/s, for modes of frequencies omega (n_m,), rad/s, and mass-normalised shapes V (n_q, n_m)."""
        raise NotImplementedError


class NodalDamping(DampingKind):
    """Viscous damping c on every nodal rate, the paper's reading; depends on the mesh."""

    kind: Literal["nodal"] = "nodal"
    coefficient: Number = quantity(0.1, title="Damping", symbol="c", unit="N·s/m", low=0, high=1e3, slider=(0, 2))

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV for D = c·1 on every nodal rate."""
        return self.coefficient * product(V.T, V)


class StiffnessDamping(DampingKind):
    """Damping proportional to the stiffness, C = β K_F: grows with the square of the mode's frequency."""

    kind: Literal["stiffness"] = "stiffness"
    coefficient: Number = quantity(
        1e-4, title="Stiffness damping", symbol="β", unit="s", low=0, high=1, slider=(0, 2e-3)
    )

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV for D = β K_F."""
        return np.diag(self.coefficient * (omega * omega))


class ModalDamping(DampingKind):
    """The same damping ratio ζ for every mode, whatever the mesh."""

    kind: Literal["modal"] = "modal"
    ratio: Number = quantity(0.01, title="Damping ratio", symbol="ζ", unit="1", low=0, high=2, slider=(0, 0.2))

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV for the same ζ in every mode."""
        return np.diag(2 * self.ratio * omega)


Damping = Annotated[Any, Field(discriminator="kind")]
if not TYPE_CHECKING:
    Damping = Annotated[either(DampingKind.__subclasses__()), Field(discriminator="kind")]
