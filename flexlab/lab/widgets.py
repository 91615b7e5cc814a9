"""viser's widgets as the panel uses them: callbacks that show errors as sentences, and writes only of changed values."""

import time
from collections.abc import Callable, Coroutine, Iterable, Sequence
from typing import Any

import viser

from flexlab.errors import LabError, telling
from flexlab.lab.lab_state import BY_PERSON, LabState

LAST = 1e12
"""viser's rank of a widget that stays below those that come later."""


class Widgets:
    """Makes widgets, in the open GUI container, whose callbacks show errors as sentences."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState):
        self.gui, self.lab_state = gui, lab_state

    def handler(self, action: Callable[[Any], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
        """A callback that runs `action(event)` for a person's input, and shows an error as a sentence.

        It ignores events without a client, which are the server's own writes to the widget.
        """

        async def callback(event: Any) -> None:
            if event.client is None:
                return
            self.lab_state.touched_at = time.monotonic()
            asked = BY_PERSON.set(True)
            try:
                with telling(self.lab_state.warn, "This control failed ({}); the simulation goes on."):
                    action(event)
            finally:
                BY_PERSON.reset(asked)

        return callback

    def button(
        self,
        label: str,
        action: Callable[[Any], None],
        *,
        hint: str | None = None,
        icon: viser.IconName | None = None,
        color: Any = "gray",
        visible: bool = True,
    ) -> viser.GuiButtonHandle:
        """A button that runs `action(event)`; `color` None for the page's accent colour."""
        button = self.gui.add_button(label, icon=icon, color=color, visible=visible, hint=hint)
        button.on_click(self.handler(action))
        return button

    def checkbox(
        self, label: str, value: bool, action: Callable[[bool], None], hint: str | None = None
    ) -> viser.GuiCheckboxHandle:
        """A switch that runs `action` with its new value."""
        box = self.gui.add_checkbox(label, value, hint=hint)
        box.on_update(self.handler(lambda _: action(bool(box.value))))
        return box


class Menu:
    """A menu of words, made in the open GUI container."""

    def __init__(
        self,
        widgets: Widgets,
        label: str,
        options: Callable[[], Iterable[str]],
        shown: Callable[[], str],
        choose: Callable[[str], object],
        *,
        hint: str | None = None,
    ):
        """`options` returns the present words, `shown` the word to show now; `choose` gets the word that a person chose."""
        self._label, self._options, self._shown, self._choose = label, options, shown, choose
        self.widget = widgets.gui.add_dropdown(label, tuple(options()), hint=hint)
        self.widget.on_update(widgets.handler(lambda _: self._ask(self.widget.value)))
        self.settle()

    def settle(self, at_once: bool = False) -> None:
        """Update the options, to which a file may add one, and the shown word."""
        options, shown = tuple(self._options()), self._shown()
        put(self.widget, options=options)
        if shown in options:
            put(self.widget, value=shown)

    def remove(self) -> None:
        """Remove the menu from the screen."""
        self.widget.remove()

    def _ask(self, word: str) -> None:
        try:
            if word not in self._options():
                raise LabError(f"{word[:40]!r} is not an option of {self._label}: choose one from the menu.")
            self._choose(word)
        finally:
            # A refused word is not text to edit: the menu shows the true choice at once.
            self.settle()


def table_html(rows: Iterable[Sequence[str]], *heads: str, numbers: Sequence[int] = ()) -> str:
    """A table of cells and heads that are already HTML; `numbers`: the columns that are aligned at the right."""

    def line(kind: str, cells: Sequence[str]) -> str:
        marks = (' class="fl-figure"' if k in numbers else "" for k in range(len(cells)))
        return "".join(f"<{kind}{mark}>{cell}</{kind}>" for mark, cell in zip(marks, cells, strict=True))

    lines = [line("th", heads), *(line("td", row) for row in rows)]
    return f'<table class="fl-table">{"".join(f"<tr>{one}</tr>" for one in lines if one)}</table>'


def put(widget: Any, **values: Any) -> None:
    """Write the values that have changed: viser takes 20 µs for every write, even of an equal value."""
    for name, value in values.items():
        if getattr(widget, name) != value:
            setattr(widget, name, value)
