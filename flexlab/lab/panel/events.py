"""What has happened in this run, and a way to a chosen time."""

import viser

from flexlab.errors import LabError
from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.panel.number_control import BOX_DIGITS
from flexlab.lab.panel.readouts import events_html
from flexlab.sim.command_queue import MOST_STEPS
from flexlab.sim.commands import StepOnce
from flexlab.sim.snapshot import TICK, Snapshot


class Events:
    """Event list and "run to", in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState):
        self._lab_state = lab_state
        self._goal = gui.add_number("Run to t (s)", 1.0, step=0.1, hint="As fast as this machine can, then hold")
        self._goal.precision = BOX_DIGITS
        run = gui.add_button("Run to it", icon=viser.Icon.PLAYER_SKIP_FORWARD, color="gray")
        run.on_click(handler(lab_state, lambda _: self.run_to(float(self._goal.value))))
        self._list = gui.add_html("")

    def update(self, snapshot: Snapshot) -> None:
        """Bring the list up to date."""
        self._list.content = events_html(snapshot)

    def run_to(self, goal: float) -> None:
        """Run to a simulation time, s; raises `LabError` for one that has passed or is too far away."""
        now = float(self._lab_state.snapshot.latest.time[0])
        ticks = round((goal - now) / TICK)
        if ticks < 1:
            raise LabError(f"t = {goal:g} s has passed (now {now:.3f} s): press Reset first, or choose a later time.")
        if ticks > MOST_STEPS:
            raise LabError(f"t = {goal:g} s is more than {MOST_STEPS * TICK:g} s ahead: go there in steps.")
        self._lab_state.submit(StepOnce(ticks))
