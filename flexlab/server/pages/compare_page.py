"""`/compare?run=…&run=…`: runs side by side, in tables and as curves laid over each other."""

import asyncio
from collections.abc import Sequence

from aiohttp import hdrs, web

from flexlab.analysis.comparison import difference_text
from flexlab.errors import FlexlabError, RecordingError
from flexlab.recording.overlay import MOST_RUNS, run_label
from flexlab.recording.store.run_files import SUFFIX
from flexlab.recording.store.run_index import RunRow, duration_text, find_row
from flexlab.server.auth import COMPARISON, WITH_A_PASS, is_opened_by_person, recording_address, refuse
from flexlab.server.pages.layout import message, page
from flexlab.server.pages.markup import Markup, fill, join
from flexlab.server.pages.page_context import context_of
from flexlab.server.run_jobs import ComparisonTables

ALL_RUNS = Markup('<a class="button" href="/runs">All runs</a>')

COMPARISON_PAGE = """<div class="side">
<h1>Comparison</h1>
<ul class="compared">
{runs}
</ul>
<h2>Metrics <small>{window}</small></h2>
{metrics}
<h2>Settings</h2>
{settings}
</div>
<div class="beside">
<noscript><p>Rerun's viewer needs JavaScript.</p></noscript>
<iframe id="viewer" title="The runs laid over each other in rerun's viewer" data-recording="{address}" allowfullscreen></iframe>
</div>"""
RUN = """<li><b>{label}</b> <a href="/runs/{place}">{preset}</a> <span>{started} · {duration}</span></li>"""
TABLE = """<div class="table"><table><thead><tr><th></th>{head}</tr></thead><tbody>
{rows}
</tbody></table></div>"""
SAME = Markup("<p>All these runs started from the same settings.</p>")
LONGEST_VALUE = 60
"""Characters of a setting that stand in the table; the whole of it is in the cell's title."""


def add_compare_pages(router: web.UrlDispatcher) -> None:
    """Routes of comparisons."""
    router.add_get("/compare", comparison)
    router.add_get(f"/{COMPARISON}{{key}}{SUFFIX}", overlay)
    router.add_get(f"{WITH_A_PASS}{{pass}}/{COMPARISON}{{key}}{SUFFIX}", overlay)


async def comparison(request: web.Request) -> web.Response:
    """The runs that the address names."""
    if not is_opened_by_person(request):
        return refuse(request, 403, "A comparison must be opened by a person, not from inside another page.")
    context = context_of(request)
    names = list(dict.fromkeys(request.query.getall("run", [])))
    if not 2 <= len(names) <= MOST_RUNS:
        said = f"Choose 2 to {MOST_RUNS} runs to compare: this address names {len(names)}."
        return message("Nothing to compare", said, 400, ALL_RUNS)
    try:
        rows = [await asyncio.to_thread(find_row, context.settings.logs, name) for name in names]
    except RecordingError as error:
        return message("No such run", str(error), 404, ALL_RUNS)
    try:
        if odd := next((row.problem for row in rows if row.problem), ""):
            raise RecordingError(odd)
        key, tables = await context.comparisons.get(rows)
    except FlexlabError as error:
        return message("These runs cannot be compared", str(error), 422, ALL_RUNS)
    body = _body(rows, tables, recording_address(context, COMPARISON + key))
    script = Markup('<script src="/static/review.js" defer></script>')
    return page("Comparison", body, here="/runs", kind="compare", head=script)


def _body(rows: Sequence[RunRow], tables: ComparisonTables, address: str) -> Markup:
    runs = join(
        fill(RUN, label=run_label(number), place=row.address, preset=row.preset, started=f"{row.started:%Y-%m-%d %H:%M:%S}",
             duration=duration_text(row.duration))
        for number, row in enumerate(rows)
    )  # fmt: skip
    settings = _settings(rows, tables) if tables.settings else SAME
    return fill(
        COMPARISON_PAGE,
        runs=runs,
        window=tables.window,
        metrics=_metrics(rows, tables),
        settings=settings,
        address=address,
    )


def _metrics(rows: Sequence[RunRow], tables: ComparisonTables) -> Markup:
    labels = [run_label(number) for number in range(len(rows))]
    lines = []
    for metric in tables.metrics:
        first = metric[0]
        differences = [difference_text(first, row).replace("-", "−") for row in metric[1:]]
        lines.append((first.key, [*(row.text for row in metric), *differences]))
    return _table([*labels, *(f"{label} − A" for label in labels[1:])], lines, "number")


def _settings(rows: Sequence[RunRow], tables: ComparisonTables) -> Markup:
    labels = [run_label(number) for number in range(len(rows))]
    return _table(labels, [(row.title, row.values) for row in tables.settings], "number")


def _table(heads: Sequence[str], lines: Sequence[tuple[str, Sequence[str]]], kind: str) -> Markup:
    head = join(fill('<th class="number">{head}</th>', head=head) for head in heads)
    rows = join(
        fill(
            '<tr><th scope="row">{title}</th>{cells}</tr>',
            title=title,
            cells=join(
                fill(
                    '<td class="{kind}" title="{whole}">{value}</td>',
                    kind=kind,
                    whole=value if len(value) > LONGEST_VALUE else "",
                    value=value if len(value) <= LONGEST_VALUE else value[:LONGEST_VALUE] + "…",
                )
                for value in values
            ),
        )
        for title, values in lines
    )
    return fill(TABLE, head=head, rows=rows)


async def overlay(request: web.Request) -> web.StreamResponse:
    """The file that the viewer loads."""
    path = context_of(request).comparisons.file(request.match_info["key"])
    if path is None or not path.exists():
        raise web.HTTPNotFound
    return web.FileResponse(
        path, headers={hdrs.CONTENT_TYPE: "application/octet-stream", hdrs.CACHE_CONTROL: "no-cache"}
    )
