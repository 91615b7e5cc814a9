"""Scenario fields as controls on the screen, built from their metadata.

A number has a slider, a field without one has boxes, and one of a few words (law, damping, boundary, integrator) is a menu.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import viser

from flexlab.control.law import laws
from flexlab.errors import FlexlabError, LabError
from flexlab.lab.lab_state import LabState
from flexlab.lab.panel.number_control import LIVE_HINTS, NumberControl, Numbers
from flexlab.lab.widgets import handler
from flexlab.physics.axial_load import buckling_load
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import TITLES, in_words, options, word_of
from flexlab.scenario.settings import PERIOD, USUAL_PERIOD, with_period_if_needed
from flexlab.text import number_text

Switch = tuple[str, Callable[[Scenario], Any]]
"""Label of the switch of a field that may be left out, and the value that it begins with."""


SQUEEZE = "controller.wanted_internal_force"


def special_values(path: str, scenario: Scenario) -> tuple[tuple[float, str], ...]:
    """Values of the field at `path` that mean something in this scenario, with what to call them."""
    if path != SQUEEZE or len(scenario.arms) < 2:
        return ()
    beam = scenario.payload
    return ((buckling_load(beam.length, beam.bending_stiffness, beam.boundary), "P_cr"),)


class Entry(NamedTuple):
    """One control of the panel: a menu, a number with a slider, or boxes for all numbers of a field."""

    path: str
    component: int | None = None
    """Place in a list; None: all numbers at once."""
    name: str = ""
    """The label without unit."""
    unit: str = ""
    boxes: int = 0
    """Number of boxes; 0: one with a slider. A field that is one number for all or one for each has three."""
    is_menu: bool = False


class Field:
    """The numbers of an entry, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, entry: Entry, switch: Switch | None = None):
        self._lab_state, self._entry = lab_state, entry
        intended = lab_state.intended
        about, raw = intended.about(entry.path), intended.get(entry.path)
        space = f" {entry.unit}" if entry.unit not in ("", "1") else ""
        hint = f"Allowed: {number_text(about.low)} to {number_text(about.high)}{space}. {LIVE_HINTS[about.live]}"
        self._control = NumberControl(
            gui,
            lab_state,
            about,
            self._read(intended),
            self._ask,
            self._usual,
            hint=hint,
            name=entry.name,
            unit=entry.unit,
            slider=not entry.boxes,
            whole=isinstance(raw, int),
            switch=None if switch is None else (switch[0], lambda: switch[1](lab_state.intended)),
        )
        self._mark(intended)

    def settle(self, scenario: Scenario) -> None:
        """Show the scenario's value, unless a person is at this field."""
        self._control.settle(self._read(scenario))
        self._mark(scenario)

    def show(self, scenario: Scenario) -> None:
        """Show the scenario's value at once: after a reset, a preset, an undo."""
        self._control.show(self._read(scenario))
        self._mark(scenario)

    def remove(self) -> None:
        """Take the field off the screen."""
        self._control.remove()

    def _mark(self, scenario: Scenario) -> None:
        self._control.mark(special_values(self._entry.path, scenario))

    def _ask(self, value: Numbers) -> None:
        path, name = self._entry.path, self._entry.name
        try:
            self._lab_state.change({path: self._whole(value)})
        except FlexlabError as error:
            # A person knows the field by its label.
            raise LabError(str(error).replace(f"{path} = ", f"{name} = ", 1)) from error

    def _usual(self) -> Numbers:
        """The preset's value; where the preset has no such field (another control law), the present one."""
        baseline = self._lab_state.baseline
        return self._read(baseline if baseline.has(self._entry.path) else self._lab_state.intended)

    def _read(self, scenario: Scenario) -> Numbers:
        value, boxes = scenario.get(self._entry.path), self._entry.boxes
        if boxes:
            return (value,) * boxes if boxes > 1 and not isinstance(value, tuple) else value
        return float(value[self._entry.component or 0] if isinstance(value, tuple) else value)

    def _whole(self, value: Numbers) -> Any:
        """The field's whole value with these numbers in it: commands carry whole values."""
        if self._entry.boxes:
            # One number for all keeps its slider simple.
            same = self._entry.boxes > 1 and isinstance(value, tuple) and len(set(value)) == 1
            return value[0] if same and isinstance(value, tuple) else value
        present = self._lab_state.intended.get(self._entry.path)
        if not isinstance(present, tuple):
            return value
        return tuple(value if self._entry.component in (None, index) else item for index, item in enumerate(present))


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
    "grips.model": "Whether the grips give way. Starts a new run.",
    "grips.measured_at": "By the arms' joint angles, or at the payload. Acts at once.",
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

    settle = show

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
