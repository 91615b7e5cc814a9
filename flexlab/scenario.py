"""The scenario: everything that defines one experiment, as frozen, validated data.

Names are words; each field's metadata gives its symbol, unit and range (see `flexlab.quantities`). `parse_scenario` turns
plain data into a `Scenario` or raises `ScenarioError` with one sentence per problem; `Scenario.replace` changes fields by
path (`"payload.bending_stiffness"`). Presets and files are in `flexlab.presets`.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from flexlab.errors import ScenarioError
from flexlab.quantities import Count, Number, Numbers, OneOrThree, Pair, Part, Quantity, Triple, describe, quantity

Boundary = Literal["pinned-pinned", "clamped-clamped", "clamped-pinned", "pinned-clamped", "clamped-free"]
FIXED_COORDINATES: dict[str, int] = {
    "pinned-pinned": 2,
    "clamped-clamped": 4,
    "clamped-pinned": 3,
    "pinned-clamped": 3,
    "clamped-free": 2,
}
"""How many of the 2 (n + 1) nodal coordinates each boundary holds at zero."""

SMALLEST_STEP = 1e-7
"""Shortest integration step, s: below it rounding outweighs truncation for every integrator here."""


class NodalDamping(Part):
    """Viscous damping c on every nodal rate, the paper's reading; depends on the mesh."""

    kind: Literal["nodal"] = "nodal"
    coefficient: Number = quantity(0.1, title="Damping", symbol="c", unit="N·s/m", low=0, high=1e3, slider=(0, 2))


class StiffnessDamping(Part):
    """Damping proportional to the stiffness, C = β K_F: grows with the square of the mode's frequency."""

    kind: Literal["stiffness"] = "stiffness"
    coefficient: Number = quantity(
        1e-4, title="Stiffness damping", symbol="β", unit="s", low=0, high=1, slider=(0, 2e-3)
    )


class ModalDamping(Part):
    """The same damping ratio ζ for every mode, whatever the mesh."""

    kind: Literal["modal"] = "modal"
    ratio: Number = quantity(0.01, title="Damping ratio", symbol="ζ", unit="1", low=0, high=2, slider=(0, 0.2))


Damping = Annotated[NodalDamping | StiffnessDamping | ModalDamping, Field(discriminator="kind")]


class Payload(Part):
    """The flexible beam between the grips (Euler-Bernoulli, Hermite finite elements)."""

    length: Number = quantity(
        0.5, title="Length", symbol="L", unit="m", low=0.05, high=10, slider=(0.2, 1), live="restart"
    )
    linear_density: Number = quantity(
        2.0, title="Mass per length", symbol="ρ", unit="kg/m", low=1e-3, high=1e3, slider=(0.5, 10)
    )
    bending_stiffness: Number = quantity(
        100.0,
        title="Bending stiffness",
        symbol="EI",
        unit="N·m²",
        low=1e-3,
        high=1e12,
        slider=(1, 1000),
        logarithmic=True,
    )
    element_count: Count = quantity(
        2, title="Elements", symbol="n", unit="1", low=1, high=64, slider=(1, 64), live="projected"
    )
    boundary: Boundary = quantity("pinned-pinned", title="Boundary", live="projected")
    damping: Damping = quantity(NodalDamping(), title="Damping")
    mode_count: Count | None = quantity(
        None, title="Modes kept (null: all)", symbol="n_m", unit="1", low=1, high=130, live="projected"
    )

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
        first, second, third = (m * length**2 / 12 for m, length in zip(self.link_mass, self.link_length, strict=True))
        return first, second, third

    @model_validator(mode="after")
    def _has_inertia(self) -> "Arm":
        for joint in range(3):
            moment = self.link_mass[joint] * self.link_center[joint] ** 2 + self.inertia[joint]
            if moment <= 0:
                raise PydanticCustomError(
                    "inertia",
                    "link {link} has neither mass nor inertia: give link_mass or link_inertia a positive value",
                    {"link": joint + 1},
                )
        return self


class SineTrajectory(Part):
    """x_d(t) = center + amplitude · sin(2π frequency t + phase), for x, y and θ (Section IV of the paper)."""

    kind: Literal["sine"] = "sine"
    center: Triple = quantity(
        (0.0, 0.75, 0.0), title="Centre (x, y, θ)", symbol="x_c", unit="m, m, rad", low=-20, high=20
    )
    amplitude: Triple = quantity(
        (0.2, 0.2, 0.2), title="Amplitude (x, y, θ)", symbol="A_d", unit="m, m, rad", low=-5, high=5, slider=(0, 0.4)
    )
    frequency: Triple = quantity(
        (1.0, 1.0, 1.0), title="Frequency", symbol="f_d", unit="Hz", low=0, high=50, slider=(0.1, 3)
    )
    phase: Triple = quantity((0.0, 0.0, 0.0), title="Phase", symbol="φ_d", unit="rad", low=-100, high=100)


class PayloadModel(Part):
    """What the controller believes of the payload: factors on the true values."""

    bending_stiffness_factor: Number = quantity(1.0, title="Believed EI / true EI", unit="1", low=1e-3, high=1e3)
    linear_density_factor: Number = quantity(1.0, title="Believed ρ / true ρ", unit="1", low=1e-3, high=1e3)
    length_factor: Number = quantity(1.0, title="Believed L / true L", unit="1", low=1e-1, high=10)


class SensorNoise(Part):
    """White Gaussian noise on what a sampled controller measures; the same seed gives the same run."""

    pose: Triple = quantity((0.0, 0.0, 0.0), title="Pose noise", symbol="σ_x", unit="m, m, rad", low=0, high=1)
    pose_rate: Triple = quantity(
        (0.0, 0.0, 0.0), title="Pose rate noise", symbol="σ_v", unit="m/s, m/s, rad/s", low=0, high=10
    )
    strain: Number = quantity(0.0, title="Strain rate noise", symbol="σ_ε", unit="1/s", low=0, high=1)
    seed: Count = quantity(0, title="Seed", low=0, high=2**31 - 1)

    @property
    def active(self) -> bool:
        """Whether any noise is asked for."""
        return any(self.pose) or any(self.pose_rate) or self.strain > 0


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
        unit="1",
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


class Initial(Part):
    """Where a run starts. null: on the trajectory (pose, pose rate) or undeformed (beam)."""

    pose: Triple | None = quantity(
        None, title="Start pose", symbol="x(0)", unit="m, m, rad", low=-20, high=20, live="restart"
    )
    pose_rate: Triple | None = quantity(
        (0.0, 0.0, 0.0),
        title="Start pose rate",
        symbol="ẋ(0)",
        unit="m/s, m/s, rad/s",
        low=-100,
        high=100,
        live="restart",
    )
    beam_coordinates: Numbers | None = quantity(
        None, title="Start beam coordinates", symbol="q(0)", unit="m, rad", low=-10, high=10, live="restart"
    )


class Simulation(Part):
    """How the equations are integrated."""

    step: Number | None = quantity(
        None, title="Longest step (null: chosen)", symbol="Δt", unit="s", low=SMALLEST_STEP, high=0.1
    )
    integrator: Literal["auto", "rk4", "etdrk4", "generalized-alpha"] = quantity("auto", title="Integrator")
    accuracy: Number = quantity(
        1e-10, title="Pose accuracy that an automatic step aims at", unit="m", low=1e-14, high=1e-4, logarithmic=True
    )


class Scenario(Part):
    """One experiment, complete. `right_arm` null and boundary clamped-free: one arm holds one end of the beam."""

    title: str = Field("", max_length=120)
    watch: str = Field("", max_length=1200)
    payload: Payload = Payload()
    left_arm: Arm = Arm(base=(-0.5, 0.0), elbow=-1)
    right_arm: Arm | None = Arm(base=(0.5, 0.0), elbow=1)
    trajectory: SineTrajectory = SineTrajectory()
    controller: Law = AdaptiveSlidingMode()
    initial: Initial = Initial()
    gravity: Number = quantity(0.0, title="Gravity along -y", symbol="g", unit="m/s²", low=-50, high=50, slider=(0, 20))
    simulation: Simulation = Simulation()

    @property
    def arms(self) -> tuple[Arm, ...]:
        """The arms that are there: left, right."""
        return (self.left_arm,) if self.right_arm is None else (self.left_arm, self.right_arm)

    @model_validator(mode="after")
    def _fits_together(self) -> "Scenario":
        if (self.payload.boundary == "clamped-free") != (self.right_arm is None):
            raise PydanticCustomError(
                "arms",
                "a clamped-free beam is held by one arm and every other boundary by two: "
                "set right_arm to null together with payload.boundary clamped-free",
            )
        given, needed = self.initial.beam_coordinates, self.payload.coordinate_count
        if given is not None and len(given) != needed:
            raise PydanticCustomError(
                "mesh",
                "initial.beam_coordinates has {given} values, but {n} {boundary} elements have {needed} coordinates: "
                "give {needed} values, or null for an undeformed beam",
                {
                    "given": len(given),
                    "needed": needed,
                    "n": self.payload.element_count,
                    "boundary": self.payload.boundary,
                },
            )
        return self

    def replace(self, changes: Mapping[str, Any]) -> "Scenario":
        """A copy with fields changed by dotted path; raises `ScenarioError` and changes nothing if it is not valid.

        A changed `kind` (damping, controller) drops the fields that the new kind does not have.
        """
        data = self.model_dump()
        for path, value in changes.items():
            _set(data, path, value)
        return parse_scenario(data)

    def get(self, path: str) -> Any:
        """The value at a dotted path; raises `ScenarioError` for an unknown one."""
        value: Any = self
        for name in path.split("."):
            if not isinstance(value, BaseModel) or name not in type(value).model_fields:
                raise ScenarioError([(path, f"{path} is not a scenario field: check the name.")])
            value = getattr(value, name)
        return value

    def about(self, path: str) -> Quantity:
        """Title, symbol, unit and range of the field at a dotted path."""
        *parents, name = path.split(".")
        owner = self.get(".".join(parents)) if parents else self
        return describe(type(owner), name)


def parse_scenario(data: Any) -> Scenario:
    """A `Scenario` from plain data (a dict as read from JSON); raises `ScenarioError`, one sentence per problem."""
    if not isinstance(data, Mapping):
        raise ScenarioError([("", f"A scenario is a JSON object with named fields, not {type(data).__name__}.")])
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise ScenarioError([_problem(item) for item in error.errors(include_url=False)]) from None


def _set(data: dict[str, Any], path: str, value: Any) -> None:
    *parents, name = path.split(".")
    for parent in parents:
        inner = data.get(parent)
        if not isinstance(inner, dict):
            raise ScenarioError([(path, f"{path} is not a scenario field here: check the name.")])
        data = inner
    if name == "kind" and data.get("kind") != value:
        common = set(Controller.model_fields) if "model" in data else set()
        for field in [key for key in data if key not in common]:
            del data[field]
    data[name] = value


_TAGS = {
    "nodal",
    "stiffness",
    "modal",
    "adaptive-sliding-mode",
    "computed-torque",
    "pd",
    "none",
    "sine",
    "vibration-damping",
}


def _problem(item: Any) -> tuple[str, str]:
    """(path, sentence) for one pydantic error."""
    names = [str(part) for part in item["loc"] if str(part) not in _TAGS]
    path = ".".join(names)
    about = _find(names)
    unit = about.unit_text() if about else ""
    shown = _shown(item["input"])
    kind, text = item["type"], item["msg"]
    if kind == "extra_forbidden":
        return path, f"{path} is not a scenario field: check the spelling or remove it."
    if kind == "missing":
        return path, f"{path} is missing: give it a value."
    if kind == "range":
        return path, f"{path} = {shown}{unit} {text}: choose a value within it."
    if kind in ("number", "numbers"):
        allowed = f" (allowed: {about.range_text()})" if about and math.isfinite(about.low) else ""
        return path, f"{path} = {shown} {text}{allowed}."
    if kind == "literal_error":
        return path, f"{path} = {shown} is not one of {item['ctx']['expected']}: choose one of them."
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return (
            path,
            f"{path}.kind is not one of {item['ctx'].get('expected_tags', 'the known kinds')}: choose one of them.",
        )
    if kind in ("mesh", "arms", "inertia", "sampling"):
        return path, f"{path + ': ' if path else ''}{text}."
    return path, f"{path} = {shown}: {text}."


def _shown(value: Any) -> str:
    text = f"{value:g}" if isinstance(value, float) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _find(names: list[str]) -> Quantity | None:
    """The description of a field by path in the default scenario, if it has one."""
    kinds: tuple[type[Part], ...] = (NodalDamping, StiffnessDamping, ModalDamping)
    laws: tuple[type[Part], ...] = (VibrationDamping, ComputedTorque, ProportionalDerivative, NoControl)
    owners: dict[str, tuple[type[Part], ...]] = {
        "": (Scenario,),
        "payload": (Payload,),
        "payload.damping": kinds,
        "left_arm": (Arm,),
        "right_arm": (Arm,),
        "trajectory": (SineTrajectory,),
        "controller": laws,
        "controller.model": (PayloadModel,),
        "controller.sensor_noise": (SensorNoise,),
        "initial": (Initial,),
        "simulation": (Simulation,),
    }
    for owner in owners.get(".".join(names[:-1]), ()):
        if names and names[-1] in owner.model_fields:
            return describe(owner, names[-1])
    return None
