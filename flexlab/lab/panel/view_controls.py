"""What is drawn and how large: exaggeration, overlays, plot window. Settings of the screen, not of the simulation."""

from collections.abc import Callable
from typing import Any

import viser

from flexlab.errors import LabError
from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.panel.number_control import NumberControl, Scale
from flexlab.lab.scene.camera_views import VIEWS
from flexlab.lab.view_settings import EXAGGERATION, PLOT_WINDOWS, SWITCHES, fitting_exaggeration

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
        self._exaggeration = NumberControl(
            gui,
            lab_state,
            EXAGGERATION.title,
            "×",
            Scale(EXAGGERATION),
            hint,
            view.exaggeration,
            self._exaggerate,
            lambda: fitting_exaggeration(lab_state.intended),
        )
        self._seen_window = view.plot_window
        self._windows = {f"{window:g} s": window for window in PLOT_WINDOWS}
        self._window = gui.add_dropdown("Plot window", tuple(self._windows), initial_value=f"{view.plot_window:g} s")
        self._window.on_update(
            handler(lab_state, lambda _: lab_state.set_view(plot_window=self._windows[self._window.value]))
        )
        for view in VIEWS:
            gui.add_button(view, color="gray", hint="Camera view, in this browser").on_click(
                handler(lab_state, _looker(look, view))
            )
        for setting, label in SWITCHES.items():
            self._switch(gui, label, setting)

    def settle(self) -> None:
        """Follow the view's settings, leaving alone what a person is at."""
        self._exaggeration.settle(self._lab_state.view.exaggeration)
        window = self._lab_state.view.plot_window
        if window != self._seen_window:
            self._seen_window = window
            self._window.value = f"{window:g} s"

    def show(self) -> None:
        """Show the view's settings at once."""
        self._exaggeration.show(self._lab_state.view.exaggeration)

    def _switch(self, gui: viser.GuiApi, label: str, setting: str) -> None:
        box = gui.add_checkbox(label, getattr(self._lab_state.view, setting))
        box.on_update(handler(self._lab_state, self._setter(setting, box)))

    def _setter(self, setting: str, box: viser.GuiCheckboxHandle) -> Callable[[object], None]:
        return lambda _: self._lab_state.set_view(**{setting: bool(box.value)})

    def _exaggerate(self, value: float) -> None:
        if not EXAGGERATION.low <= value <= EXAGGERATION.high:
            allowed = EXAGGERATION.range_text()
            raise LabError(
                f"exaggeration = {value:g} is outside the allowed range {allowed}: choose a value within it."
            )
        self._lab_state.set_view(exaggeration=float(value))
