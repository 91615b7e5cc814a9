"""The control panel: what a person can change, and what the lab says about the run."""

from collections.abc import Callable

import viser

from flexlab.lab.desk import Desk
from flexlab.lab.mode_study import ModeStudy
from flexlab.lab.panel.comparing import Comparing
from flexlab.lab.panel.drive import Drive
from flexlab.lab.panel.modes import ModePanel
from flexlab.lab.panel.presets import Presets
from flexlab.lab.panel.readouts import events_html, notices_html, status_html
from flexlab.lab.panel.sections import SECTIONS, Section, three_valued
from flexlab.lab.panel.style import style_element
from flexlab.lab.panel.text import escaped
from flexlab.lab.panel.touching import Touching
from flexlab.lab.panel.viewing import Look, Viewing
from flexlab.lab.touch import Touch
from flexlab.lab.view import Legend
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Event, Snapshot


class Panel:
    """The main panel of one server. `update` may be called from one thread only."""

    def __init__(
        self,
        gui: viser.GuiApi,
        desk: Desk,
        runner: Runner,
        study: ModeStudy,
        touch: Touch,
        look: Look,
        recording: Callable[[], str],
    ):
        self._desk, self._recording = desk, recording
        self._run_number = -1
        self._last_event: Event | None = None
        gui.add_html(style_element())
        self._notices = gui.add_html("")
        self._status = gui.add_html("")
        self._drive = Drive(gui, desk)
        self._presets = Presets(gui, desk)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Parameters"):
            self._note = gui.add_html("", visible=False)
            self._sections = [Section(gui, desk, title, path) for title, path in SECTIONS]
        with tabs.add_tab("View"):
            self._viewing = Viewing(gui, desk, look)
        with tabs.add_tab("Touch"):
            self._touching = Touching(gui, desk, touch)
        with tabs.add_tab("Modes"):
            self._modes = ModePanel(gui, desk, runner, study)
        with tabs.add_tab("Compare"):
            self._comparing = Comparing(gui, desk, runner)
        with tabs.add_tab("Events"):
            self._events = gui.add_html("")

    def update(self, snapshot: Snapshot, legend: Legend) -> None:
        """Bring readouts up to date; rewrite inputs after a reset or preset, and where nobody is at them."""
        desk = self._desk
        desk.settle(snapshot)
        self._announce(snapshot)
        self._status.content = status_html(snapshot, desk.view, legend, self._recording())
        self._notices.content = notices_html(snapshot, desk.notice)
        self._events.content = events_html(snapshot)
        self._drive.update(snapshot)
        self._modes.update(snapshot)
        self._comparing.update(snapshot)
        note = three_valued(desk.intended)
        self._note.content, self._note.visible = f'<div class="fl fl-dim">{escaped(note)}</div>', bool(note)
        if snapshot.run_number != self._run_number:
            self._run_number = snapshot.run_number
            self._presets.show(snapshot)
            self._viewing.show()
            for section in self._sections:
                section.show(snapshot.scenario)
        else:
            self._viewing.settle()
            self._touching.settle()
            for section in self._sections:
                section.settle(desk.intended)

    def _announce(self, snapshot: Snapshot) -> None:
        """Show what the engine refused or stopped at since the last update."""
        events = snapshot.events
        if not events or events[-1] is self._last_event:
            return
        seen = next((index for index, event in enumerate(events) if event is self._last_event), -1)
        for event in events[seen + 1 :]:
            if event.level == "error":
                self._desk.say(event.text, "error")
        self._last_event = events[-1]
