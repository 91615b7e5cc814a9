"""What is drawn and how large: exaggeration, overlays, plot window. Settings of the screen, not of the simulation."""

import math
from collections.abc import Callable

import viser

from flexlab.errors import LabError
from flexlab.lab.desk import Desk, handler
from flexlab.lab.view import EXAGGERATION_RANGE, PLOT_WINDOWS


class Viewing:
    """Controls of the view, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, desk: Desk):
        self._desk = desk
        view = desk.view
        low, high = EXAGGERATION_RANGE
        self._factor = gui.add_number("Exaggeration of the deflection (×)", view.exaggeration, step=1.0)
        self._factor.precision = 3
        self._factor.hint = f"Drawing only, {low:g} to {high:g}; plots stay in true mm"
        self._windows = {f"{window:g} s": window for window in PLOT_WINDOWS}
        self._window = gui.add_dropdown("Plot window", tuple(self._windows), initial_value=f"{view.plot_window:g} s")
        self._switches = [
            self._switch(gui, "Internal force arrows", "forces"),
            self._switch(gui, "Desired pose", "ghost"),
            self._switch(gui, "Desired path", "path"),
        ]
        self._factor.on_update(handler(desk, lambda _: self._set_factor(self._factor.value)))
        self._window.on_update(handler(desk, lambda _: self._set_window(self._window.value)))

    def show(self) -> None:
        """Show the view's settings in the controls."""
        if self._factor.value != self._desk.view.exaggeration:
            self._factor.value = self._desk.view.exaggeration

    def _switch(self, gui: viser.GuiApi, label: str, setting: str) -> viser.GuiCheckboxHandle:
        box = gui.add_checkbox(label, getattr(self._desk.view, setting))
        box.on_update(handler(self._desk, self._setter(setting, box)))
        return box

    def _setter(self, setting: str, box: viser.GuiCheckboxHandle) -> Callable[[object], None]:
        return lambda _: self._desk.set_view(**{setting: bool(box.value)})

    def _set_factor(self, value: float) -> None:
        low, high = EXAGGERATION_RANGE
        if not math.isfinite(value) or not low <= value <= high:
            raise LabError(
                f"exaggeration = {value:g} is outside the allowed range {low:g} to {high:g}: choose within it."
            )
        self._desk.set_view(exaggeration=float(value))

    def _set_window(self, choice: str) -> None:
        if choice not in self._windows:
            raise LabError(f"{choice[:40]!r} is not a plot window of the menu: choose one of its times.")
        self._desk.set_view(plot_window=self._windows[choice])
