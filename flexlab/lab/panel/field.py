"""One number of the scenario as a control on the screen, built from the field's metadata."""

from typing import Any

import viser

from flexlab.lab.lab_state import LabState
from flexlab.lab.panel.number_control import NumberControl, Scale
from flexlab.lab.panel.text import number
from flexlab.physics.axial_load import buckling_load
from flexlab.scenario import Scenario

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
        self._lab_state, self._path, self._component = lab_state, path, component
        about = lab_state.intended.about(path)
        whole = isinstance(lab_state.intended.get(path), int)
        space = f" {unit}" if unit else ""
        hint = f"Allowed: {number(about.low)} to {number(about.high)}{space}. {LIVE_HINTS[about.live]}"
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
        self._lab_state.change({self._path: self._whole(value)})

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
