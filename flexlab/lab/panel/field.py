"""Scenario fields as controls on the screen, built from their metadata.

A number has a slider, a field without one has boxes, and one of a few words (law, damping, boundary, integrator) is a menu.
"""

import math
import time
from collections.abc import Callable
from typing import Any

import viser

from flexlab.control.law import laws
from flexlab.errors import FlexlabError, LabError
from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.panel.number_control import (
    BOX_DIGITS,
    READING_TIME,
    SETTLE_TIME,
    NumberControl,
    Scale,
    check_range,
    put,
)
from flexlab.physics.axial_load import buckling_load
from flexlab.scenario import Scenario
from flexlab.scenario.choices import TITLES, in_words, options, word_of
from flexlab.scenario.field_text import short_title
from flexlab.scenario.settings import PERIOD, USUAL_PERIOD, with_period_if_needed
from flexlab.text import escaped, number_text

LIVE_HINTS = {
    "continuous": "Acts at once.",
    "projected": "Reshapes the beam's mesh; its shape is carried over.",
    "restart": "Starts a new run.",
}


SQUEEZE = "controller.wanted_internal_force"


def special_values(path: str, scenario: Scenario) -> tuple[tuple[float, str], ...]:
    """Values of the field at `path` that mean something in this scenario, with what to call them."""
    if path != SQUEEZE or len(scenario.arms) < 2:
        return ()
    beam = scenario.payload
    return ((buckling_load(beam.length, beam.bending_stiffness, beam.boundary), "P_cr"),)


class Field:
    """One number at `path` of the scenario: `component` of it if the field is a list, or all components at once (None).

    Lives in the GUI container that is open while it is made. `name` is the label without unit.
    """

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, path: str, component: int | None, name: str, unit: str):
        self._lab_state, self._path, self._component, self._name = lab_state, path, component, name
        about = lab_state.intended.about(path)
        whole = isinstance(lab_state.intended.get(path), int)
        space = f" {unit}" if unit else ""
        hint = f"Allowed: {number_text(about.low)} to {number_text(about.high)}{space}. {LIVE_HINTS[about.live]}"
        value = self._read(lab_state.intended)
        self._control = NumberControl(
            gui, lab_state, name, unit, Scale(about, whole), hint, value, self._ask, self._usual
        )
        self._control.mark(special_values(path, lab_state.intended))

    def settle(self, scenario: Scenario) -> None:
        """Show the scenario's value, unless a person is at this field."""
        self._control.settle(self._read(scenario))
        self._control.mark(special_values(self._path, scenario))

    def show(self, scenario: Scenario) -> None:
        """Show the scenario's value at once: after a reset, a preset, an undo."""
        self._control.show(self._read(scenario))
        self._control.mark(special_values(self._path, scenario))

    def remove(self) -> None:
        """Take the field off the screen."""
        self._control.remove()

    def _ask(self, value: float) -> None:
        try:
            self._lab_state.change({self._path: self._whole(value)})
        except FlexlabError as error:
            raise LabError(_by_label(error, self._path, self._name)) from error

    def _usual(self) -> float:
        """The preset's value; where the preset has no such field (another control law), the present one."""
        baseline = self._lab_state.baseline
        return self._read(baseline if baseline.has(self._path) else self._lab_state.intended)

    def _read(self, scenario: Scenario) -> float:
        value = scenario.get(self._path)
        return float(value[self._component or 0] if isinstance(value, tuple) else value)

    def _whole(self, value: float) -> Any:
        """The field's whole value with this number in it: commands carry whole values."""
        present = self._lab_state.intended.get(self._path)
        if not isinstance(present, tuple):
            return value
        return tuple(value if self._component in (None, index) else item for index, item in enumerate(present))


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
    "grips.model": "Whether the grips give way. Acts at once, as a new run.",
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


FINEST_DIGITS = 14
"""Decimals of a box whose range begins below those of an ordinary one."""

Numbers = float | tuple[float, ...] | None


class NumericField:
    """The field at `path`, in the GUI container that is open while it is made.

    `switch`: label of the switch that gives the field a value, and the value it then has; None: it always has one.
    `components`: how many boxes show a field that is one number for all or one for each.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        lab_state: LabState,
        path: str,
        switch: tuple[str, Callable[[Scenario], Any]] | None = None,
        components: int = 1,
    ):
        self._lab_state, self._path, self._given, self._components = lab_state, path, switch, components
        scenario = lab_state.intended
        self._touched, self._kept = -math.inf, self._read(scenario)
        about = scenario.about(path)
        value, fallback = self._read(scenario), switch[1](scenario) if switch else None
        shown = fallback if value is None else value
        hint = f"Allowed: {about.range_text()}. {LIVE_HINTS[about.live]}"
        unit = f" ({about.unit})" if about.unit not in ("", "1") else ""
        self._about, self._name = about, f"{short_title(about)} {about.symbol}".strip()
        label = self._name + unit
        if switch is not None:
            self._switch = gui.add_checkbox(switch[0], value is not None, hint=LIVE_HINTS[about.live])
            self._switch.on_update(handler(lab_state, lambda _: self._turn(bool(self._switch.value))))
        self._box = _box(gui, label, shown, hint)
        self._box.precision = BOX_DIGITS if about.low >= 10.0**-BOX_DIGITS or about.low <= 0 else FINEST_DIGITS
        self._box.visible = value is not None
        self._back = gui.add_button(
            "↺", color="gray", visible=False, hint=f"{short_title(about)}: back to its usual value"
        )
        self._problem = gui.add_html("", visible=False)
        self._box.on_update(handler(lab_state, lambda _: self._ask(self._box.value)))
        self._back.on_click(handler(lab_state, lambda _: self._go_back()))
        self._show(scenario)

    def settle(self, scenario: Scenario) -> None:
        """Show the scenario's value, unless a person is at this field."""
        if time.monotonic() - self._touched > SETTLE_TIME:
            self._show(scenario)
            if time.monotonic() - self._touched > READING_TIME:
                self._complain("")

    def show(self, scenario: Scenario) -> None:
        """Show the scenario's value at once: after a reset, a preset, an undo. A sentence stays while what it says is true."""
        if self._read(scenario) != self._kept:
            self._complain("")
        self._show(scenario)

    def remove(self) -> None:
        """Take the field off the screen."""
        for widget in (*([self._switch] if self._given else []), self._box, self._back, self._problem):
            widget.remove()

    def _read(self, scenario: Scenario) -> Numbers:
        value = scenario.get(self._path)
        return (value,) * self._components if self._components > 1 and not isinstance(value, tuple) else value

    def _usual(self) -> Numbers:
        """The preset's value; where the preset has no such field (another control law), the present one."""
        baseline = self._lab_state.baseline
        return self._read(baseline if baseline.has(self._path) else self._lab_state.intended)

    def _show(self, scenario: Scenario) -> None:
        value = self._read(scenario)
        if self._given and self._switch.value != (value is not None):
            self._switch.value = value is not None
        put(self._box, visible=value is not None)
        if value is not None:
            put(self._box, value=value)
        put(self._back, visible=value != self._usual())

    def _turn(self, on: bool) -> None:
        if self._given:
            self._ask(self._given[1](self._lab_state.intended) if on else None)
            # A refused switch shows the truth at once: there is nothing to go on typing at.
            self._show(self._lab_state.intended)

    def _go_back(self) -> None:
        self._ask(self._usual())
        self._touched = -math.inf
        self._show(self._lab_state.intended)

    def _ask(self, value: Numbers) -> None:
        """Ask for a value; if it is refused, say why below and leave what was typed to be mended."""
        self._touched = time.monotonic()
        # One number for all keeps its slider simple.
        same = isinstance(value, tuple) and self._components > 1 and len(set(value)) == 1
        try:
            self._check(value)
            self._lab_state.change({self._path: value[0] if same and isinstance(value, tuple) else value})
        except FlexlabError as error:
            self._kept = self._read(self._lab_state.intended)
            self._complain(f"{_by_label(error, self._path, self._name)} It stays at {_text(self._kept)}.")
            return
        put(self._box, visible=value is not None)
        put(self._back, visible=value != self._usual())
        self._complain("")

    def _check(self, value: Numbers) -> None:
        """Raises `LabError` for a number outside its range."""
        items = value if isinstance(value, tuple) else () if value is None else (value,)
        for place, item in enumerate(items, 1):
            check_range(
                self._about,
                f"{self._name}, {place} of {len(items)}" if items[1:] else self._name,
                self._about.unit,
                item,
            )

    def _complain(self, text: str) -> None:
        box = f'<div class="fl"><div class="fl-box fl-error">{escaped(text)}</div></div>' if text else ""
        put(self._problem, content=box, visible=bool(text))


def _by_label(error: FlexlabError, path: str, name: str) -> str:
    """What an error says of the field at `path`, which a person knows by its label."""
    return str(error).replace(f"{path} = ", f"{name} = ", 1)


def _box(gui: viser.GuiApi, label: str, value: Any, hint: str) -> Any:
    """A box for each number of a value."""
    if not isinstance(value, tuple):
        # As a float: where it holds a whole number, viser would cut every other down to one and say nothing.
        return gui.add_number(label, float(value), step=1.0 if isinstance(value, int) else None, hint=hint)
    return gui.add_vector2(label, value, hint=hint) if len(value) == 2 else gui.add_vector3(label, value, hint=hint)


def _text(value: Numbers) -> str:
    if value is None:
        return "none"
    return ", ".join(number_text(item, 6) for item in value) if isinstance(value, tuple) else number_text(value, 6)
