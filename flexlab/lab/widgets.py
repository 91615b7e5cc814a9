"""Widgets of viser as the panel uses them: callbacks that show what went wrong as a sentence, and writes of what has changed."""

import time
from collections.abc import Callable, Coroutine
from typing import Any

import viser

from flexlab.errors import FlexlabError
from flexlab.lab.lab_state import BY_PERSON, LabState
from flexlab.text import limited

log = limited(__name__)


def handler(lab_state: LabState, action: Callable[[Any], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
    """A callback for a widget: runs `action(event)` for what a person did, and shows what went wrong as a sentence.

    Events without a client are the server's own writes to the widget, and ask for nothing.
    """

    async def callback(event: Any) -> None:
        if event.client is None:
            return
        lab_state.touched_at = time.monotonic()
        asked = BY_PERSON.set(True)
        try:
            action(event)
        except FlexlabError as error:
            lab_state.say(str(error), "error")
        except Exception as error:
            log.exception("a control failed")
            lab_state.say(f"This control failed ({type(error).__name__}: {error}); the simulation goes on.", "error")
        finally:
            BY_PERSON.reset(asked)

    return callback


def add_button(
    gui: viser.GuiApi,
    lab_state: LabState,
    label: str,
    action: Callable[[Any], None],
    *,
    hint: str | None = None,
    icon: viser.IconName | None = None,
    color: Any = "gray",
    visible: bool = True,
) -> viser.GuiButtonHandle:
    """A button that runs `action(event)`; `color` None: the page's accent."""
    button = gui.add_button(label, icon=icon, color=color, visible=visible, hint=hint)
    button.on_click(handler(lab_state, action))
    return button


def put(widget: Any, **values: Any) -> None:
    """Write what has changed: viser takes 20 µs for every write, even of the value that is there."""
    for name, value in values.items():
        if getattr(widget, name) != value:
            setattr(widget, name, value)
