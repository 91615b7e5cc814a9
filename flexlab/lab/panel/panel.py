"""The control panel: what a person can change, what is drawn and at which scale, and what the lab says about the run."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import viser

from flexlab.errors import LabError
from flexlab.lab.lab_state import LabState
from flexlab.lab.look_back import LookBack
from flexlab.lab.mode_computation import ModeStudy
from flexlab.lab.panel.mode_table import ModePanel
from flexlab.lab.panel.number_control import READING_TIME, SETTLE_TIME, NumberControl
from flexlab.lab.panel.playback import Events, Playback, PlayScreen, Scrub
from flexlab.lab.panel.readouts import SEEN_TOGETHER, conditions_html, notices_html, number_html, status_html
from flexlab.lab.panel.ring_panel import RingPanel
from flexlab.lab.panel.run_comparison import Comparing
from flexlab.lab.panel.scenario_files import Presets, ScenarioFiles
from flexlab.lab.panel.sections import GROUPS, SECTIONS, Folder, group_rows, section_rows, three_valued
from flexlab.lab.picking import Picking, touch_controls
from flexlab.lab.scene.cameras import VIEWS, Look
from flexlab.lab.view_settings import EXAGGERATION, PLOT_WINDOWS, SWITCHES, fitting_window
from flexlab.lab.widgets import LAST, Menu, Widgets, put, table_html
from flexlab.presets import load_preset, preset_names
from flexlab.scenario import Scenario
from flexlab.sim.snapshot import Event, Snapshot
from flexlab.text import escaped

NUMBER_KEYS = 9
PRESENTATION = "The scene, one plot, one number, in this browser"
MORE = (
    "Tab goes from one control to the next; arrows move a slider. "
    "Elsewhere arrows turn the camera, and A, D, W, S, Q, E move it. Ctrl+K opens the palette of commands, Esc closes."
)


class ViewControls:
    """Controls of the view, made in the open GUI container."""

    def __init__(self, widgets: Widgets, look: Look, present: Callable[[viser.ClientHandle], None]):
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
        widgets.button("Presentation", lambda event: present(event.client), hint=PRESENTATION)
        self._switches = {
            setting: widgets.checkbox(label, getattr(lab_state.view, setting), partial(self._set, setting))
            for setting, label in SWITCHES.items()
        }

    def settle(self, at_once: bool) -> None:
        """Follow the view's settings; leave alone a control that a person is using, unless `at_once`."""
        self._exaggeration.settle(at_once)
        self._window.settle()
        for setting, box in self._switches.items():
            put(box, value=getattr(self._lab_state.view, setting))

    def _set(self, setting: str, on: bool) -> None:
        self._lab_state.set_view(**{setting: on})
        if setting == "follow_speed" and on:
            self._lab_state.set_view(plot_window=fitting_window(self._lab_state.snapshot.target_speed))


class Key(NamedTuple):
    """A command: name, description, key, modifier or None, and the action, which gets the event."""

    label: str
    words: str
    key: str | None
    modifier: str | None
    action: Callable[[Any], None]

    @property
    def shown(self) -> str:
        """The key as printed on keyboards."""
        names = {"space": "Space", "arrowright": "→", "?": "?"}
        key = names.get(self.key or "", (self.key or "").upper())
        modifier = {None: "", "shift": "" if self.key == "?" else "Shift+", "cmd/ctrl": "Ctrl+"}
        return modifier.get(self.modifier, "Ctrl+Shift+") + key


class Panel:
    """The main panel of one server. `update` may be called from one thread only."""

    def __init__(
        self,
        widgets: Widgets,
        look_back: LookBack,
        study: ModeStudy,
        touch: Picking,
        look: Look,
        present: Callable[[viser.ClientHandle], None],
        say: Callable[[viser.ClientHandle], None],
    ):
        """`present` begins or ends the presentation in one browser, `say` makes its screen reader say what happens."""
        self._lab_state, self._look_back, self._study = widgets.lab_state, look_back, study
        self._run_number = self._lab_state.snapshot.run_number
        self._last_event: Event | None = None
        self._told: Scenario | None = None
        self._settled: tuple[Scenario | None, Scenario | None] = (None, None)
        self._notices = widgets.gui.add_html("")
        # The bar belongs to the picture, which comes before the panel in Tab order; no button may follow directly (`page.css`).
        scrub = Scrub(widgets, look_back)
        self._caption, self._number = widgets.gui.add_html(""), widgets.gui.add_html("")
        self._status = widgets.gui.add_html("")
        self._drive, presets = Playback(widgets), Presets(widgets)
        tabs = widgets.gui.add_tab_group()
        with tabs.add_tab("Parameters"):
            self._note = widgets.gui.add_html("", visible=False)
            sections = {
                path: Folder(widgets, title, partial(section_rows, part_path=path), is_open=True)
                for title, path in SECTIONS
            }
            with sections["controller"].folder:
                self._conditions = widgets.gui.add_html("", order=LAST)
            details = [
                Folder(widgets, group.title, partial(group_rows, group=group), is_open=False) for group in GROUPS
            ]
            self._sections = [*sections.values(), *details]
        with tabs.add_tab("View"):
            self._viewing = ViewControls(widgets, look, present)
        with tabs.add_tab("Touch"):
            self._touching = touch_controls(widgets, touch)
            ring = RingPanel(widgets)
        with tabs.add_tab("Modes"):
            modes = ModePanel(widgets, study)
        with tabs.add_tab("Compare"):
            self.comparing = Comparing(widgets)
        with tabs.add_tab("File"):
            self._filing = ScenarioFiles(widgets, presets.menu.settle)
        with tabs.add_tab("Events"):
            events = Events(widgets)
        play = PlayScreen(widgets, touch, look)
        self._parts = events, presets, self._drive, scrub, play, modes, ring, self._filing
        add_keys(widgets, self._keys(present, say))

    def update(self, snapshot: Snapshot, seen: Snapshot, scales: list[tuple[str, str]], caption: str) -> None:
        """Update the readouts; rewrite inputs after a reset or preset, and those that nobody is using.

        `seen`: what the screen shows, the present or an earlier instant. `scales` and `caption` are the picture's.
        """
        lab_state = self._lab_state
        lab_state.settle(snapshot)
        lab_state.fit_view(snapshot)
        self._announce(snapshot)
        self._status.content = status_html(seen, lab_state.view, scales, lab_state.outside.recording())
        put(self._caption, content=f'<div class="fl fl-caption">{escaped(caption)}</div>')
        recent = self._look_back.recent(SEEN_TOGETHER)
        put(self._number, content=number_html(recent, seen))
        self._notices.content = notices_html(seen, recent, lab_state.notice, lab_state.rules)
        for part in self._parts:
            part.update(snapshot)
        if lab_state.intended is not self._told:
            self._told, note = lab_state.intended, three_valued(lab_state.intended)
            put(self._note, content=f'<div class="fl fl-dim">{escaped(note)}</div>', visible=bool(note))
        is_new, self._run_number = snapshot.run_number != self._run_number, snapshot.run_number
        self._viewing.settle(is_new)
        for control in self._touching:
            control.settle()
        # Usually the scenario has not changed, and no typed value needs to be replaced.
        scenarios = lab_state.intended, lab_state.baseline
        still = all(new is old for new, old in zip(scenarios, self._settled, strict=True))
        if is_new or not still or time.monotonic() - lab_state.touched_at < READING_TIME + SETTLE_TIME:
            self._settled = scenarios
            for section in self._sections:
                section.settle(is_new)
        put(self._conditions, content=conditions_html(self._study.conditions))

    def _keys(
        self, present: Callable[[viser.ClientHandle], None], say: Callable[[viser.ClientHandle], None]
    ) -> list[Key]:
        lab_state, drive = self._lab_state, self._drive
        return [
            Key("Play or pause", "Pause or continue the simulation", "space", None, lambda _: drive.pressed_key()),
            Key("Step", "Advance by 1 ms, then pause", "arrowright", None, lambda _: drive.step()),
            Key("Reset", "A new run from t = 0, same settings", "R", None, lambda _: drive.reset()),
            Key("Slow motion: slower", "Half the speed", ",", None, lambda _: drive.faster(0.5)),
            Key("Slow motion: faster", "Twice the speed", ".", None, lambda _: drive.faster(2.0)),
            Key("Undo", "Undo the last change", "Z", "cmd/ctrl", lambda _: lab_state.undo()),
            Key("Redo", "Redo the last undone change", "Z", "cmd/ctrl+shift", lambda _: lab_state.redo()),
            Key("Redo", "Redo the last undone change", "Y", "cmd/ctrl", lambda _: lab_state.redo()),
            Key("Save as preset", "Under the name on the tab File", "S", None, lambda _: self._filing.save()),
            Key("Presentation", PRESENTATION, "B", None, lambda event: present(event.client)),
            Key("Tell", "Have a screen reader say what happens", "T", None, lambda event: say(event.client)),
            Key("Back to preset", "A new run without your changes", None, None, lambda _: lab_state.back_to_baseline()),
        ]

    def _announce(self, snapshot: Snapshot) -> None:
        """Show the errors since the last update: what the engine refused, or why it stopped."""
        events = snapshot.events
        if not events or events[-1] is self._last_event:
            return
        seen = next((index for index, event in enumerate(events) if event is self._last_event), -1)
        for event in events[seen + 1 :]:
            if event.level == "error":
                self._lab_state.warn(event.text)
        self._last_event = events[-1]


def add_keys(widgets: Widgets, keys: list[Key]) -> None:
    """Add `keys` to the page, a number key for each preset, and ? for the list of all keys."""
    everything = [*keys, *(_preset_key(widgets.lab_state, number) for number in range(1, NUMBER_KEYS + 1))]
    everything.append(Key("List of all keys", "This list", "?", "shift", lambda event: _show_list(event, everything)))
    for key in everything:
        # "?" is not among the keys in viser's types, but its page takes any key.
        command = widgets.gui.add_command(
            key.label,
            description=key.words,
            hotkey=key.key,  # type: ignore[arg-type]  # As above.
            modifier=key.modifier,  # type: ignore[arg-type]  # As above.
        )
        command.on_trigger(widgets.handler(key.action))


def _preset_key(lab_state: LabState, number: int) -> Key:
    def load(_: Any) -> None:
        names = preset_names()
        if number > len(names):
            raise LabError(f"There is no preset number {number}: the menu has {len(names)}.")
        lab_state.load(load_preset(names[number - 1]), names[number - 1])

    return Key(f"Preset number {number}", "In the order of the menu", str(number), None, load)


def _show_list(event: Any, keys: list[Key]) -> None:
    shown = [key for key in keys if key.key is not None and not key.key.isdecimal()]
    rows = [(escaped(key.shown), escaped(key.label), escaped(key.words)) for key in shown]
    rows.append((f"1 … {NUMBER_KEYS}", "Load a preset", "In the order of the menu"))
    gui = event.client.gui
    with gui.add_modal("Keys") as modal:
        gui.add_html(f'<div class="fl">{table_html(rows)}{MORE}</div>')
        close = gui.add_button("Close")

    async def shut(_: Any) -> None:
        modal.close()

    close.on_click(shut)
