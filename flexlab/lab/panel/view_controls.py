"""What is drawn and how large: exaggeration, overlays, plot window. Settings of the screen, not of the simulation."""

from collections.abc import Callable
from functools import partial

import viser

from flexlab.lab.panel.number_control import NumberControl
from flexlab.lab.scene.cameras import VIEWS
from flexlab.lab.view_settings import EXAGGERATION, PLOT_WINDOWS, SWITCHES, fitting_window
from flexlab.lab.widgets import Menu, Widgets, put

Look = Callable[[viser.ClientHandle, str], None]
"""Show a named camera view in one browser."""


class ViewControls:
    """Controls of the view, in the GUI container that is open while it is made."""

    def __init__(self, widgets: Widgets, look: Look):
        self._lab_state = lab_state = widgets.lab_state
        self._exaggeration = NumberControl(
            widgets,
            EXAGGERATION,
            lambda: lab_state.view.exaggeration,
            lambda factor: lab_state.set_view(exaggeration=factor, follow_deflection=False),
            hint=f"Drawing only, {EXAGGERATION.range_text()}; plots stay in true mm.",
        )
        windows = {f"{window:g} s": window for window in PLOT_WINDOWS}
        self._window = Menu(
            widgets,
            "Plot window",
            lambda: windows,
            lambda: f"{lab_state.view.plot_window:g} s",
            lambda word: lab_state.set_view(plot_window=windows[word], follow_speed=False),
        )
        for view in VIEWS:
            hint = "Camera view, in this browser"
            widgets.button(view, lambda event, view=view: look(event.client, view), hint=hint)
        self._switches = {
            setting: widgets.checkbox(label, getattr(lab_state.view, setting), partial(self._set, setting))
            for setting, label in SWITCHES.items()
        }

    def settle(self, at_once: bool) -> None:
        """Follow the view's settings; leave alone what a person is at, unless it is to be `at_once`."""
        self._exaggeration.settle(at_once)
        self._window.settle()
        for setting, box in self._switches.items():
            put(box, value=getattr(self._lab_state.view, setting))

    def _set(self, setting: str, on: bool) -> None:
        self._lab_state.set_view(**{setting: on})
        if setting == "follow_speed" and on:
            self._lab_state.set_view(plot_window=fitting_window(self._lab_state.snapshot.target_speed))
