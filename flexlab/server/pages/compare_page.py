"""`/compare?run=…&run=…`: runs compared side by side, in tables and as overlaid curves."""

from typing import Any

from aiohttp import web

from flexlab.analysis.comparison import BETWEEN
from flexlab.errors import FlexlabError, RecordingError
from flexlab.recording.overlay import MOST_RUNS, run_label
from flexlab.recording.store.run_files import SUFFIX
from flexlab.server import run_jobs
from flexlab.server.auth import COMPARISON, WITH_A_PASS, has_pass, is_opened_by_person, recording_address, refuse
from flexlab.server.pages import ALL_RUNS, message, page
from flexlab.server.run_jobs import OVERLAY, ComparisonTables
from flexlab.server.visitors import context_of, file_answer, is_teacher, runs_named, told, visitor_of, with_names

ROUTES = web.RouteTableDef()

INCOMPARABLE = "These runs cannot be compared"

LONGEST_VALUE = 200
"""Most characters of a setting in the table; the cell's title has all of it."""


@ROUTES.get("/compare")
async def comparison(request: web.Request) -> web.Response:
    """The page that compares the runs named by the address: its progress, or its results.

    The address also names the comparison, because a run that is being recorded has grown by the time the comparison is ready.
    """
    if not is_opened_by_person(request):
        return refuse(request, 403, "A comparison must be opened by a person, not from inside another page.")
    context = context_of(request)
    names = list(dict.fromkeys(request.query.getall("run", [])))
    if not 2 <= len(names) <= MOST_RUNS:
        said = f"Choose 2 to {MOST_RUNS} runs to compare: this address names {len(names)}."
        return message("Nothing to compare", said, 400, ALL_RUNS)
    rows = await runs_named(request, names)
    task = context.comparisons.get(request.query.get("of", ""))
    if task is None or task.about != tuple(row.id for row in rows):
        try:
            if odd := next((row.problem for row in rows if row.problem), ""):
                raise RecordingError(odd)
            task = run_jobs.comparison(context.comparisons, visitor_of(request), rows)
        except FlexlabError as error:
            return message(INCOMPARABLE, str(error), 422, ALL_RUNS)
        raise web.HTTPSeeOther(str(request.rel_url.with_query([*(("run", name) for name in names), ("of", task.key)])))
    rows = await with_names(request, rows)
    labels = [run_label(number) for number in range(len(rows))]
    values: dict[str, Any] = {"here": "/runs", "task": task, "rows": rows, "labels": labels}
    if task.working:
        return page("compare.html", "Comparison", **values)
    if task.result is None:
        return message(INCOMPARABLE, task.sentence, 422, ALL_RUNS)
    tables: ComparisonTables = task.result
    return page(
        "compare.html",
        "Comparison",
        kind="compare",
        measured=[label for label, row in zip(labels, rows, strict=True) if row.is_measured],
        longest=LONGEST_VALUE,
        between=BETWEEN,
        address=recording_address(context, COMPARISON + task.key),
        **values,
        **tables._asdict(),
    )


@ROUTES.get("/compare/{key}/state")
async def state(request: web.Request) -> web.Response:
    """A comparison's progress, for the script in its page."""
    task = context_of(request).comparisons.get(request.match_info["key"])
    if task is None:
        raise web.HTTPNotFound
    await runs_named(request, task.about)
    return told(task)


@ROUTES.get(f"/{COMPARISON}{{key}}{SUFFIX}")
@ROUTES.get(f"{WITH_A_PASS}{{pass}}/{COMPARISON}{{key}}{SUFFIX}")
async def overlay(request: web.Request) -> web.StreamResponse:
    """The overlay's file, which the viewer loads."""
    if not has_pass(request) and not is_teacher(request):
        raise web.HTTPNotFound
    task = context_of(request).comparisons.get(request.match_info["key"])
    if task is None or task.result is None:
        raise web.HTTPNotFound
    return file_answer(task.folder / OVERLAY)
