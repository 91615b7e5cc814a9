"""The control laws, and how they meet the arms: sampling, limits, noise, and what they believe of the payload."""

from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from flexlab.quantities import Count, Number, OneOrThree, Pair, Part, Triple, quantity


class PayloadModel(Part):
    """What the controller believes of the payload: factors on the true values."""

    linear_density_factor: Number = quantity(1.0, title="Believed ρ / true ρ", unit="1", low=1e-3, high=1e3)
    length_factor: Number = quantity(1.0, title="Believed L / true L", unit="1", low=1e-1, high=10)


class SensorNoise(Part):
    """White Gaussian noise on what a sampled controller measures; the same seed gives the same run."""

    pose: Triple = quantity((0.0, 0.0, 0.0), title="Pose noise", symbol="σ_x", unit="m, m, rad", low=0, high=1)
    pose_rate: Triple = quantity(
        (0.0, 0.0, 0.0), title="Pose rate noise", symbol="σ_v", unit="m/s, m/s, rad/s", low=0, high=10
    )
    strain: Number = quantity(0.0, title="Strain gauge noise", symbol="σ_ε", unit="1", low=0, high=1)
    """Of each reading of each strain gauge; hᵀq̇ and gᵀq̇ come from the change of the readings over one control period."""
    moment_rate: Pair = quantity(
        (0.0, 0.0), title="Noise of measured hᵀq̇, gᵀq̇", symbol="σ_h", unit="kg·m/s, kg·m²/s", low=0, high=1e6
    )
    """White noise on the two rates themselves, for another sensor than gauges; what `strain` meant in scenarios until 0.1."""
    seed: Count = quantity(0, title="Seed", low=0, high=2**31 - 1)

    @property
    def active(self) -> bool:
        """Whether any noise is asked for."""
        return any(self.pose) or any(self.pose_rate) or self.strain > 0 or any(self.moment_rate)


class Controller(Part):
    """What all control laws share: sampling, limits and what the controller knows."""

    control_period: Number | None = quantity(
        None, title="Control period (null: continuous)", symbol="T_c", unit="s", low=1e-5, high=0.1
    )
    input_delay: Count = quantity(0, title="Input delay", symbol="d", unit="samples", low=0, high=64)
    torque_limit: Triple | None = quantity(
        None, title="Torque limit per joint (null: none)", symbol="τ_max", unit="N·m", low=1e-3, high=1e6
    )
    model: PayloadModel = PayloadModel()
    sensor_noise: SensorNoise = SensorNoise()

    @model_validator(mode="after")
    def _sampled(self) -> "Controller":
        if self.control_period is None and (self.input_delay or self.sensor_noise.active):
            raise PydanticCustomError(
                "sampling", "input_delay and sensor_noise belong to sampled control: give control_period a value in s"
            )
        return self


class AdaptiveSlidingMode(Controller):
    """Zhang & Li's law, Eqs. (23) and (25)."""

    kind: Literal["adaptive-sliding-mode"] = "adaptive-sliding-mode"
    feedback_gain: OneOrThree = quantity(
        200.0, title="Feedback gain", symbol="K", unit="N·s/m, N·m·s/rad", low=0, high=1e6, slider=(0, 1000)
    )
    sliding_slope: OneOrThree = quantity(
        50.0, title="Sliding slope", symbol="Λ", unit="1/s", low=0, high=1e4, slider=(1, 200)
    )
    boundary_layer: Number = quantity(
        0.1, title="Boundary layer", symbol="ε", unit="m/s", low=1e-9, high=1e3, slider=(0.001, 1), logarithmic=True
    )
    adaptation: Triple = quantity(
        (10.0, 10.0, 10.0),
        title="Adaptation (k0, k1, k2)",
        symbol="k",
        unit="m/N, m³/N, m⁵/(N·s⁴)",
        low=1e-6,
        high=1e12,
        slider=(0.1, 1000),
        logarithmic=True,
    )


class VibrationDamping(AdaptiveSlidingMode):
    """The paper's law with active damping of the beam (its future work): a_lat = k_v hᵀq̇, α = k_θ gᵀq̇."""

    kind: Literal["vibration-damping"] = "vibration-damping"  # type: ignore[assignment]
    lateral_vibration_gain: Number = quantity(
        100.0, title="Lateral vibration gain", symbol="k_v", unit="1/(kg·s)", low=0, high=1e5, slider=(0, 300)
    )
    angular_vibration_gain: Number = quantity(
        0.0, title="Angular vibration gain", symbol="k_θ", unit="1/(kg·m²·s)", low=0, high=1e6, slider=(0, 3000)
    )


class ComputedTorque(Controller):
    """Inverse dynamics of the rigid system with pose feedback: ẍ → ẍ_d - K_d ė - K_p e."""

    kind: Literal["computed-torque"] = "computed-torque"
    position_gain: OneOrThree = quantity(
        2500.0, title="Position gain", symbol="K_p", unit="1/s²", low=0, high=1e7, slider=(0, 10000)
    )
    velocity_gain: OneOrThree = quantity(
        100.0, title="Velocity gain", symbol="K_d", unit="1/s", low=0, high=1e5, slider=(0, 500)
    )


class ProportionalDerivative(Controller):
    """Task-space PD with weight compensation and nothing else known: u = Ḡ - P e - D ė."""

    kind: Literal["pd"] = "pd"
    position_gain: OneOrThree = quantity(
        20000.0, title="Position gain", symbol="P", unit="N/m, N·m/rad", low=0, high=1e8, slider=(0, 100000)
    )
    velocity_gain: OneOrThree = quantity(
        800.0, title="Velocity gain", symbol="D", unit="N·s/m, N·m·s/rad", low=0, high=1e6, slider=(0, 5000)
    )


class NoControl(Controller):
    """Motors without torque: the arms swing freely."""

    kind: Literal["none"] = "none"


Law = Annotated[
    AdaptiveSlidingMode | VibrationDamping | ComputedTorque | ProportionalDerivative | NoControl,
    Field(discriminator="kind"),
]
