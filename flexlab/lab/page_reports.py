"""Reports from the browsers: the run that they have drawn, the charts on their screen, whether their system is dark."""

import html
import math
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import msgspec
import viser

from flexlab.lab.browser_messages import Count, Identifier
from flexlab.lab.viser_internals import widget_uuid
from flexlab.lab.viser_server import set_theme
from flexlab.lab.widgets import put
from flexlab.text import escaped, limited

PAGE_SCRIPT, PAGE_SHEET = (
    "".join(Path(__file__).with_name(name).read_text(encoding="utf-8") for name in names)
    for names in (("structure.js", "page.js", "accessibility.js", "hear.js", "number_boxes.js"), ("page.css",))
)
"""Script and style sheet that the lab adds to viser's page."""
GUIDE, PLOTS = "guide", "plots"
"""Names of the foldable panels in a page's report."""
PRESENTATION_ENDS = "B or Esc ends the presentation."
LONGEST_SILENCE = 10.0
"""Time after which a browser that never reported counts as one that has drawn everything, s."""
AGAIN_PERIOD = 1.0
"""Least time between two runs that start because the shown preset was chosen again, s: each is a recording."""

log = limited(__name__)
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]


class Report(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A browser's report. `run`: number of the newest run that the page has drawn, or 0.

    `charts`: uuid of each chart on its screen → the part that is zoomed into, as fractions of the window.
    """

    run: Count
    charts: Annotated[dict[Identifier, tuple[Share, Share]], msgspec.Meta(max_length=64)]
    dark: bool
    width: Count
    """Width of the window, px."""
    covered: tuple[Share, Share]
    """Covered fractions of the picture's height, at the top and at the bottom."""
    height: Count
    """Height of the picture, px."""
    open: Annotated[tuple[str, ...], msgspec.Meta(max_length=2)]
    """The panels that this browser last had open outside a presentation: `GUIDE`, `PLOTS`."""
    hears: bool
    """Whether the page's sound is on."""
    again: Count
    """How often the shown preset was chosen again."""


_DECODER = msgspec.json.Decoder(Report)


@dataclass
class _Page:
    way: str
    """uuid of the field in which the page reports."""
    mark: viser.GuiHtmlHandle
    """The element that holds data for this browser alone."""
    since: float = field(default_factory=time.monotonic)
    report: Report | None = None
    said: int = 0
    """Number of sentences given to its screen reader."""
    sentence: str = ""
    """The last of these sentences."""
    presents: bool = False
    """Whether the browser shows the presentation."""

    def show(self) -> None:
        kind = "fl-reports fl-presentation" if self.presents else "fl-reports"
        told = f'data-way="{html.escape(self.way)}" data-count="{self.said}" data-said="{escaped(self.sentence)}"'
        way_out = f'<p class="fl fl-way-out">{PRESENTATION_ENDS}</p>' if self.presents else ""
        put(self.mark, content=f'<i hidden class="{kind}" {told}></i>{way_out}')


class PageReports:
    """The newest report of every browser of one server. Thread-safe."""

    def __init__(
        self,
        server: viser.ViserServer,
        run_number: int,
        name: str,
        arrange: Callable[[viser.ClientHandle, Report], None],
        cover: Callable[[viser.ClientHandle, float, float, int], None],
        start_anew: Callable[[Any], Awaitable[None]],
    ):
        """`arrange` lays out a new page by its first report; `cover` takes the covered fractions of the picture and its height.

        `start_anew` is called when a person chooses the shown preset again.
        """
        self._arrange, self._cover, self._start_anew = arrange, cover, start_anew
        self._began_anew = -math.inf
        self._pages: dict[int, _Page] = {}
        """By client. Pages come and go on other threads, so loops go over copies."""
        self._mark = server.gui.add_html(_mark(run_number, name))
        server.on_client_connect(self._greet)
        server.on_client_disconnect(self._forget)

    def show_run(self, run_number: int, name: str) -> None:
        """Send all pages the number and name of the run that they now show."""
        put(self._mark, content=_mark(run_number, name))

    @property
    def count(self) -> int:
        """Number of connected browsers."""
        return len(self._pages)

    def have_drawn(self, run_number: int) -> bool:
        """Whether any browser has drawn this run."""
        now = time.monotonic()
        return any(
            page.report.run == run_number if page.report is not None else now - page.since > LONGEST_SILENCE
            for page in list(self._pages.values())
        )

    def open_charts(self) -> dict[str, tuple[float, float]] | None:
        """The charts on any screen, with the visible part of the window; None if a page has not reported yet."""
        found: dict[str, tuple[float, float]] = {}
        for page in list(self._pages.values()):
            if page.report is None:
                return None
            for uuid, (first, last) in page.report.charts.items():
                before = found.get(uuid, (first, last))
                found[uuid] = min(first, before[0]), max(last, before[1])
        return found

    @property
    def somebody_hears(self) -> bool:
        """Whether the sound is on in any browser."""
        return any(page.report is not None and page.report.hears for page in list(self._pages.values()))

    def say(self, client: viser.ClientHandle, text: str) -> None:
        """Make one browser's screen reader say a text."""
        page = self._pages.get(client.client_id)
        if page is not None:
            page.said, page.sentence = page.said + 1, text
            page.show()

    def toggle_presentation(self, client: viser.ClientHandle) -> bool:
        """Begin or end the presentation in one browser; returns whether it now shows plots."""
        page = self._pages.get(client.client_id)
        if page is None:
            return False
        page.presents = not page.presents
        page.show()
        return page.presents or (page.report is not None and PLOTS in page.report.open)

    async def _greet(self, client: viser.ClientHandle) -> None:
        # The field belongs to this browser alone: the others need not get its reports.
        way = client.gui.add_text("page", "", visible=False)
        uuid = widget_uuid(way)
        page = _Page(uuid, client.gui.add_html(""))
        page.show()
        self._pages[client.client_id] = page

        async def told(event: Any) -> None:
            try:
                report = _DECODER.decode(way.value)
            except msgspec.MsgspecError as error:
                log.warning("A browser reported what cannot be: %s", ascii(str(error))[:200])
                return
            if report.dark != (page.report.dark if page.report is not None else False):
                set_theme(client.gui, report.dark)
            if page.report is None:
                self._arrange(client, report)
            elif report.again > page.report.again and time.monotonic() - self._began_anew >= AGAIN_PERIOD:
                self._began_anew = time.monotonic()
                await self._start_anew(event)
            self._cover(client, *report.covered, report.height)
            page.report = report

        way.on_update(told)

    async def _forget(self, client: viser.ClientHandle) -> None:
        self._pages.pop(client.client_id, None)


def _mark(run_number: int, name: str) -> str:
    """The element for all pages; its time, s, tells a page how old its picture is."""
    told = f'data-run="{run_number}" data-name="{html.escape(name)}" data-at="{int(time.monotonic())}"'
    return f'<i hidden class="fl-run" {told}></i>'
