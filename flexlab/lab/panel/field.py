"""One number of the scenario as a number box with a slider, both built from the field's metadata."""

import math
import time
from typing import Any

import viser

from flexlab.errors import ScenarioError
from flexlab.lab.desk import Desk, handler
from flexlab.lab.panel.text import escaped, number
from flexlab.quantities import Quantity
from flexlab.scenario import Scenario

SETTLE_TIME = 4.0
"""How long a box keeps what a person typed but the lab did not take, wall seconds; then it shows the true value again."""
SLIDER_STEPS = 200
BOX_DIGITS = 9
"""Decimals that a number box takes."""

LIVE_HINTS = {
    "continuous": "Acts at once.",
    "projected": "Reshapes the beam's mesh; its shape is carried over.",
    "restart": "Starts a new run.",
}


class Scale:
    """The way between a value and its place on the slider: even or logarithmic, in whole numbers or not."""

    def __init__(self, about: Quantity, whole: bool):
        low, high = about.slider or (about.low, about.high)
        self._logarithmic, self._whole = about.logarithmic, whole
        self.low, self.high = self._place(low), self._place(high)
        self.step = 1.0 if whole else (self.high - self.low) / SLIDER_STEPS
        self.marks = ((self.low, f"{low:g}"), (self.high, f"{high:g}"))

    def place(self, value: float) -> float:
        """Where a value stands on the slider, at its end if outside."""
        if self._logarithmic and value <= 0:
            return self.low
        return min(max(self._place(value), self.low), self.high)

    def value(self, place: float) -> float:
        """The value at a place, with four significant digits. A place that is no number gives NaN."""
        if not math.isfinite(place) or abs(place) > 1e300:
            return math.nan
        value = 10.0 ** min(place, 300.0) if self._logarithmic else place
        return float(round(value)) if self._whole else float(f"{value:.4g}")

    def _place(self, value: float) -> float:
        return math.log10(value) if self._logarithmic else value


class Field:
    """One number at `path` of the scenario, `component` of it if the field is a list, or all components at once.

    Lives in the GUI container that is open while it is made. `name` is the label without unit.
    """

    def __init__(self, gui: viser.GuiApi, desk: Desk, path: str, component: int | None, name: str, unit: str):
        self._desk, self._path, self._component = desk, path, component
        about = desk.intended.about(path)
        self._scale = Scale(about, isinstance(desk.intended.get(path), int))
        self._touched = 0.0
        self.value = self._read(desk.intended)
        hint = f"Allowed: {number(about.low)} to {number(about.high)}{' ' + unit if unit else ''}. {LIVE_HINTS[about.live]}"
        label = f"{name} ({unit})" if unit else name
        self._box = gui.add_number(label, self.value, step=self._box_step(), hint=hint)
        self._box.precision = BOX_DIGITS
        self._slider = gui.add_slider(
            f"{name}, slider",
            self._scale.low,
            self._scale.high,
            self._scale.step,
            self._scale.place(self.value),
            marks=self._scale.marks,
            hint=hint,
        )
        self._problem = gui.add_html("", visible=False)
        self._box.on_update(handler(desk, lambda _: self._type(self._box.value)))
        self._slider.on_update(handler(desk, lambda _: self._slide(self._slider.value)))

    def settle(self, scenario: Scenario) -> None:
        """Show the scenario's value, unless a person is at this field."""
        self.value = self._read(scenario)
        if time.monotonic() - self._touched > SETTLE_TIME:
            self.show(scenario)

    def show(self, scenario: Scenario) -> None:
        """Show the scenario's value at once: after a reset, a preset, an undo."""
        self.value = self._read(scenario)
        if self._box.value != self.value:
            self._box.value = self.value
        place = self._scale.place(self.value)
        if not math.isclose(self._slider.value, place, abs_tol=self._scale.step):
            self._slider.value = place
        self._complain("")

    def remove(self) -> None:
        """Take the field off the screen."""
        for widget in (self._box, self._slider, self._problem):
            widget.remove()

    def _slide(self, place: float) -> None:
        if self._ask(self._scale.value(place)):
            self._box.value = self.value

    def _type(self, value: float) -> None:
        if self._ask(value):
            self._slider.value = self._scale.place(self.value)

    def _ask(self, value: float) -> bool:
        """Ask for a value; if it is refused, say why under the field and leave what was typed to be mended."""
        self._touched = time.monotonic()
        try:
            self._desk.change({self._path: self._whole(value)})
        except ScenarioError as error:
            self._complain(f"{error} It stays at {number(self.value, 6)}.")
            return False
        self.value = value
        self._complain("")
        return True

    def _complain(self, text: str) -> None:
        self._problem.content = (
            f'<div class="fl"><div class="fl-box fl-error">{escaped(text)}</div></div>' if text else ""
        )
        self._problem.visible = bool(text)

    def _read(self, scenario: Scenario) -> float:
        value = scenario.get(self._path)
        if isinstance(value, tuple):
            value = value[self._component or 0]
        return float(value)

    def _whole(self, value: float) -> Any:
        """The field's whole value with this number in it: commands carry whole values."""
        present = self._desk.intended.get(self._path)
        if not isinstance(present, tuple):
            return value
        return tuple(value if self._component in (None, index) else item for index, item in enumerate(present))

    def _box_step(self) -> float:
        """What an arrow key adds: about a hundredth of the slider, 1 for whole numbers."""
        span = self._scale.value(self._scale.high) - self._scale.value(self._scale.low)
        return 10.0 ** math.floor(math.log10(span / 100)) if span < 100 else 1.0
