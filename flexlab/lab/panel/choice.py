"""A menu for a scenario field that is one of a few words: control law, kind of damping, boundary, integrator."""

from typing import Any, Literal, get_args, get_origin

import viser

from flexlab.control.law import laws
from flexlab.errors import LabError
from flexlab.lab.lab_state import LabState, handler
from flexlab.quantities import Part, parts_of
from flexlab.scenario import Scenario
from flexlab.scenario.settings import PERIOD, USUAL_PERIOD, with_period_if_needed

CHOICES = {
    "controller.kind": ("Control law", "Keeps the motion; fields that the new law lacks are dropped."),
    "trajectory.kind": ("Path", "Goes on from where the target is; fields that the new path lacks are dropped."),
    "trajectory.shaper": ("Input shaper", "Acts at once."),
    "controller.slow.kind": ("Slow part", "Any law. Keeps the motion."),
    "controller.observer.kind": (
        "Observer",
        "Rates of the beam: measured, or estimated from strain gauges by a sampled law.",
    ),
    "payload.damping.kind": ("Damping kind", "Acts at once."),
    "payload.boundary": ("Boundary", "Reshapes the beam's mesh; its shape is carried over."),
    "simulation.integrator": ("Integrator", "Acts at once."),
    "left_arm.elbow": ("Elbow side, left", "Sign of joint 2. Starts a new run."),
    "right_arm.elbow": ("Elbow side, right", "Sign of joint 2. Starts a new run."),
}
"""Path → label and hint."""


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
    return {_word(value): value for value in allowed}


def _parts(owner: type[Part], name: str) -> list[type[Part]]:
    return parts_of(owner.model_fields[name].annotation)


def _word(value: Any) -> str:
    return f"{value:+d}".replace("-", "−") if isinstance(value, int) else str(value)


def changes_for(path: str, value: Any) -> dict[str, Any]:
    """The changes that choose `value` for the field at `path`."""
    return laws()[value].chosen() if path == "controller.kind" else {path: value}


class Choice:
    """One menu, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, path: str):
        self._lab_state, self._path = lab_state, path
        label, hint = CHOICES[path]
        self._options = options(path)
        initial = _word(lab_state.intended.get(path))
        self._menu = gui.add_dropdown(label, tuple(self._options), initial_value=initial, hint=hint)
        self._menu.on_update(handler(lab_state, lambda _: self._ask(self._menu.value)))

    def show(self, scenario: Scenario) -> None:
        """Show the scenario's value."""
        value = _word(scenario.get(self._path))
        if self._menu.value != value:
            self._menu.value = value

    def remove(self) -> None:
        """Take the menu off the screen."""
        self._menu.remove()

    def _ask(self, value: str) -> None:
        if value not in self._options:
            raise LabError(f"{value[:40]!r} is not an option of {CHOICES[self._path][0]}: choose one from the menu.")
        wanted = changes_for(self._path, self._options[value])
        clocked = with_period_if_needed(self._lab_state.intended, wanted)
        try:
            self._lab_state.change(clocked)
            if clocked != wanted:
                self._lab_state.say(f"{value} acts at control instants: {PERIOD} was set to {USUAL_PERIOD:g} s.")
        finally:
            # A refused word is not something to go on typing at: the menu shows the truth at once.
            self.show(self._lab_state.intended)
