"""Hands on the machine: a spring that pulls at a point of the beam or of a link, and a tap on the beam."""

from typing import Any

import numpy as np

from flexlab.errors import ScenarioError
from flexlab.numerics.elementary import sin_cos
from flexlab.numerics.linear_algebra import product
from flexlab.physics.axial_load import HAND, in_axial_modes, part_beyond
from flexlab.physics.dynamics import velocities_at
from flexlab.physics.plant import AXIAL, ETA, NO_HAND, ON_BEAM, PULL, Hand, P, Plant, Workspace, forget_rates
from flexlab.scenario import Payload, Scenario
from flexlab.sim.build import Beam, payload_row
from flexlab.sim.commands import Pull, Tap
from flexlab.text import number_text, range_text

MAX_PULL_STIFFNESS = 1e5
"""Largest stiffness of a pull, N/m: a stiffer one would overpower the controller and need shorter steps."""
MAX_DISTANCE = 100.0
"""Largest coordinate of a target, m: one farther away is a mistake."""
MAX_IMPULSE = 100.0
"""Largest impulse of a tap, N·s: a hammer blow; a larger one only destroys the run."""
LINKS = (1, 2, 3)
"""Numbers of an arm's links, from its base."""


def _refuse(name: str, value: Any, unit: str, low: float, high: float) -> None:
    """Raise `ScenarioError` unless value lies in low..high."""
    limits = f"{range_text(low, high)} {unit}"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ScenarioError([(name, f"{name} = {value!r:.60} is not a number: give one from {limits}.")])
    if not low <= value <= high:
        shown = number_text(value) if isinstance(value, float) else f"{value!r:.30}"
        raise ScenarioError([(name, f"{name} = {shown} {unit} is outside {limits}: choose a value within it.")])


def _axes(name: str, pair: Any) -> list[tuple[str, Any]]:
    """Return (axis, number) for each of two numbers. Raises `ScenarioError` for anything else."""
    if not isinstance(pair, tuple) or len(pair) != 2:
        raise ScenarioError([(name, f"{name} = {pair!r:.60} is not usable: give two numbers, (x, y).")])
    return list(zip("xy", pair, strict=True))


def _check_point(payload: Payload, s: float) -> None:
    _refuse("beam position", s, "m", -payload.length / 2, payload.length / 2)


def _check_link(scenario: Scenario, link: tuple[int, int], position: float) -> None:
    links = [(arm + 1, number) for arm in range(len(scenario.arms)) for number in LINKS]
    whole = isinstance(link, tuple) and all(type(number) is int for number in link)
    if not whole or link not in links:
        allowed = f"choose arm 1 to {len(scenario.arms)} and link 1 to {LINKS[-1]}"
        raise ScenarioError(
            [("pulled link", f"pulled link = {link!r:.60} is not (arm, link) of this machine: {allowed}.")]
        )
    arm, number = link
    _refuse("position on the link", position, "m", 0, scenario.arms[arm - 1].link_length[number - 1])


def apply_pull(plant: Plant, scenario: Scenario, beam: Beam, command: Pull) -> None:
    """Attach, move or release (stiffness 0) the spring. Raises `ScenarioError` for values outside their range."""
    if command.link is None:
        _check_point(scenario.payload, command.position)
    else:
        _check_link(scenario, command.link, command.position)
    _refuse("pull stiffness", command.stiffness, "N/m", 0, MAX_PULL_STIFFNESS)
    for axis, value in _axes("pull target", command.target):
        _refuse(f"pull target {axis}", value, "m", -MAX_DISTANCE, MAX_DISTANCE)
    held = (ON_BEAM, 0.0) if command.link is None else (command.link[0] - 1, command.link[1] - 1)
    plant.pull[:] = Hand(command.position, *command.target, command.stiffness, *held)
    set_pull_row(plant, scenario.payload, beam)


def without_hand(plant: Plant) -> Plant:
    """The plant without a hand, and with its own copies of the arrays that a hand changes."""
    modal = plant.modal.copy()
    modal[PULL] = 0.0
    return plant._replace(
        modal=modal, pull=np.array(NO_HAND), axial=None if plant.axial is None else plant.axial.copy()
    )


def set_pull_row(plant: Plant, payload: Payload, beam: Beam) -> None:
    """Set the modes' shapes at the pulled point of `plant.pull`; zero if no hand holds the beam."""
    hand = Hand(*plant.pull)
    plant.modal[PULL] = product(payload_row(payload, hand.position), beam.modes.V) if hand.arm == ON_BEAM else 0.0
    if plant.axial is not None and payload.axial_load != "none" and hand.arm == ON_BEAM and hand.stiffness > 0:
        plant.axial[HAND] = beyond(payload, beam, hand.position)


def beyond(payload: Payload, beam: Beam, s: float) -> np.ndarray:
    """VᵀG_F V for a hand at s, m, as in `Plant.axial`."""
    whole = part_beyond(payload.length, payload.element_count, payload.boundary, s)
    return in_axial_modes(whole, beam.modes.omega, beam.modes.V)


def apply_tap(payload: Payload, beam: Beam, y: np.ndarray, command: Tap, factor: float = 1.0) -> None:
    """Add an impulse to the momenta of state y, in place: (P, s π) += (∂R/∂p)ᵀ impulse. Raises `ScenarioError`.

    `factor`: s of `mass_change`, 1.
    """
    _check_point(payload, command.beam_position)
    for axis, value in _axes("tap", command.impulse):
        _refuse(f"tap {axis}", value, "N·s", -MAX_IMPULSE, MAX_IMPULSE)
    n = len(beam.modes.omega)
    shape = product(payload_row(payload, command.beam_position), beam.modes.V)
    s, c = sin_cos(float(y[2]))
    along = c * command.impulse[0] + s * command.impulse[1]
    across = c * command.impulse[1] - s * command.impulse[0]
    deflection = float(product(shape, y[ETA : ETA + n]))
    y[P : P + 2] += command.impulse
    y[P + 2] += command.beam_position * across - deflection * along
    y[ETA + n : ETA + 2 * n] += shape * across / factor
    forget_rates(y, n)


def apply_axial_impulse(
    plant: Plant,
    payload: Payload,
    beam: Beam,
    before: np.ndarray,
    y: np.ndarray,
    ws: Workspace,
    command: Tap,
    factor: float = 1.0,
) -> None:
    """Apply the axial part of a tap to a beam that feels it: π -= ∫K_G dt η, in place. `before`: the state y before the tap.

    The impulse's own ∫N dt is J_L + ρ Δv₁ (s + L/2) - J₁ [s > s_tap], with Δv₁ the velocity gained by the link's middle along
    e₁ and J_L the impulse on the left arm: none through a compliant grip, J₁ - m Δv₁ for a single arm. `factor`: s of
    `mass_change`, which ws has noted.
    """
    if plant.axial is None or payload.axial_load == "none":
        return
    velocities_at(plant, before, ws)
    gained = -ws.velocity.copy()
    velocities_at(plant, y, ws)
    gained += ws.velocity
    n, (c, s) = len(beam.modes.omega), ws.arm.trig
    along, tapped = c * gained[0] + s * gained[1], c * command.impulse[0] + s * command.impulse[1]
    left = tapped - factor * plant.m * along
    if len(plant.arms) > 1:
        by_arm = [sum(ws.arm.M[0, a, b] * gained[b] for b in range(3)) for a in range(2)]
        left = c * by_arm[0] + s * by_arm[1] if plant.grips is None else 0.0
    G0, G1, _, _ = plant.axial
    impulse = left * G0 + factor * along * G1 - tapped * beyond(payload, beam, command.beam_position)
    feels = plant.modal[AXIAL] > 0
    y[ETA + n : ETA + 2 * n][feels] -= product(impulse, y[ETA : ETA + n][feels]) / factor
