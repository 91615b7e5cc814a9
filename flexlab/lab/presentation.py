"""A browser at a beamer: large type and two large plots, readable from the back of a room."""

import threading

import viser

from flexlab.lab.viser_internals import set_panel_width

PLOTS_WIDTH, PANEL_WIDTH, GUIDE_WIDTH = 560, 420, 380
"""px, in presentation."""

SHEET = """
.uplot-container { zoom: 1.6; }
div:has(> div > .uplot-container):nth-of-type(n + 3), div:has(> .uplot-container):nth-of-type(n + 3) { display: none; }
.fl, .fl p, [role="tab"], label, input, button { font-size: 1.15rem !important; }
.fl-title { font-size: 1.6rem !important; }
.fl-grid { gap: 0.2em 0.75em; }
.viser-label, .fl-float { font-size: 1.3rem; }
"""
"""Over that of the panel."""


class Presentation:
    """Which browsers present. For the server's event loop only."""

    def __init__(self, server: viser.ViserServer, widths: dict[str, tuple[object, float]]):
        """`widths`: name (`plots`, `guide`, `panel`) → panel and its usual width, px."""
        self._widths = widths
        self._sheets: dict[int, viser.GuiHtmlHandle] = {}
        self._lock = threading.Lock()
        server.on_client_disconnect(self._forget)

    def toggle(self, client: viser.ClientHandle) -> None:
        """Begin or end the presentation in one browser."""
        with self._lock:
            sheet = self._sheets.pop(client.client_id, None)
        presents = sheet is None
        if sheet is not None:
            sheet.remove()
        else:
            with self._lock:
                self._sheets[client.client_id] = client.gui.add_html(f"<style>{SHEET}</style>")
        large = {"plots": PLOTS_WIDTH, "guide": GUIDE_WIDTH, "panel": PANEL_WIDTH}
        for name, (panel, usual) in self._widths.items():
            set_panel_width(client, panel, large[name] if presents else usual)

    async def _forget(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._sheets.pop(client.client_id, None)
