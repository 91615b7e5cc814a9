"""The beam that is carried: mesh, boundary, damping and change of mass.

A further kind of damping is one more class here: the scenario, the menu and the beam's model find it by `DampingKind`.
"""

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from flexlab.boundaries import HELD_COORDINATES
from flexlab.numerics.linear_algebra import product
from flexlab.quantities import Count, Number, Part, either, quantity


class DampingKind(Part):
    """Base of all kinds of damping."""

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV (n_m, n_m), 1/s, for modes of frequencies omega (n_m,), rad/s, and mass-normalised shapes V (n_q, n_m)."""
        raise NotImplementedError


class NodalDamping(DampingKind):
    """Viscous damping c on every nodal rate, the paper's reading; depends on the mesh."""

    kind: Literal["nodal"] = "nodal"
    coefficient: Number = quantity(0.1, "Damping", "c", "N·s/m", low=0, high=1e3, slider=(0, 2))

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV for D = c·1 on every nodal rate."""
        return self.coefficient * product(V.T, V)


class StiffnessDamping(DampingKind):
    """Damping proportional to the stiffness, C = β K_F: grows with the square of the mode's frequency."""

    kind: Literal["stiffness"] = "stiffness"
    coefficient: Number = quantity(1e-4, "Stiffness damping", "β", "s", low=0, high=1, slider=(0, 2e-3))

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV for D = β K_F."""
        return np.diag(self.coefficient * (omega * omega))


class ModalDamping(DampingKind):
    """The same damping ratio ζ for every mode, whatever the mesh."""

    kind: Literal["modal"] = "modal"
    ratio: Number = quantity(0.01, "Damping ratio", "ζ", "1", low=0, high=2, slider=(0, 0.2))

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV for the same ζ in every mode."""
        return np.diag(2 * self.ratio * omega)


Damping = Annotated[Any, Field(discriminator="kind")]
if not TYPE_CHECKING:
    Damping = Annotated[either(DampingKind.__subclasses__()), Field(discriminator="kind")]


Boundary = Literal["pinned-pinned", "clamped-clamped", "clamped-pinned", "pinned-clamped", "clamped-free"]
AxialLoad = Literal["none", "first-order"]
FIXED_COORDINATES = {boundary: len(held) for boundary, held in HELD_COORDINATES.items()}
"""Number of the 2 (n + 1) nodal coordinates that each boundary holds at zero."""


class MassChange(Part):
    """A payload that is filled or emptied: its mass changes smoothly to another value (`physics.mass_change`)."""

    factor: Number = quantity(
        1.0, "Final mass over initial mass (1: constant)", "μ", "1", low=0.05, high=20, slider=(0.2, 5),
        logarithmic=True,
    )  # fmt: skip
    """Bending stiffness and damping stay, as for a tube that its contents do not stiffen."""
    begin: Number = quantity(1.0, "Start of the change of mass", "t_μ", "s", low=0, high=1e4, slider=(0, 10))
    duration: Number = quantity(1.0, "Duration of the change of mass", "T_μ", "s", low=0.01, high=1e4, slider=(0.1, 10))

    @property
    def active(self) -> bool:
        """Whether the mass changes."""
        return self.factor != 1

    @property
    def lightest(self) -> float:
        """Least mass over mass at the start, 1."""
        return min(1.0, self.factor)


class Payload(Part):
    """The flexible beam between the grips (Euler-Bernoulli, Hermite finite elements)."""

    length: Number = quantity(0.5, "Length", "L", "m", low=0.05, high=10, slider=(0.2, 1), live="restart")
    linear_density: Number = quantity(2.0, "Mass per length", "ρ", "kg/m", low=1e-3, high=1e3, slider=(0.5, 10))
    bending_stiffness: Number = quantity(
        100.0, "Bending stiffness", "EI", "N·m²", low=1e-3, high=1e12, slider=(1, 1000), logarithmic=True
    )
    thickness: Number = quantity(0.005, "Thickness", "t_b", "m", low=1e-5, high=1)
    """Across the beam in the plane of bending; it scales the strain of the gauges on its surface."""
    element_count: Count = quantity(2, "Elements", "n", "1", low=1, high=64, slider=(1, 64), live="projected")
    boundary: Boundary = quantity("pinned-pinned", "Boundary", live="projected")
    damping: Damping = quantity(NodalDamping(), "Damping")
    axial_load: AxialLoad = quantity("none", "Force along the beam")
    """Effect of the axial force on the beam: "none", as in the paper, or "first-order" (`physics.axial_load`)."""
    mass_change: MassChange = MassChange()
    mode_count: Count | None = quantity(None, "Modes kept (null: all)", "n_m", "1", low=1, high=130, live="projected")

    @property
    def coordinate_count(self) -> int:
        """n_q, the number of free nodal coordinates."""
        return 2 * (self.element_count + 1) - FIXED_COORDINATES[self.boundary]

    @model_validator(mode="after")
    def _has_coordinates(self) -> "Payload":
        if self.coordinate_count < 1:
            raise PydanticCustomError(
                "mesh", "a clamped-clamped beam needs 2 elements or more: with 1 it has no coordinate left to bend"
            )
        if self.mode_count is not None and self.mode_count > self.coordinate_count:
            raise PydanticCustomError(
                "mesh",
                "mode_count = {kept} is more than the {all} modes that this mesh has: keep {all} or fewer, or write null",
                {"kept": self.mode_count, "all": self.coordinate_count},
            )
        return self
