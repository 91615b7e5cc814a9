"""A browser at a beamer: large type and two large plots, readable from the back of a room."""

import threading
from collections.abc import Callable

import viser

from flexlab.lab.viser_internals import set_panel_width

LARGER = 1.4
"""Widths of panels in presentation, relative to the usual ones."""

SHEET = """
.uplot-container { zoom: 1.6; }
div:has(> div > .uplot-container):nth-of-type(n + 3), div:has(> .uplot-container):nth-of-type(n + 3) { display: none; }
.fl, .fl p, label, input, button[data-block] { font-size: 1.15rem !important; }
[role="tab"] { font-size: 1.1rem !important; }
.mantine-Text-root { --text-fz: 1.15rem !important; }
.mantine-List-root { --list-fz: 1.15rem !important; }
.fl-title { font-size: 1.6rem !important; }
.fl-grid { gap: 0.2em 0.75em; }
.fl-float { font-size: 1.3rem; }
"""
"""Over that of the panel."""


class Presentation:
    """Which browsers present."""

    def __init__(
        self,
        server: viser.ViserServer,
        plots: viser.PanelHandle,
        widths: Callable[[viser.ClientHandle], tuple[float, float]],
    ):
        """`plots`: their panel; `widths`: in a browser usual ones of all that is left, and right, of the picture, px."""
        self._server, self._plots, self._widths = server, plots, widths
        self._sheets: dict[int, viser.GuiHtmlHandle] = {}
        self._lock = threading.Lock()
        server.on_client_disconnect(self._forget)

    def toggle(self, client: viser.ClientHandle) -> None:
        """Begin or end the presentation in one browser."""
        with self._lock:
            sheet = self._sheets.pop(client.client_id, None)
            begins = sheet is None
            if begins:
                self._sheets[client.client_id] = client.gui.add_html(f"<style>{SHEET}</style>")
        if sheet is not None:
            sheet.remove()
        left, right = (LARGER * width if begins else width for width in self._widths(client))
        set_panel_width(client, self._plots, left)
        set_panel_width(client, self._server.gui.main_panel, right)

    async def _forget(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._sheets.pop(client.client_id, None)
