"""The play screen: the beam, a tap, three sliders and a sentence; its *More* opens the lab with the same run.

The page decides which of the two it shows (`page.js`, `?play` in its address): both stand in the same panel.
"""

import math

import viser

from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.panel.field import Field
from flexlab.lab.panel.number_control import NumberControl, Scale
from flexlab.lab.panel.playback import SPEEDS
from flexlab.lab.panel.view_controls import Look
from flexlab.lab.picking import Picking
from flexlab.lab.scene.cameras import VIEWS
from flexlab.quantities import Quantity
from flexlab.scenario import Scenario
from flexlab.sim.commands import SetSpeed

SPEED = Quantity("Simulation speed", unit="×", low=SPEEDS[-1], high=SPEEDS[0], slider=(0.01, 1), logarithmic=True)
SENTENCE = (
    "Tap the beam or drag it: a stiffer one rings faster, a damped one comes to rest sooner, "
    "and slow motion shows how it bends."
)


def _damping_path(scenario: Scenario) -> str:
    """The number of the beam's damping, whatever its kind."""
    (name,) = set(type(scenario.payload.damping).model_fields) - {"kind"}
    return f"payload.damping.{name}"


class PlayScreen:
    """Controls of the play screen, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, touch: Picking, look: Look):
        self._gui, self._lab_state = gui, lab_state
        self._folder = gui.add_folder("Play")
        with self._folder:
            gui.add_html(f'<div class="fl fl-play">{SENTENCE}</div>')  # By which the page finds the screen.
            tap = gui.add_button("Tap", icon=viser.Icon.HAND_CLICK, hint="A blow across the beam")
            tap.on_click(handler(lab_state, lambda _: touch.tap()))
            back = gui.add_button("Reset view", color="gray", hint="The camera back to where it stood, in this browser")
            back.on_click(handler(lab_state, lambda event: look(event.client, VIEWS[0])))
            gui.add_button("More", color="gray", hint="The whole lab, with this run")
            self._stiffness = Field(gui, lab_state, "payload.bending_stiffness", None, "Stiffness EI", "N·m²")
        self._build_damping(lab_state.intended)
        with self._folder:
            self._speed = NumberControl(
                gui, lab_state, SPEED.title, SPEED.unit, Scale(SPEED), "Slow motion", self._present_speed(), self._ask
            )

    def update(self, scenario: Scenario) -> None:
        """Follow the run, leaving alone what a person is at."""
        if _damping_path(scenario) != self._damping_shown or type(scenario.payload.damping) is not self._kind:
            self._damping.remove()
            self._build_damping(scenario)
        for field in (self._stiffness, self._damping):
            field.settle(scenario)
        self._speed.settle(self._present_speed())

    def _build_damping(self, scenario: Scenario) -> None:
        self._kind, self._damping_shown = type(scenario.payload.damping), _damping_path(scenario)
        unit = scenario.about(self._damping_shown).unit
        with self._folder:
            self._damping = Field(
                self._gui, self._lab_state, self._damping_shown, None, "Beam's damping", "" if unit == "1" else unit
            )

    def _present_speed(self) -> float:
        return float(f"{self._lab_state.target_speed:.3g}")

    def _ask(self, value: float) -> None:
        # The menu of the lab knows powers of two: both say the same.
        nearest = min(SPEEDS, key=lambda speed: abs(math.log(speed / value)) if value > 0 else speed)
        self._lab_state.submit(SetSpeed(nearest))
