"""A menu for a scenario field that is one of a few words: control law, kind of damping, boundary, integrator."""

from typing import Any

import viser

from flexlab.control.law import laws
from flexlab.errors import LabError
from flexlab.lab.lab_state import LabState, handler
from flexlab.scenario import Scenario
from flexlab.scenario.choices import TITLES, in_words, options, word_of
from flexlab.scenario.settings import PERIOD, USUAL_PERIOD, with_period_if_needed

HINTS = {
    "controller.kind": "Keeps the motion; fields that the new law lacks are dropped.",
    "trajectory.kind": "Goes on from where the target is; fields that the new path lacks are dropped.",
    "trajectory.shaper": "Acts at once.",
    "controller.slow.kind": "Any law. Keeps the motion.",
    "controller.observer.kind": "Rates of the beam: measured, or estimated from strain gauges by a sampled law.",
    "payload.damping.kind": "Acts at once.",
    "payload.boundary": "Reshapes the beam's mesh; its shape is carried over.",
    "payload.axial_load": "Whether the beam feels the force along it. Acts at once.",
    "controller.model.axial_load": "Whether the observer reckons with the steady force along the beam.",
    "simulation.integrator": "Acts at once.",
    "left_arm.elbow": "Sign of joint 2. Starts a new run.",
    "right_arm.elbow": "Sign of joint 2. Starts a new run.",
}
"""Path → what a change does."""


def changes_for(path: str, value: Any) -> dict[str, Any]:
    """The changes that choose `value` for the field at `path`."""
    return laws()[value].chosen() if path == "controller.kind" else {path: value}


class Choice:
    """One menu, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, path: str):
        self._lab_state, self._path = lab_state, path
        self._options = self._offered()
        initial = in_words(word_of(lab_state.intended.get(path)))
        self._menu = gui.add_dropdown(TITLES[path], tuple(self._options), initial_value=initial, hint=HINTS[path])
        self._menu.on_update(handler(lab_state, lambda _: self._ask(self._menu.value)))

    def show(self, scenario: Scenario) -> None:
        """Show the scenario's value, among the options that there are now: a file may bring another one."""
        self._options = self._offered()
        if tuple(self._options) != tuple(self._menu.options):
            self._menu.options = tuple(self._options)
        value = in_words(word_of(scenario.get(self._path)))
        if self._menu.value != value:
            self._menu.value = value

    def _offered(self) -> dict[str, Any]:
        return {in_words(word): value for word, value in options(self._path).items()}

    def remove(self) -> None:
        """Take the menu off the screen."""
        self._menu.remove()

    def _ask(self, value: str) -> None:
        if value not in self._options:
            raise LabError(f"{value[:40]!r} is not an option of {TITLES[self._path]}: choose one from the menu.")
        wanted = changes_for(self._path, self._options[value])
        clocked = with_period_if_needed(self._lab_state.intended, wanted)
        try:
            self._lab_state.change(clocked)
            if clocked != wanted:
                self._lab_state.say(
                    f"{self._options[value]} acts at control instants: {PERIOD} was set to {USUAL_PERIOD:g} s."
                )
        finally:
            # A refused word is not something to go on typing at: the menu shows the truth at once.
            self.show(self._lab_state.intended)
