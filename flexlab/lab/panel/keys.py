"""Keys and the palette of all commands: what the panel does, without the mouse."""

from collections.abc import Callable
from typing import Any, NamedTuple

import viser

from flexlab.errors import LabError
from flexlab.lab.lab_state import LabState, handler
from flexlab.presets import load_preset, preset_names
from flexlab.text import escaped

NUMBER_KEYS = 9
MORE = (
    "Tab goes from one control to the next; arrows move a slider. "
    "Elsewhere arrows turn the camera, and A, D, W, S, Q, E move it. Ctrl+K opens the palette of commands, Esc closes."
)


class Key(NamedTuple):
    """One command: name, what it does, key, modifier (None: none), action (gets the event)."""

    label: str
    words: str
    key: str | None
    modifier: str | None
    action: Callable[[Any], None]

    @property
    def shown(self) -> str:
        """The key as it is printed on keyboards."""
        names = {"space": "Space", "arrowright": "→", "?": "?"}
        key = names.get(self.key or "", (self.key or "").upper())
        modifier = {None: "", "shift": "" if self.key == "?" else "Shift+", "cmd/ctrl": "Ctrl+"}
        return modifier.get(self.modifier, "Ctrl+Shift+") + key


def add_keys(gui: viser.GuiApi, lab_state: LabState, keys: list[Key]) -> None:
    """Give the page keys for `keys`, the presets by number, and ? for the list of all."""
    everything = [*keys, *(_preset_key(lab_state, number) for number in range(1, NUMBER_KEYS + 1))]
    everything.append(Key("List of all keys", "This list", "?", "shift", lambda event: _show_list(event, everything)))
    for key in everything:
        # "?" is not among the keys that viser names, but its page takes any key.
        command = gui.add_command(
            key.label,
            description=key.words,
            hotkey=key.key,  # type: ignore[arg-type]  # As above.
            modifier=key.modifier,  # type: ignore[arg-type]  # As above.
        )
        command.on_trigger(handler(lab_state, key.action))


def _preset_key(lab_state: LabState, number: int) -> Key:
    def load(_: Any) -> None:
        names = preset_names()
        if number > len(names):
            raise LabError(f"There is no preset number {number}: the menu has {len(names)}.")
        lab_state.load(load_preset(names[number - 1]), names[number - 1])

    return Key(f"Preset number {number}", "In the order of the menu", str(number), None, load)


def _show_list(event: Any, keys: list[Key]) -> None:
    rows = "".join(
        f"<tr><td>{escaped(key.shown)}</td><td>{escaped(key.label)}</td><td>{escaped(key.words)}</td></tr>"
        for key in keys
        if key.key is not None and not key.key.isdecimal()
    )
    rows += f"<tr><td>1 … {NUMBER_KEYS}</td><td>Load a preset</td><td>In the order of the menu</td></tr>"
    gui = event.client.gui
    with gui.add_modal("Keys") as modal:
        gui.add_html(f'<div class="fl"><table class="fl-table">{rows}</table>{MORE}</div>')
        close = gui.add_button("Close")

    async def shut(_: Any) -> None:
        modal.close()

    close.on_click(shut)
