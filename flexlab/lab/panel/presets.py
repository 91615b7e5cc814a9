"""The preset menu, with the title and what to watch."""

import viser

from flexlab.lab.desk import Desk, handler
from flexlab.lab.panel.text import escaped
from flexlab.presets import load_preset, preset_names
from flexlab.sim.snapshot import Snapshot


class Presets:
    """A menu of presets, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, desk: Desk):
        self._desk = desk
        names = tuple(preset_names())
        present = desk.snapshot.name
        options = names if present in names else (present, *names)
        self._menu = gui.add_dropdown("Preset", options, initial_value=present, hint="Starts a new run")
        self._text = gui.add_html("")
        self._menu.on_update(handler(desk, lambda _: self._load(self._menu.value)))

    def show(self, snapshot: Snapshot) -> None:
        """Show which preset the run came from, and its words."""
        if snapshot.name in self._menu.options:
            self._menu.value = snapshot.name
        title, watch = snapshot.scenario.title, snapshot.scenario.watch
        words = f'<div class="fl-title">{escaped(title)}</div>' if title else ""
        self._text.content = f'<div class="fl">{words}{escaped(watch)}</div>'

    def _load(self, name: str) -> None:
        self._desk.load(load_preset(name), name)
