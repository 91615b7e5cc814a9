"""The preset menu, with the title and what to watch."""

import viser

from flexlab.lab.lab_state import LabState, handler
from flexlab.lab.panel.number_control import put
from flexlab.lab.panel.run_comparison import told_html
from flexlab.lab.panel.text import escaped
from flexlab.plain_text import with_units
from flexlab.presets import load_preset, preset_names

MOST_CHANGES = 4
"""Changes named below the menu; the tab File has all."""


class Presets:
    """A menu of presets, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState):
        self._lab_state = lab_state
        names = tuple(preset_names())
        present = lab_state.snapshot.name
        options = names if present in names else (present, *names)
        # The page's script finds the menu by this mark: choosing the shown preset once more starts it anew.
        gui.add_html('<i hidden class="fl-preset"></i>')
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
        baseline, now = self._lab_state.baseline, self._lab_state.intended
        if not self._lab_state.changed:
            head = f'<h2 class="fl-title">{escaped(baseline.title or self._lab_state.name)}</h2>'
            put(self._text, content=f'<div class="fl">{head}{escaped(with_units(baseline.watch))}</div>')
            return
        # What the preset's words promise is no longer what runs.
        words = [f"{title}: {old} → {new}" for title, old, new in told_html(baseline, now)]
        more = f"<br>… and {len(words) - MOST_CHANGES} more" if len(words) > MOST_CHANGES else ""
        head = f'<h2 class="fl-title">{escaped(self._lab_state.name)}, changed <span class="fl-badge">not saved</span></h2>'
        put(self._text, content=f'<div class="fl">{head}{"<br>".join(words[:MOST_CHANGES])}{more}</div>')

    def _load(self, name: str) -> None:
        self._lab_state.load(load_preset(name), name)
