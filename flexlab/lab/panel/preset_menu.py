"""The preset menu, with the title and what to watch."""

import viser

from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.panel.text import escaped
from flexlab.presets import load_preset, preset_names


class Presets:
    """A menu of presets, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState):
        self._lab_state = lab_state
        names = tuple(preset_names())
        present = lab_state.snapshot.name
        options = names if present in names else (present, *names)
        self._menu = gui.add_dropdown("Preset", options, initial_value=present, hint="Starts a new run")
        self._text = gui.add_html("")
        self._menu.on_update(handler(lab_state, lambda _: self._load(self._menu.value)))

    def refresh(self) -> None:
        """Offer the presets that there are now, and show which one the scenario came from."""
        names, present = tuple(preset_names()), self._lab_state.name
        options = names if present in names else (present, *names)
        if options != tuple(self._menu.options):
            self._menu.options = options
        if self._menu.value != present:
            self._menu.value = present

    def update(self) -> None:
        """Show which preset the scenario came from, its words, and whether it has been changed."""
        self.refresh()
        title, watch = self._lab_state.baseline.title, self._lab_state.baseline.watch
        mark = ' <span class="fl-badge">changed, not saved</span>' if self._lab_state.changed else ""
        head = f'<div class="fl-title">{escaped(title or self._lab_state.name)}{mark}</div>'
        self._text.content = f'<div class="fl">{head}{escaped(watch)}</div>'

    def _load(self, name: str) -> None:
        self._lab_state.load(load_preset(name), name)
