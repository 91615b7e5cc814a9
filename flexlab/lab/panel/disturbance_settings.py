"""How hard hands are: stiffness of the pull, impulse and place of the tap."""

from functools import partial

import viser

from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.panel.number_control import NumberControl, Scale
from flexlab.lab.picking import IMPULSE, PLACE, STIFFNESS, Picking
from flexlab.quantities import Quantity


class DisturbanceSettings:
    """Controls of touch, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, touch: Picking):
        self._touch = touch
        words = (
            "Drag the beam or a link to pull it with a spring; click the beam to tap it. Empty space turns the camera."
        )
        gui.add_html(f'<div class="fl fl-dim">{words}</div>')
        self._controls = {}
        for about, name in ((STIFFNESS, "stiffness"), (IMPULSE, "impulse"), (PLACE, "place")):
            self._controls[name] = self._control(gui, lab_state, about, name)
        tap = gui.add_button("Tap", icon=viser.Icon.HAND_CLICK, color="gray", hint="An impulse across the beam")
        tap.on_click(handler(lab_state, lambda _: touch.tap()))

    def settle(self) -> None:
        """Show the true values where nobody is at them."""
        for name, control in self._controls.items():
            control.settle(getattr(self._touch, name))

    def _control(self, gui: viser.GuiApi, lab_state: LabState, about: Quantity, name: str) -> NumberControl:
        usual = getattr(self._touch, name)
        hint = f"Allowed: {about.range_text()}."
        ask = partial(self._touch.set, about, name)
        return NumberControl(gui, lab_state, about.title, about.unit, Scale(about), hint, usual, ask, lambda: usual)
