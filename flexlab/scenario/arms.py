"""The arms that carry it."""

from typing import Literal

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from flexlab.quantities import Pair, Part, Triple, quantity


class Arm(Part):
    """One planar three-joint arm; relative joint angles, `elbow` the sign of joint 2."""

    base: Pair = quantity(title="Base position", symbol="p_b", unit="m", low=-20, high=20, live="restart")
    link_mass: Triple = quantity(
        (8.0, 8.0, 4.0), title="Link masses", symbol="m", unit="kg", low=0, high=1e4, live="restart"
    )
    link_length: Triple = quantity(
        (0.7, 0.6, 0.2), title="Link lengths", symbol="l", unit="m", low=1e-3, high=20, live="restart"
    )
    link_center: Triple = quantity(
        (0.4, 0.35, 0.1), title="Centres of mass from the joint", symbol="a", unit="m", low=-20, high=20, live="restart"
    )
    link_inertia: Triple | None = quantity(
        None,
        title="Link inertias about the centre (null: m L²/12)",
        symbol="I_c",
        unit="kg·m²",
        low=0,
        high=1e6,
        live="restart",
    )
    elbow: Literal[-1, 1] = quantity(title="Elbow side", low=-1, high=1, live="restart")

    @property
    def inertia(self) -> tuple[float, float, float]:
        """Link inertias about their centres, kg·m², with null filled in."""
        if self.link_inertia is not None:
            return self.link_inertia
        first, second, third = (
            m * length * length / 12 for m, length in zip(self.link_mass, self.link_length, strict=True)
        )
        return first, second, third

    @model_validator(mode="after")
    def _has_inertia(self) -> "Arm":
        for joint in range(3):
            moment = self.link_mass[joint] * (self.link_center[joint] * self.link_center[joint]) + self.inertia[joint]
            if moment <= 0:
                raise PydanticCustomError(
                    "inertia",
                    "link {link} has neither mass nor inertia: give link_mass or link_inertia a positive value",
                    {"link": joint + 1},
                )
        return self
