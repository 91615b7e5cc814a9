"""Scenario fields as controls on the screen, built from their metadata.

A number has a slider, a field without one has boxes, and one of a few words (law, damping, boundary, integrator) is a menu.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from flexlab.control.law import laws
from flexlab.errors import FlexlabError, LabError
from flexlab.lab.panel.number_control import LIVE_HINTS, Marks, NumberControl, Numbers
from flexlab.lab.widgets import Menu, Widgets
from flexlab.physics.axial_load import buckling_load
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import TITLES, in_words, options, word_of
from flexlab.scenario.settings import PERIOD, USUAL_PERIOD, with_period_if_needed

Switch = tuple[str, Callable[[Scenario], Any]]
"""Label of the switch of a field that may be left out, and the value that it begins with."""


SQUEEZE = "controller.wanted_internal_force"
HINTS = {
    "controller.kind": "Keeps the motion; fields that the new law lacks are dropped.",
    "trajectory.kind": "Goes on from where the target is; fields that the new path lacks are dropped.",
    "controller.slow.kind": "Any law. Keeps the motion.",
    "controller.observer.kind": "Rates of the beam: measured, or estimated from strain gauges by a sampled law.",
    "payload.axial_load": "Whether the beam feels the force along it. Acts at once.",
    "controller.model.axial_load": "Whether the observer reckons with the steady force along the beam.",
    "grips.model": "Whether the grips give way. Starts a new run.",
    "grips.measured_at": "By the arms' joint angles, or at the payload. Acts at once.",
    "left_arm.elbow": "Sign of joint 2. Starts a new run.",
    "right_arm.elbow": "Sign of joint 2. Starts a new run.",
}
"""Path → what a change does, where `LIVE_HINTS` does not tell."""


def special_values(path: str, scenario: Scenario) -> Marks:
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

    def read(self, scenario: Scenario) -> Numbers:
        """The numbers of this control in a scenario."""
        value = scenario.get(self.path)
        if self.boxes:
            return (value,) * self.boxes if self.boxes > 1 and not isinstance(value, tuple) else value
        return float(value[self.component or 0] if isinstance(value, tuple) else value)

    def whole(self, scenario: Scenario, value: Numbers) -> Any:
        """The field's whole value with these numbers in it: commands carry whole values."""
        if self.boxes:
            # One number for all keeps its slider simple.
            same = self.boxes > 1 and isinstance(value, tuple) and len(set(value)) == 1
            return value[0] if same and isinstance(value, tuple) else value
        present = scenario.get(self.path)
        if not isinstance(present, tuple):
            return value
        return tuple(value if self.component in (None, index) else item for index, item in enumerate(present))


def field(widgets: Widgets, entry: Entry, switch: Switch | None = None) -> NumberControl:
    """The numbers of an entry, in the GUI container that is open while it is made."""
    path, lab_state = entry.path, widgets.lab_state
    intended = lab_state.intended
    about = replace(intended.about(path), title=entry.name, unit=entry.unit)

    def ask(value: Numbers) -> None:
        try:
            lab_state.change({path: entry.whole(lab_state.intended, value)})
        except FlexlabError as error:
            # A person knows the field by its label.
            raise LabError(str(error).replace(f"{path} = ", f"{entry.name} = ", 1)) from error

    def usual() -> Numbers:
        # Where the preset has no such field (another control law), the present value.
        baseline = lab_state.baseline
        return entry.read(baseline if baseline.has(path) else lab_state.intended)

    return NumberControl(
        widgets,
        about,
        lambda: entry.read(lab_state.intended),
        ask,
        usual,
        hint=f"Allowed: {about.range_text()}. {LIVE_HINTS[about.live]}",
        slider=not entry.boxes,
        whole=isinstance(intended.get(path), int),
        switch=None if switch is None else (switch[0], lambda: switch[1](lab_state.intended)),
        marks=lambda: special_values(path, lab_state.intended),
    )


def changes_for(path: str, value: Any) -> dict[str, Any]:
    """The changes that choose `value` for the field at `path`."""
    return laws()[value].chosen() if path == "controller.kind" else {path: value}


def choice(widgets: Widgets, path: str) -> Menu:
    """The menu of the field at `path`, in the GUI container that is open while it is made."""
    lab_state = widgets.lab_state

    def offered() -> dict[str, Any]:
        return {in_words(word): value for word, value in options(path).items()}

    def choose(word: str) -> None:
        value = offered()[word]
        wanted = changes_for(path, value)
        clocked = with_period_if_needed(lab_state.intended, wanted)
        lab_state.change(clocked)
        if clocked != wanted:
            lab_state.say(f"{value} acts at control instants: {PERIOD} was set to {USUAL_PERIOD:g} s.")

    def shown() -> str:
        return in_words(word_of(lab_state.intended.get(path)))

    hint = HINTS.get(path, LIVE_HINTS[lab_state.intended.about(path).live])
    return Menu(widgets, TITLES[path], offered, shown, choose, hint=hint)
