"""What all control laws share: sampling, limits, noise, and the believed payload."""

from typing import TYPE_CHECKING, Any, Literal

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from flexlab.physics.law_input import MOST_DELAY
from flexlab.quantities import Count, Number, Pair, Part, Triple, quantity


class PayloadModel(Part):
    """The payload as the controller believes it to be: factors on the true values."""

    linear_density_factor: Number = quantity(1.0, "Believed ρ / true ρ", unit="1", low=1e-3, high=1e3)
    length_factor: Number = quantity(1.0, "Believed L / true L", unit="1", low=1e-1, high=10)
    stiffness_factor: Number = quantity(1.0, "Believed EI / true EI", unit="1", low=1e-3, high=1e3)
    """Used by models of the beam's bending: the Kalman observer, and laws with it."""
    axial_load: Literal["none", "first-order"] = quantity("none", "Believed force along the beam")
    """Whether such a model includes the stiffness from the steady axial force of F_d and the weight."""
    friction_factor: Number = quantity(0.0, "Believed joint friction / true", unit="1", low=0, high=3)
    """Share of the joints' friction, at the measured rates, that is added to the torques; 0: the controller ignores friction."""
    mass_change_factor: Number = quantity(0.0, "Believed change of the payload's mass / true", unit="1", low=0, high=1)
    """Share of `payload.mass_change` in the mass and inertia that a law gets at each instant; 0: they stay. A model of the beam's
    bending (the Kalman observer's, and laws made for it) keeps the mass at the start."""


class SensorNoise(Part):
    """White Gaussian noise on what a sampled controller measures; the same seed gives the same run."""

    pose: Triple = quantity((0.0, 0.0, 0.0), "Pose noise", "σ_x", "m, m, rad", low=0, high=1)
    pose_rate: Triple = quantity((0.0, 0.0, 0.0), "Pose rate noise", "σ_v", "m/s, m/s, rad/s", low=0, high=10)
    strain: Number = quantity(0.0, "Strain gauge noise", "σ_ε", "1", low=0, high=1)
    """Noise of each reading of a strain gauge; hᵀq̇ and gᵀq̇ are differences of readings over one control period."""
    moment_rate: Pair = quantity((0.0, 0.0), "Noise of measured hᵀq̇, gᵀq̇", "σ_h", "kg·m/s, kg·m²/s", low=0, high=1e6)
    """White noise on the two rates themselves, for other sensors than gauges; the meaning of `strain` in scenarios until 0.1."""
    seed: Count = quantity(0, "Seed", low=0, high=2**31 - 1)

    @property
    def active(self) -> bool:
        """Whether there is any noise."""
        return any(self.pose) or any(self.pose_rate) or self.strain > 0 or any(self.moment_rate)


class Controller(Part):
    """What all control laws share: sampling, limits and what the controller knows."""

    if TYPE_CHECKING:
        kind: Any  # Each law's own name, a Literal.

    control_period: Number | None = quantity(None, "Control period (null: continuous)", "T_c", "s", low=1e-5, high=0.1)
    input_delay: Count = quantity(0, "Input delay", "d", "samples", low=0, high=MOST_DELAY)
    torque_limit: Triple | None = quantity(
        None, "Torque limit per joint (null: none)", "τ_max", "N·m", low=1e-3, high=1e6
    )
    load_share: Number = quantity(0.5, "Load share of the left arm", "α", "1", low=0, high=1, slider=(0, 1))
    """The left arm takes α of what laws share between two arms, the right arm 1 - α; a single arm takes all."""
    wanted_internal_force: Number = quantity(
        0.0, "Wanted internal force (squeeze positive)", "F_d", "N", low=-1e4, high=1e4, slider=(-100, 100)
    )
    """F_d (cos θ, sin θ, 0) is added to the left arm's input and its opposite to the right arm's."""
    model: PayloadModel = PayloadModel()
    sensor_noise: SensorNoise = SensorNoise()

    @model_validator(mode="after")
    def _sampled(self) -> "Controller":
        if self.control_period is None and (self.input_delay or self.sensor_noise.active):
            raise PydanticCustomError(
                "sampling",
                "the input delay and the noise of the sensors belong to sampled control: "
                "give the control period (controller.control_period) a value in s",
            )
        return self
