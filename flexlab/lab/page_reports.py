"""What browsers tell of themselves: which run they have drawn, which charts they show, whether their system is dark."""

import html
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import viser

from flexlab.lab.browser_messages import Count, Identifier
from flexlab.lab.panel.number_control import put
from flexlab.lab.viser_internals import widget_uuid
from flexlab.lab.viser_server import set_theme
from flexlab.log_limits import limited
from flexlab.text import escaped

PAGE_SCRIPT = "".join(
    Path(__file__).with_name(name).read_text(encoding="utf-8")
    for name in ("page.js", "accessibility.js", "hear.js", "number_boxes.js")
)
"""What a page needs to tell it, and what viser's page lacks for keyboards and screen readers."""
LONGEST_SILENCE = 10.0
"""s after which a browser that never told anything counts as one that sees whatever it is sent."""
AGAIN_PERIOD = 1.0
"""s between two runs that a preset chosen once more begins, whichever browsers ask: each is a recording."""

log = limited(__name__)


Share = Annotated[float, msgspec.Meta(ge=0, le=1)]


class Report(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`run`: number of the newest run that the page has drawn, 0: none.

    `charts`: uuid of those on its screen → the part that is zoomed into, as shares of the window.
    """

    run: Count
    charts: Annotated[dict[Identifier, tuple[Share, Share]], msgspec.Meta(max_length=64)]
    dark: bool
    width: Count
    """Of the window, px."""
    covered: tuple[Share, Share]
    """Of the picture's height, by what lies over it: from above and from below."""
    open: Annotated[tuple[str, ...], msgspec.Meta(max_length=2)]
    """Names of the panels that this browser last had open, of `guide` and `plots`."""
    hears: bool
    """Whether somebody wants to hear the beam."""
    again: Count
    """How often the preset that is shown was chosen once more."""


_DECODER = msgspec.json.Decoder(Report)


@dataclass
class _Page:
    """One browser."""

    way: str
    """uuid of the field in which it reports."""
    mark: viser.GuiHtmlHandle
    """What is told to it alone."""
    since: float = field(default_factory=time.monotonic)
    report: Report | None = None
    said: int = 0
    """Sentences that were said to it."""


class PageReports:
    """The newest report of every browser of one server. Any thread."""

    def __init__(
        self,
        server: viser.ViserServer,
        run_number: int,
        name: str,
        arrange: Callable[[viser.ClientHandle, Report], None],
        cover: Callable[[viser.ClientHandle, float, float], None],
        start_anew: Callable[[], None],
    ):
        """`arrange` lays out a new page by its first report; `cover` is told what lies over the picture.

        `start_anew` loads the preset that is shown.
        """
        self._arrange, self._cover, self._start_anew = arrange, cover, start_anew
        self._began_anew = -math.inf
        self._pages: dict[int, _Page] = {}
        self._lock = threading.Lock()
        self._mark = server.gui.add_html(_mark(run_number, name))
        server.on_client_connect(self._greet)
        server.on_client_disconnect(self._forget)

    def show_run(self, run_number: int, name: str) -> None:
        """Tell the pages which run it is that they have just been sent, and what it is called."""
        put(self._mark, content=_mark(run_number, name))

    @property
    def count(self) -> int:
        """Browsers that look."""
        return len(self._pages)

    def have_drawn(self, run_number: int) -> bool:
        """Whether somebody can see a run."""
        now = time.monotonic()
        return any(
            page.report.run == run_number if page.report is not None else now - page.since > LONGEST_SILENCE
            for page in self._all()
        )

    def open_charts(self) -> dict[str, tuple[float, float]] | None:
        """The charts that somebody has on the screen, and the part of the window that is seen.

        None: perhaps all charts, as not every page has told.
        """
        found: dict[str, tuple[float, float]] = {}
        for page in self._all():
            if page.report is None:
                return None
            for uuid, (first, last) in page.report.charts.items():
                before = found.get(uuid, (first, last))
                found[uuid] = min(first, before[0]), max(last, before[1])
        return found

    @property
    def somebody_hears(self) -> bool:
        """Whether a page wants to hear the beam."""
        return any(page.report is not None and page.report.hears for page in self._all())

    def say(self, client: viser.ClientHandle, text: str) -> None:
        """Have one browser's screen reader say a text."""
        page = self._pages.get(client.client_id)
        if page is not None:
            page.said += 1
            page.mark.content = _own_mark(page.way, page.said, text)

    def _all(self) -> list[_Page]:
        with self._lock:
            return list(self._pages.values())

    async def _greet(self, client: viser.ClientHandle) -> None:
        # Of this browser alone: what one tells is no news for the others.
        way = client.gui.add_text("page", "", visible=False)
        uuid = widget_uuid(way)
        page = _Page(uuid, client.gui.add_html(_own_mark(uuid, 0, "")))
        with self._lock:
            self._pages[client.client_id] = page

        async def told(_: object) -> None:
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
                self._start_anew()
            self._cover(client, *report.covered)
            page.report = report

        way.on_update(told)

    async def _forget(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._pages.pop(client.client_id, None)


def _own_mark(way: str, said: int, text: str) -> str:
    return f'<i hidden class="fl-reports" data-way="{html.escape(way)}" data-count="{said}" data-said="{escaped(text)}"></i>'


def _mark(run_number: int, name: str) -> str:
    """What all pages are told; its time, s, shows a page how old its picture is."""
    told = f'data-run="{run_number}" data-name="{html.escape(name)}" data-at="{int(time.monotonic())}"'
    return f'<i hidden class="fl-run" {told}></i>'
