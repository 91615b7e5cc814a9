"""Numbers on the screen: a box that takes any value and, if the quantity has a slider range, a slider below it."""

import math
import time
from collections.abc import Callable
from typing import Any

import viser

from flexlab.errors import FlexlabError, LabError
from flexlab.lab.viser_internals import mark_slider
from flexlab.lab.viser_server import SETTLE_TIME
from flexlab.lab.widgets import Widgets, put
from flexlab.quantities import Quantity
from flexlab.text import escaped, number_text, with_units

READING_TIME = 30.0
"""How long the sentence about a refused value stays, wall s: it outlives the value itself."""
SLIDER_STEPS = 200
CROWDED = 0.12
"""Fraction of a slider within which the labels of two marks would overlap."""
BOX_DIGITS, FINEST_DIGITS = 12, 14
"""Decimals of a number box, and of one whose range begins below the last of these."""

LIVE_HINTS = {
    "continuous": "Acts at once.",
    "projected": "Reshapes the beam's mesh; its shape is carried over.",
    "restart": "Starts a new run.",
}

Numbers = float | tuple[float, ...] | None
"""The value of a control; None if its switch is off."""
Marks = tuple[tuple[float, str], ...]
"""Values on a slider, with their labels."""


def _check_range(about: Quantity, value: Numbers) -> None:
    """Raise `LabError` for a number outside the range of `about`."""
    items = value if isinstance(value, tuple) else () if value is None else (value,)
    for place, item in enumerate(items, 1):
        if not about.low <= item <= about.high:
            which = f"{about.title}, {place} of {len(items)}" if len(items) > 1 else about.title
            raise LabError(
                f"{which} = {number_text(item, 6)}{about.unit_text()} is outside the allowed range {about.range_text()}: "
                "choose a value within it."
            )


def _text(value: Numbers) -> str:
    if value is None:
        return "none"
    return ", ".join(number_text(item, 6) for item in (value if isinstance(value, tuple) else (value,)))


class Scale:
    """Maps values to places on a slider and back, linearly or (above 0) logarithmically; `whole` for whole numbers only."""

    def __init__(self, about: Quantity, whole: bool = False):
        self.about = about
        low, high = about.slider or (about.low, about.high)
        # A person's own law may ask for a logarithmic slider from 0, which cannot be.
        self._logarithmic, self._whole = about.logarithmic and low > 0, whole
        self.low, self.high = self._place(low), self._place(high)
        self.step = 1.0 if whole else (self.high - self.low) / SLIDER_STEPS
        self.marks = ((self.low, number_text(low)), (self.high, number_text(high)))
        self.box_step = 10.0 ** math.floor(math.log10((high - low) / 100)) if high - low < 100 else 1.0
        """Step of an arrow key in the box: about a hundredth of the slider, but no more than 1."""

    def place(self, value: float) -> float:
        """The place of a value on the slider; the nearer end for a value beyond it."""
        if self._logarithmic and value <= 0:
            return self.low
        return min(max(self._place(value), self.low), self.high)

    def shows(self, value: float) -> bool:
        """Whether a value has a place on the slider."""
        return self.low <= self._place(value) <= self.high if value > 0 or not self._logarithmic else False

    def value(self, place: float) -> float:
        """The value at a place, with four significant digits; NaN if the place is not finite or too large."""
        if not math.isfinite(place) or abs(place) > 1e300:
            return math.nan
        value = 10.0 ** min(place, 300.0) if self._logarithmic else place
        return float(round(value)) if self._whole else float(f"{value:.4g}")

    def marked(self, places: list[tuple[float, str]]) -> tuple[tuple[float, str], ...]:
        """All marks of the slider, in order: the page's style treats the first and the last as the ends.

        An end has no label if there is no room beside the label of another mark.
        """
        near = CROWDED * (self.high - self.low)
        first, last = (
            (end, "" if any(abs(at - end) < near for at, _ in places) else label) for end, label in self.marks
        )
        return (first, *sorted(places), last)

    def _place(self, value: float) -> float:
        return math.log10(value) if self._logarithmic else value


class NumberControl:
    """Box, slider, button back to the usual value, and a line for errors, made in the open GUI container."""

    def __init__(
        self,
        widgets: Widgets,
        about: Quantity,
        read: Callable[[], Numbers],
        ask: Callable[[Numbers], None],
        usual: Callable[[], Numbers] | None = None,
        *,
        hint: str,
        slider: bool = True,
        whole: bool = False,
        switch: tuple[str, Callable[[], Numbers]] | None = None,
        marks: Callable[[], Marks] = tuple,
    ):
        """`read` returns the true value; `ask` sets the value that a person wants, or raises a `FlexlabError`.

        The label is made of `about`'s title and unit. `usual` returns the value that ↺ restores, `marks` the values between the
        slider's ends that have a meaning. `slider`: only for a single number. `whole`: only whole numbers. `switch`: label of
        the switch that gives the field a value, and that value; None if it always has one.
        """
        self._about = about
        self._read, self._ask, self._usual, self._marks = read, ask, usual or read, marks
        self._value = value = read()
        self._stays_at = value  # The value that the sentence below the box names.
        self._touched, self._marked = -math.inf, []
        self._scale = Scale(about, whole) if slider else None
        self._switch = self._slider = None
        if switch is not None:
            self._switch = widgets.checkbox(
                switch[0], value is not None, lambda on: self._turn(switch[1]() if on else None), LIVE_HINTS[about.live]
            )
        shown = switch[1]() if switch is not None and value is None else value
        label = f"{about.title} ({about.unit})" if about.unit_text() else about.title
        self._box = self._add_box(widgets.gui, label, shown, 1.0 if whole else None, hint)
        put(self._box, visible=value is not None)
        self._box.on_update(widgets.handler(lambda _: self._type(self._box.value)))
        if self._scale is not None:
            low, high, place = self._scale.low, self._scale.high, self._scale.place(shown)
            name = f"{about.title}, slider"
            slide = widgets.gui.add_slider(name, low, high, self._scale.step, place, marks=self._scale.marks, hint=hint)
            slide.on_update(widgets.handler(lambda _: self._slide(slide.value)))
            self._slider = slide
        back = f"{about.title}: back to its usual value"
        self._back = widgets.button("↺", lambda _: self._go_back(), visible=False, hint=back)
        self._problem = widgets.gui.add_html("", visible=False)
        self.settle()

    def settle(self, at_once: bool = False) -> None:
        """Show the true value, unless a person is using this control; with `at_once`, as after a new run, even then.

        A sentence stays long enough to be read; after a new run, only while it is true.
        """
        value, since = self._read(), time.monotonic() - self._touched
        self._mark()
        if since <= SETTLE_TIME and not at_once:
            self._value = value
            return
        self._show(value)
        if since > READING_TIME or (at_once and value != self._stays_at):
            self._complain("")

    def _show(self, value: Numbers) -> None:
        self._value = value
        put(self._back, visible=self._usual() != value)
        if self._switch is not None:
            put(self._switch, value=value is not None)
        put(self._box, visible=value is not None)
        # Another tab has just chosen a law or path with a field of this name and another shape: this control will be removed.
        if value is None or isinstance(value, tuple) != isinstance(self._box.value, tuple):
            return
        put(self._box, value=value)
        if self._scale is not None and self._slider is not None:
            place = self._scale.place(value)
            if not math.isclose(self._slider.value, place, abs_tol=self._scale.step):
                self._slider.value = place

    def _mark(self) -> None:
        """Mark values on the slider, except those beyond its ends."""
        if self._scale is None or self._slider is None:
            return
        places = [(self._scale.place(value), label) for value, label in self._marks() if self._scale.shows(value)]
        if places != self._marked:
            self._marked = places
            mark_slider(self._slider, self._scale.marked(places))

    def remove(self) -> None:
        """Remove the control from the screen."""
        for widget in (self._switch, self._box, self._slider, self._back, self._problem):
            if widget is not None:
                widget.remove()

    def _add_box(self, gui: viser.GuiApi, label: str, value: Any, step: float | None, hint: str) -> Any:
        if isinstance(value, tuple):
            add = gui.add_vector2 if len(value) == 2 else gui.add_vector3
            box: Any = add(label, value, hint=hint)
        else:
            # As a float: viser would silently round all later values if this one were an int.
            step = self._scale.box_step if self._scale is not None else step
            box = gui.add_number(label, float(value), step=step, hint=hint)
        box.precision = FINEST_DIGITS if 0 < self._about.low < 10.0**-BOX_DIGITS else BOX_DIGITS
        return box

    def _turn(self, value: Numbers) -> None:
        # A refused switch goes back at once: it has no text to correct.
        self._accepted(value)
        self._show(self._value)

    def _slide(self, place: float) -> None:
        if self._scale is not None and self._accepted(self._scale.value(place)):
            self._box.value = self._value

    def _type(self, value: Numbers) -> None:
        if self._accepted(value) and self._scale is not None and self._slider is not None:
            self._slider.value = self._scale.place(value)

    def _accepted(self, value: Numbers) -> bool:
        """Ask for a value; if it is refused, say why below the box and leave the typed text to be corrected."""
        self._touched = time.monotonic()
        try:
            _check_range(self._about, value)
            self._ask(value)
        except FlexlabError as error:
            self._stays_at = self._value
            unit = "" if self._stays_at is None else self._about.unit_text()
            self._complain(f"{error} It stays at {_text(self._stays_at)}{unit}.")
            return False
        self._value = value
        put(self._back, visible=self._usual() != value)
        self._complain("")
        return True

    def _go_back(self) -> None:
        if self._accepted(self._usual()):
            self._touched = -math.inf
            self._show(self._value)

    def _complain(self, text: str) -> None:
        box = f'<div class="fl"><div class="fl-box fl-error">{escaped(with_units(text))}</div></div>' if text else ""
        put(self._problem, content=box, visible=bool(text))
