"""The scenario's fields that are one of a few words, with what each may be: control law, path, kind of damping, boundary."""

from typing import Any, Literal, get_args, get_origin

from flexlab.quantities import Part, parts_of
from flexlab.scenario.scenario import Scenario

TITLES = {
    "controller.kind": "Control law",
    "trajectory.kind": "Path",
    "trajectory.shaper": "Input shaper",
    "controller.slow.kind": "Slow part",
    "controller.observer.kind": "Observer",
    "payload.damping.kind": "Damping kind",
    "payload.boundary": "Boundary",
    "payload.axial_load": "Force along the beam",
    "controller.model.axial_load": "Believed force along the beam",
    "simulation.integrator": "Integrator",
    "left_arm.elbow": "Elbow side, left",
    "right_arm.elbow": "Elbow side, right",
    "grips.model": "How the grips hold the beam",
    "grips.measured_at": "Where the controller measures the pose",
}
"""Path → what the field is called."""


WORDS = {
    "zv": "ZV shaper",
    "zvd": "ZVD shaper",
    "ei-shaper": "EI shaper",
    "lqr": "Linear-quadratic regulator",
    "pd": "PD",
    "joint-pd": "PD of the joints",
    "rk4": "Runge-Kutta, 4th order",
    "etdrk4": "Exponential, 4th order",
    "kalman": "Kalman filter",
}
"""Word of a menu → what it stands for, where the word alone does not say it."""


def in_words(word: str) -> str:
    """How a menu shows a word: what it stands for with the name in code beside it, "ZVD shaper · zvd"; a plain word as it is."""
    return f"{WORDS[word]} · {word}" if word in WORDS else word


def options(path: str) -> dict[str, Any]:
    """The words that the field at `path` allows, and what they stand for."""
    *parents, name = path.split(".")
    owners: list[type[Part]] = [Scenario]
    for parent in parents if name != "kind" else parents[:-1]:
        owners = [part for owner in owners if parent in owner.model_fields for part in _parts(owner, parent)]
    owner = next(owner for owner in owners if (parents[-1] if name == "kind" else name) in owner.model_fields)
    if name == "kind":
        kinds = _parts(owner, parents[-1])
        return {kind.model_fields["kind"].default: kind.model_fields["kind"].default for kind in kinds}
    annotation = owner.model_fields[name].annotation
    allowed = get_args(annotation) if get_origin(annotation) is Literal else ()
    return {word_of(value): value for value in allowed}


def _parts(owner: type[Part], name: str) -> list[type[Part]]:
    return parts_of(owner.model_fields[name].annotation)


def word_of(value: Any) -> str:
    """What a menu says for a value."""
    return f"{value:+d}".replace("-", "−") if isinstance(value, int) else str(value)
