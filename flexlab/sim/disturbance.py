"""Hands on the beam: a spring that pulls at one of its points, and a tap."""

import numpy as np

from flexlab.errors import ScenarioError
from flexlab.physics.plant import ETA, P, Plant
from flexlab.scenario import Payload
from flexlab.sim.build import Beam, payload_row
from flexlab.sim.commands import Pull, Tap

MAX_PULL_STIFFNESS = 1e5
"""N/m: stiffer pulls would outdo the controller and need shorter steps."""

MAX_DISTANCE = 100.0
"""m: a target farther away is a slip of the hand."""

MAX_IMPULSE = 100.0
"""N·s: a hammer blow; more than that only destroys the run."""


def _refuse(name: str, value: float, unit: str, low: float, high: float) -> None:
    """Raise `ScenarioError` unless value lies in low..high."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ScenarioError([(name, f"{name} = {value!r} is not a number: give one from {low:g} to {high:g} {unit}.")])
    if not low <= value <= high:
        sentence = f"{name} = {value:g} {unit} is outside {low:g} to {high:g} {unit}: choose a value within it."
        raise ScenarioError([(name, sentence)])


def _check_point(payload: Payload, s: float) -> None:
    _refuse("beam position", s, "m", -payload.length / 2, payload.length / 2)


def apply_pull(plant: Plant, payload: Payload, beam: Beam, command: Pull) -> None:
    """Attach, move or release (stiffness 0) the spring. Raises `ScenarioError` for values that make no sense."""
    _check_point(payload, command.beam_position)
    _refuse("pull stiffness", command.stiffness, "N/m", 0, MAX_PULL_STIFFNESS)
    for axis, value in zip("xy", command.target, strict=True):
        _refuse(f"pull target {axis}", value, "m", -MAX_DISTANCE, MAX_DISTANCE)
    plant.pull[:] = (command.beam_position, *command.target, command.stiffness)
    set_pull_row(plant, payload, beam)


def set_pull_row(plant: Plant, payload: Payload, beam: Beam) -> None:
    """Make the modes' shapes at the pulled point match `plant.pull`."""
    plant.modal[-1] = beam.modes.V.T @ payload_row(payload, plant.pull[0])


def apply_tap(payload: Payload, beam: Beam, y: np.ndarray, command: Tap) -> None:
    """Add an impulse to the momenta of state y, in place: (P, π) += (∂R/∂p)ᵀ impulse. Raises `ScenarioError`."""
    _check_point(payload, command.beam_position)
    for axis, value in zip("xy", command.impulse, strict=True):
        _refuse(f"tap {axis}", value, "N·s", -MAX_IMPULSE, MAX_IMPULSE)
    n = len(beam.modes.omega)
    shape = beam.modes.V.T @ payload_row(payload, command.beam_position)
    c, s = np.cos(y[2]), np.sin(y[2])
    along = c * command.impulse[0] + s * command.impulse[1]
    across = c * command.impulse[1] - s * command.impulse[0]
    deflection = float(shape @ y[ETA : ETA + n])
    y[P : P + 2] += command.impulse
    y[P + 2] += command.beam_position * across - deflection * along
    y[ETA + n : ETA + 2 * n] += shape * across
