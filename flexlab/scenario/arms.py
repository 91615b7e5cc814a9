"""The arms that carry the beam, and the joints and grips of both."""

from typing import Literal

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from flexlab.quantities import Number, Pair, Part, Triple, quantity


class Arm(Part):
    """One planar three-joint arm with relative joint angles; `elbow` is the sign of joint 2."""

    base: Pair = quantity(..., "Base position", "p_b", "m", low=-20, high=20, live="restart")
    link_mass: Triple = quantity((8.0, 8.0, 4.0), "Link masses", "m", "kg", low=0, high=1e4, live="restart")
    link_length: Triple = quantity((0.7, 0.6, 0.2), "Link lengths", "l", "m", low=1e-3, high=20, live="restart")
    link_center: Triple = quantity(
        (0.4, 0.35, 0.1), "Centres of mass from the joint", "a", "m", low=-20, high=20, live="restart"
    )
    link_inertia: Triple | None = quantity(
        None, "Link inertias about the centre (null: m l²/12)", "I_c", "kg·m²", low=0, high=1e6, live="restart"
    )
    elbow: Literal[-1, 1] = quantity(..., "Elbow side", low=-1, high=1, live="restart")

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


class JointFriction(Part):
    """Friction of the joints, τ_f(θ̇): viscous, Coulomb's, and a static part that falls with speed (`physics.joints`)."""

    viscous: Triple = quantity((0.0, 0.0, 0.0), "Viscous friction of the joints", "B_f", "N·m·s/rad", low=0, high=1e4)
    coulomb: Triple = quantity((0.0, 0.0, 0.0), "Coulomb friction of the joints", "C_f", "N·m", low=0, high=1e4)
    static_factor: Number = quantity(1.0, "Static over Coulomb friction", "σ_f", "1", low=1, high=10)
    stribeck_speed: Number = quantity(
        0.1, "Speed at which static friction has fallen by half", "v_s", "rad/s", low=1e-4, high=100
    )
    smoothing_speed: Number = quantity(
        0.01, "Speed within which friction changes sign", "v_0", "rad/s", low=1e-6, high=1
    )
    """A sticking joint creeps at a fraction of it; a smaller value needs shorter steps."""

    @property
    def active(self) -> bool:
        """Whether there is any friction."""
        return any(self.viscous) or any(self.coulomb)


class JointEncoders(Part):
    """Encoders with which a sampled controller measures the pose: joint angles in whole counts (`physics.sensors`)."""

    counts: Triple = quantity(
        (0.0, 0.0, 0.0), "Counts of the encoders per turn of the joint (0: exact)", "N_c", "1", low=0, high=1e9,
        slider=(0, 1e6),
    )  # fmt: skip
    """For an encoder on the motor's side of a gear, multiply by the gear's ratio.

    The rate is the difference of two readings over the control period T_c, half a period late whatever the counts: a law
    with the gains K and D errs by about (D/K)(T_c/2)ẍ more than one without encoders.
    """

    @property
    def active(self) -> bool:
        """Whether any joint has an encoder."""
        return any(self.counts)


class JointMotor(Part):
    """How a motor gives the torque that it is asked for: with a lag, and less at higher speed (`physics.joints`)."""

    time_constant: Number = quantity(
        0.0, "Time constant of the motors (0: none)", "T_m", "s", low=0, high=1, slider=(0, 0.02)
    )
    stall_torque: Triple = quantity(
        (0.0, 0.0, 0.0), "Stall torque of the motors (0: any torque)", "τ_s", "N·m", low=0, high=1e6, slider=(0, 1000)
    )
    no_load_speed: Triple = quantity(
        (10.0, 10.0, 10.0), "No-load speed of the motors", "ω_0", "rad/s", low=1e-2, high=1e4, slider=(1, 20)
    )

    @property
    def active(self) -> bool:
        """Whether motors may give another torque than they are asked for."""
        return self.time_constant > 0 or any(self.stall_torque)


class Joints(Part):
    """Friction, motors and encoders of the joints, the same for both arms, base first."""

    friction: JointFriction = JointFriction()
    motor: JointMotor = JointMotor()
    encoders: JointEncoders = JointEncoders()

    @property
    def active(self) -> bool:
        """Whether the joints are not ideal."""
        return self.friction.active or self.motor.active or self.encoders.active


GripModel = Literal["rigid", "compliant"]
MeasuredAt = Literal["arms", "payload"]


class Grips(Part):
    """How the arms hold the beam's ends: rigidly, as in the paper, or by a spring and a damper each (`physics.grips`)."""

    model: GripModel = quantity("rigid", "How the grips hold the beam")
    stiffness: Triple = quantity(
        (1e5, 1e5, 1e4), "Stiffness of the grips: along the beam, across, turning", "k_g", "N/m, N/m, N·m/rad", low=1,
        high=1e9, logarithmic=True,
    )  # fmt: skip
    damping: Triple = quantity(
        (100.0, 100.0, 10.0), "Damping of the grips: along the beam, across, turning", "c_g", "N·s/m, N·s/m, N·m·s/rad",
        low=0, high=1e6,
    )  # fmt: skip
    measured_at: MeasuredAt = quantity("arms", "Where the controller measures the pose")
    """By the arms' joint angles (the mean of both, as if grips were rigid) or at the payload. Encoders measure the former."""

    @property
    def active(self) -> bool:
        """Whether the grips are compliant."""
        return self.model == "compliant"
