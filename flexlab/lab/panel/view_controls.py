"""What is drawn and how large: exaggeration, overlays, plot window. Settings of the screen, not of the simulation."""

from collections.abc import Callable
from typing import Any

import viser

from flexlab.lab.lab_state import LabState
from flexlab.lab.panel.number_control import NumberControl
from flexlab.lab.scene.cameras import VIEWS
from flexlab.lab.view_settings import EXAGGERATION, PLOT_WINDOWS, SWITCHES, fitting_window
from flexlab.lab.widgets import add_button, handler, put

Look = Callable[[viser.ClientHandle, str], None]
"""Show a named camera view in one browser."""


def _looker(look: Look, view: str) -> Callable[[Any], None]:
    return lambda event: look(event.client, view)


class ViewControls:
    """Controls of the view, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, look: Look):
        self._lab_state = lab_state
        view = lab_state.view
        hint = f"Drawing only, {EXAGGERATION.range_text()}; plots stay in true mm."
        self._exaggeration = NumberControl(gui, lab_state, EXAGGERATION, view.exaggeration, self._exaggerate, hint=hint)
        self._seen_window = view.plot_window
        self._windows = {f"{window:g} s": window for window in PLOT_WINDOWS}
        self._window = gui.add_dropdown("Plot window", tuple(self._windows), initial_value=f"{view.plot_window:g} s")
        self._window.on_update(handler(lab_state, lambda _: self._choose_window(self._windows[self._window.value])))
        for view in VIEWS:
            add_button(gui, lab_state, view, _looker(look, view), hint="Camera view, in this browser")
        self._switches = {setting: self._switch(gui, label, setting) for setting, label in SWITCHES.items()}

    def settle(self) -> None:
        """Follow the view's settings, leaving alone what a person is at."""
        self._exaggeration.settle(self._lab_state.view.exaggeration)
        window = self._lab_state.view.plot_window
        if window != self._seen_window:
            self._seen_window = window
            self._window.value = f"{window:g} s"
        for setting, box in self._switches.items():
            put(box, value=getattr(self._lab_state.view, setting))

    def show(self) -> None:
        """Show the view's settings at once."""
        self._exaggeration.show(self._lab_state.view.exaggeration)

    def _switch(self, gui: viser.GuiApi, label: str, setting: str) -> viser.GuiCheckboxHandle:
        box = gui.add_checkbox(label, getattr(self._lab_state.view, setting))
        box.on_update(handler(self._lab_state, self._setter(setting, box)))
        return box

    def _setter(self, setting: str, box: viser.GuiCheckboxHandle) -> Callable[[object], None]:
        def set_it(_: object) -> None:
            self._lab_state.set_view(**{setting: bool(box.value)})
            if setting == "follow_speed" and box.value:
                self._lab_state.set_view(plot_window=fitting_window(self._lab_state.snapshot.target_speed))

        return set_it

    def _choose_window(self, window: float) -> None:
        self._seen_window = window
        self._lab_state.set_view(plot_window=window, follow_speed=False)

    def _exaggerate(self, value: float) -> None:
        self._lab_state.set_view(exaggeration=float(value), follow_deflection=False)
