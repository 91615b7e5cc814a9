"""A browser at a beamer: the scene, one plot and the number that matters, readable from the back of a room."""

import threading

import viser

from flexlab.lab.viser_internals import fold_panel

SHEET = """
[data-dock-region], [data-dock-root] > div[style*="box-shadow"] { visibility: hidden; pointer-events: none; }
#server-bar { display: none !important; }
[data-dock-root] > div:first-child { left: 0 !important; right: 0 !important; }
/* One plot along the upper edge: of the motion that of the deflection, which is the second. */
[data-floating-window] { left: 0.5rem !important; width: calc(100vw - 20rem) !important; height: 26.5rem !important;
  max-width: none !important; }
[data-dock-strip], [data-floating-handle] { display: none !important; }
div:has(> div > .uplot-container):has(> :nth-child(2) .uplot-container) > :not(:nth-child(2)) { display: none; }
div:has(> div > .uplot-container):not(:has(> :nth-child(2) .uplot-container)) > :not(:first-child) { display: none; }
div:has(> div > .uplot-container) { grid-template-columns: 1fr !important; }
.uplot-container { zoom: 1.6; }
.fl-number { display: grid !important; }
.fl-number, .fl-caption, .fl-float { visibility: visible; }
.fl-caption, .fl-float { font-size: 1.6rem; }
"""
"""Over that of the panel."""


class Presentation:
    """Which browsers present."""

    def __init__(self, server: viser.ViserServer, plots: viser.PanelHandle):
        """`plots`: their panel, which the presentation opens."""
        self._plots = plots
        self._sheets: dict[int, viser.GuiHtmlHandle] = {}
        self._lock = threading.Lock()
        server.on_client_disconnect(self._forget)

    def toggle(self, client: viser.ClientHandle) -> None:
        """Begin or end the presentation in one browser."""
        with self._lock:
            sheet = self._sheets.pop(client.client_id, None)
            if sheet is None:
                style = f'<style class="fl-presentation">{SHEET}</style>'
                self._sheets[client.client_id] = client.gui.add_html(style)
        if sheet is not None:
            sheet.remove()
        fold_panel(client, self._plots, sheet is not None)

    async def _forget(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._sheets.pop(client.client_id, None)
