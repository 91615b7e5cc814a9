"""Stands between browsers and viser's widgets: what is not a plausible new value of a widget goes no further.

viser writes whatever a browser sends into its own state, names of attributes included, and hands it to all other browsers
before any callback can look at it. So the check must come before viser's own handler.
"""

import logging
import math
from typing import Any

import viser
from viser import _messages

from flexlab.lab.lab_state import LabState

LONGEST_INPUT = 10_000
"""Characters of a text that a browser may send into a widget."""
LARGEST_UPLOAD = 1_000_000
"""Bytes of a file that a browser may send: a scenario has a few thousand."""

log = logging.getLogger(__name__)


def guard_inputs(server: viser.ViserServer, lab_state: LabState) -> None:
    """Refuse widget updates and uploads that are not plausible, with a sentence on the screen."""
    interface, gui = server._websock_server, server.gui
    update, start_upload = gui._handle_gui_updates, gui._handle_file_transfer_start
    interface.unregister_handler(_messages.GuiUpdateMessage, update)
    interface.unregister_handler(_messages.FileTransferStartUpload, start_upload)

    async def guarded_update(client_id: Any, message: Any) -> None:
        handle = gui._gui_input_handle_from_uuid.get(message.uuid)
        if handle is None:
            return
        problem = _problem(handle, message.updates)
        if problem:
            lab_state.say(problem, "error")
            _show_truth(handle, message)
            return
        await update(client_id, message)

    def guarded_upload(client_id: Any, message: Any) -> None:
        size = message.size_bytes
        if not isinstance(size, int) or not 0 <= size <= LARGEST_UPLOAD:
            lab_state.say(f"This file has {size} bytes, over {LARGEST_UPLOAD}: that is not a scenario file.", "error")
            return
        start_upload(client_id, message)

    interface.register_handler(_messages.GuiUpdateMessage, guarded_update)
    interface.register_handler(_messages.FileTransferStartUpload, guarded_upload)


def _problem(handle: Any, updates: Any) -> str:
    """Why an update cannot be meant, as a sentence; empty if it can."""
    label = getattr(handle._impl.props, "label", "") or "this control"
    if not isinstance(updates, dict) or set(updates) != {"value"}:
        return f"{label}: the browser sent something that is not a value. Nothing was changed."
    present, new = handle._impl.value, updates["value"]
    kept = "Nothing was changed."
    if isinstance(present, bool) or handle._impl.is_button:
        return "" if isinstance(new, bool) else f"{label}: needs on or off. {kept}"
    if isinstance(present, (int, float)):
        return _number_problem(label, new, kept)
    if isinstance(present, tuple):
        if not isinstance(new, (list, tuple)) or len(new) != len(present):
            return f"{label}: needs {len(present)} numbers. {kept}"
        return next((problem for item in new if (problem := _number_problem(label, item, kept))), "")
    if isinstance(present, str):
        if not isinstance(new, str):
            return f"{label}: needs a text. {kept}"
        if len(new) > LONGEST_INPUT:
            return f"{label}: a text of {len(new)} characters is too long, at most {LONGEST_INPUT}. {kept}"
        options = getattr(handle._impl.props, "options", None)
        if options is not None and new not in options:
            return f"{label}: {new[:40]!r} is not one of its options: choose one from the menu. {kept}"
        return ""
    return f"{label}: cannot be changed from the browser. {kept}"


def _number_problem(label: str, new: Any, kept: str) -> str:
    if isinstance(new, bool) or not isinstance(new, (int, float)) or not math.isfinite(new):
        shown = "text" if isinstance(new, str) else "NaN or infinite" if isinstance(new, float) else type(new).__name__
        return f"{label}: needs a finite number, not {shown}. {kept}"
    return ""


def _show_truth(handle: Any, message: Any) -> None:
    """Put the refused value right in the browser that sent it."""
    if isinstance(message.updates, dict) and "value" in message.updates:
        truth = {"value": handle._impl.value}
        handle._impl.gui_api._websock_interface.queue_message(_messages.GuiUpdateMessage(message.uuid, truth))
