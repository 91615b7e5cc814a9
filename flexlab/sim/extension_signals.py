"""The signals that joints, grips and a changing mass add to the table of `sim.signals`."""

from flexlab.scenario import Scenario
from flexlab.signal import ARM, JOINT, Axis, Signal

FRICTION = tuple(
    Signal(
        f"{side}_joint_friction",
        "τ_f",
        ("N·m",),
        f"friction in the {side} arm's joints; τ less this is what u_i is made of",
        (JOINT,),
        "B θ̇ + [C + (σ - 1) C/(1 + (θ̇/v_s)²)] θ̇/√(θ̇² + v_0²)",
    )
    for side in ARM.labels
)
FRICTION_LOSS = Signal("friction_loss", "∫ Στ_f θ̇ dt", ("J",), "energy that friction in the joints took")
ASKED = tuple(
    Signal(
        f"{side}_asked_torque", "τ_w", ("N·m",), f"what the controller asks of the {side} arm's motors", (JOINT,),
        "T_m τ̇ = clip(τ_w, -τ_s (1 + θ̇/ω_0), τ_s (1 - θ̇/ω_0)) - τ",
    )
    for side in ARM.labels
)  # fmt: skip
JOINT_SIGNALS = (*FRICTION, FRICTION_LOSS, *ASKED)
"""Signals of joints that are not ideal; in rows they follow the law's own."""
MATERIAL_SIGNALS = (
    Signal("payload_mass", "s m", ("kg",), "mass of the payload"),
    Signal(
        "material_energy",
        "∫ ½ṡ vᵀA v + ṡ U dt",
        ("J",),
        "energy that material brought to the payload, less what it took",
    ),
)
"""Signals of a payload whose mass changes; in rows they precede the law's own."""
GRIP = Axis("3", ("along", "across", "turn"))
"""Directions of a compliant grip."""
GIVEN_WAY = tuple(
    Signal(
        f"{side}_grip_displacement", "δ", ("m", "m", "rad"), f"how far the {side} arm's grip stands off the beam's end", (GRIP,),
        "f = k δ + c δ̇",
    )
    for side in ARM.labels
)  # fmt: skip
GRIP_ENERGIES = (
    Signal("grip_energy", "½ Σ k δ²", ("J",), "energy in the springs of the grips, a part of the elastic energy"),
    Signal("grip_loss", "∫ Σ c δ̇² dt", ("J",), "energy that the dampers of the grips took"),
)
GRIP_SIGNALS = (*GIVEN_WAY, *GRIP_ENERGIES)
"""Signals of compliant grips; in rows they precede the law's own."""


def grip_signals(scenario: Scenario) -> tuple[Signal, ...]:
    """The signals that a scenario's grips add to the table; rigid ones add none."""
    return (*GIVEN_WAY[: len(scenario.arms)], *GRIP_ENERGIES) if scenario.grips.active else ()


def joint_signals(scenario: Scenario) -> tuple[Signal, ...]:
    """The signals that a scenario's joints add to the table; ideal ones add none."""
    joints, arms = scenario.joints, len(scenario.arms)
    friction = (*FRICTION[:arms], FRICTION_LOSS) if joints.friction.active else ()
    return (*friction, *(ASKED[:arms] if joints.motor.active else ()))
