"""A number on the screen: a box that takes any value and a slider below it, kept together."""

import math
import time
from collections.abc import Callable
from typing import Any

import viser

from flexlab.errors import FlexlabError, LabError
from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.viser_internals import mark_slider
from flexlab.quantities import Quantity
from flexlab.text import escaped, number_text

SETTLE_TIME = 4.0
"""How long a box keeps what a person typed but the lab did not take, wall seconds; then it shows the true value again."""
READING_TIME = 30.0
"""How long the sentence about a value that was refused stays, wall seconds: it outlives the value itself."""
SLIDER_STEPS = 200
CROWDED = 0.12
"""Share of a slider within which the labels of two marks would overlap."""
BOX_DIGITS = 12
"""Decimals that a number box takes."""


def put(widget: Any, **values: Any) -> None:
    """Write what has changed: viser takes 20 µs for every write, even of the value that is there."""
    for name, value in values.items():
        if getattr(widget, name) != value:
            setattr(widget, name, value)


def check_range(about: Quantity, name: str, unit: str, value: float) -> None:
    """Refuse a number outside the range of `about`, by the name and unit that its label has: raises `LabError`."""
    if not about.low <= value <= about.high:
        space = f" {unit}" if unit not in ("", "1") else ""
        raise LabError(
            f"{name} = {number_text(value, 6)}{space} is outside the allowed range {number_text(about.low)} to "
            f"{number_text(about.high)}{space}: choose a value within it."
        )


class Scale:
    """The way between a value and its place on the slider: even or, from above 0 on, logarithmic; in whole numbers or not."""

    def __init__(self, about: Quantity, whole: bool = False):
        self.about = about
        low, high = about.slider or (about.low, about.high)
        # A person's own law may ask for ratios from 0 on, where there are none.
        self._logarithmic, self._whole = about.logarithmic and low > 0, whole
        self.low, self.high = self._place(low), self._place(high)
        self.step = 1.0 if whole else (self.high - self.low) / SLIDER_STEPS
        self.marks = ((self.low, number_text(low)), (self.high, number_text(high)))
        self.box_step = 10.0 ** math.floor(math.log10((high - low) / 100)) if high - low < 100 else 1.0
        """What an arrow key adds in the box: about a hundredth of the slider, but no more than 1."""

    def place(self, value: float) -> float:
        """Where a value stands on the slider, at its end if outside."""
        if self._logarithmic and value <= 0:
            return self.low
        return min(max(self._place(value), self.low), self.high)

    def shows(self, value: float) -> bool:
        """Whether a value has a place on the slider."""
        return self.low <= self._place(value) <= self.high if value > 0 or not self._logarithmic else False

    def value(self, place: float) -> float:
        """The value at a place, with four significant digits. A place that is no number gives NaN."""
        if not math.isfinite(place) or abs(place) > 1e300:
            return math.nan
        value = 10.0 ** min(place, 300.0) if self._logarithmic else place
        return float(round(value)) if self._whole else float(f"{value:.4g}")

    def marked(self, places: list[tuple[float, str]]) -> tuple[tuple[float, str], ...]:
        """All marks of the slider, in order: the page's style takes the first and the last one for the ends.

        An end whose label has no room beside that of another mark stays without one.
        """
        near = CROWDED * (self.high - self.low)
        first, last = (
            (end, "" if any(abs(at - end) < near for at, _ in places) else label) for end, label in self.marks
        )
        return (first, *sorted(places), last)

    def _place(self, value: float) -> float:
        return math.log10(value) if self._logarithmic else value


class NumberControl:
    """Box, slider, the way back and a line for what is wrong, in the GUI container that is open while it is made.

    `name` and `unit` make the label. `ask(value)` carries out what a person wants, or raises a `FlexlabError`. `usual()` is
    the value that the small button goes back to; None: no button.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        lab_state: LabState,
        name: str,
        unit: str,
        scale: Scale,
        hint: str,
        value: float,
        ask: Callable[[float], None],
        usual: Callable[[], float] | None = None,
    ):
        self._name, self._unit = name, unit
        self._scale, self._ask, self._value, self._usual = scale, ask, value, usual
        self._touched, self._marked = -math.inf, []
        self._box = gui.add_number(f"{name} ({unit})" if unit else name, value, step=scale.box_step, hint=hint)
        self._box.precision = BOX_DIGITS
        self._slider = gui.add_slider(
            f"{name}, slider", scale.low, scale.high, scale.step, scale.place(value), marks=scale.marks, hint=hint
        )
        self._back = gui.add_button("↺", color="gray", visible=False, hint=f"{name}: back to its usual value")
        self._problem = gui.add_html("", visible=False)
        self._box.on_update(handler(lab_state, lambda _: self._type(self._box.value)))
        self._slider.on_update(handler(lab_state, lambda _: self._slide(self._slider.value)))
        self._back.on_click(handler(lab_state, lambda _: self._go_back()))
        self._offer_way_back()

    def settle(self, value: float) -> None:
        """Show the true value, unless a person is at this control."""
        if time.monotonic() - self._touched > SETTLE_TIME:
            self._show(value)
            if time.monotonic() - self._touched > READING_TIME:
                self._complain("")
        else:
            self._value = value

    def show(self, value: float) -> None:
        """Show the true value at once: after a reset, a preset, an undo. A sentence stays while what it says is true."""
        if value != self._value:
            self._complain("")
        self._show(value)

    def _show(self, value: float) -> None:
        self._value = value
        self._offer_way_back()
        if self._box.value != value:
            self._box.value = value
        place = self._scale.place(value)
        if not math.isclose(self._slider.value, place, abs_tol=self._scale.step):
            self._slider.value = place

    def mark(self, values: tuple[tuple[float, str], ...]) -> None:
        """Mark values on the slider, between its ends; those outside it have no place there."""
        places = [(self._scale.place(value), label) for value, label in values if self._scale.shows(value)]
        if places != self._marked:
            self._marked = places
            mark_slider(self._slider, self._scale.marked(places))

    def remove(self) -> None:
        """Take the control off the screen."""
        for widget in (self._box, self._slider, self._back, self._problem):
            widget.remove()

    def _slide(self, place: float) -> None:
        if self._accepted(self._scale.value(place)):
            self._box.value = self._value

    def _type(self, value: float) -> None:
        if self._accepted(value):
            self._slider.value = self._scale.place(value)

    def _accepted(self, value: float) -> bool:
        """Ask for a value; if it is refused, say why below and leave what was typed to be mended."""
        self._touched = time.monotonic()
        try:
            check_range(self._scale.about, self._name, self._unit, value)
            self._ask(value)
        except FlexlabError as error:
            self._complain(f"{error} It stays at {number_text(self._value, 6)}.")
            return False
        self._value = value
        self._offer_way_back()
        self._complain("")
        return True

    def _go_back(self) -> None:
        if self._usual is not None and self._accepted(self._usual()):
            self._touched = -math.inf
            self._show(self._value)

    def _offer_way_back(self) -> None:
        if self._usual is not None:
            put(self._back, visible=self._usual() != self._value)

    def _complain(self, text: str) -> None:
        box = f'<div class="fl"><div class="fl-box fl-error">{escaped(text)}</div></div>' if text else ""
        put(self._problem, content=box, visible=bool(text))
