"""`/studies`: sweeps and tunings of the lab's scenario or of a preset; `/studies/<id>`: one of them, live and when it is done."""

import asyncio
from collections.abc import Iterable
from itertools import groupby
from typing import Any

from aiohttp import hdrs, web

from flexlab.analysis.sweep.axes import VariedField, varied_choices, varied_fields
from flexlab.analysis.sweep.figures import metric_column
from flexlab.errors import FlexlabError, LabError
from flexlab.plain_text import visible
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.scenario.choices import TITLES
from flexlab.server.auth import is_opened_by_person, refuse
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.study_form import LONGEST_RUN, MOST_CANDIDATES, MOST_CELLS, metric_columns, read_wish
from flexlab.server.pages.templating import button, message, page
from flexlab.server.scenario_links import decode_scenario, encode_scenario, scenario_path
from flexlab.server.studies import Study, SweepWish, TuningWish
from flexlab.server.visitors import asker_of, keep_visitor, known_visitor_of, visitor_of

FROM_LAB = "lab"
"""What `?from=` says for the lab's present scenario."""
USUAL = ("payload.bending_stiffness", "controller.feedback_gain")
"""Fields that a form proposes, where the scenario has them."""
ALL_STUDIES = button("/studies", "Studies")
NO_STUDY = "There is no such study: a server keeps the last few, as long as it runs."


def add_study_pages(router: web.UrlDispatcher) -> None:
    """Routes of studies."""
    router.add_get("/studies", studies)
    router.add_post("/studies", start)
    router.add_get("/studies/{study}", study_page)
    router.add_get("/studies/{study}/state", state)
    router.add_get("/studies/{study}/data", data)
    router.add_get("/studies/{study}/cells.parquet", table)
    router.add_get("/studies/{study}/cells/{cell}", cell)
    router.add_post("/studies/{study}/cancel", cancel)


def _visitor(request: web.Request) -> str:
    """Whose studies these are; all visitors of a shared lab share them as well."""
    context = context_of(request)
    return visitor_of(request).id if context.places.is_private else ""


async def studies(request: web.Request) -> web.Response:
    """The forms, about the lab's scenario or a preset, and what was studied."""
    context = context_of(request)
    cards = await context.preset_cards.look(())
    presets = [(card.name, card.scenario.title or card.name) for card in cards if card.scenario is not None]
    lab = _lab_scenario(request)
    chosen = request.query.get("from", FROM_LAB)
    if chosen == FROM_LAB and lab is None:
        chosen = presets[0][0] if presets else ""
    try:
        name, scenario = lab if chosen == FROM_LAB and lab is not None else await asyncio.to_thread(_preset, chosen)
    except FlexlabError as error:
        return message("No such scenario", str(error), 404, ALL_STUDIES)
    fields = varied_fields(scenario)
    paths = [item.path for item in fields]
    return page(
        "studies.html",
        "Studies",
        here="/studies",
        kind="studies",
        scripts=("studies",),
        sources=[*([(FROM_LAB, f"the lab as it is now: {lab[1].title or lab[0]}")] if lab else []), *presets],
        chosen=chosen,
        name=name,
        word=encode_scenario(scenario),
        groups=[(part, list(items)) for part, items in groupby(fields, key=lambda item: item.part)],
        proposed=[_proposed(fields, path) for path in (*[path for path in USUAL if path in paths], "", "")[:2]],
        choices=varied_choices(scenario),
        metrics=metric_columns(),
        most_cells=MOST_CELLS,
        most_candidates=MOST_CANDIDATES,
        longest=LONGEST_RUN,
        studies=[_row(study) for study in context.studies.of(_visitor(request))],
    )


def _lab_scenario(request: web.Request) -> tuple[str, Scenario] | None:
    """(name, scenario) of the visitor's lab as it is now."""
    context = context_of(request)
    place = context.places.of_visitor(visitor_of(request).id)
    if place is None:
        return None
    status = place.status()
    return (status.name, decode_scenario(status.link)) if status.link else None


def _preset(name: str) -> tuple[str, Scenario]:
    return name, load_preset(name)


def _proposed(fields: Iterable[VariedField], path: str) -> VariedField | None:
    return next((item for item in fields if item.path == path), None)


def _row(study: Study) -> dict[str, Any]:
    """A study in a list, in words."""
    about = study.wish.scenario
    return {
        "address": f"/studies/{study.id}",
        "kind": study.wish.kind,
        "title": about.title or study.name,
        "axes": " × ".join(_axis_title(study, path) for path in (axis.path for axis in study.wish.axes)),
        "sentence": study.sentence,
    }


def _axis_title(study: Study, path: str) -> str:
    if path in TITLES:
        return TITLES[path]
    try:
        return study.wish.scenario.about(path).title
    except FlexlabError:
        return path


async def start(request: web.Request) -> web.Response:
    """Begin what a form asks for."""
    form = await request.post()
    context = context_of(request)
    try:
        scenario = decode_scenario(str(form.get("scenario", "")))
        wish = await asyncio.to_thread(read_wish, form, scenario)
        visitor = known_visitor_of(request)
        mine = visitor.id if context.places.is_private else ""
        study = context.studies.start(asker_of(request), mine, visible(form.get("name", ""), 80), wish)
    except LabError as error:
        return message("Not now", str(error), 503, ALL_STUDIES)
    except FlexlabError as error:
        return message("This cannot be studied", str(error), 422, ALL_STUDIES)
    answer = web.Response(status=303, headers={hdrs.LOCATION: f"/studies/{study.id}"})
    if context.places.is_private:
        keep_visitor(request, answer, visitor)
    return answer


def _study(request: web.Request) -> Study:
    """The study that the address names. Raises `LabError`."""
    study = context_of(request).studies.get(request.match_info["study"])
    if study is None:
        raise LabError(NO_STUDY)
    return study


async def study_page(request: web.Request) -> web.Response:
    """A study: how far it is, or what it found."""
    try:
        study = _study(request)
    except LabError as error:
        return message("No such study", str(error), 404, ALL_STUDIES)
    values: dict[str, Any] = {
        "study": study,
        "row": _row(study),
        "lab": scenario_path(encode_scenario(study.wish.scenario)),
        "lines": _lines(study),
        "axis_lines": [_range_text(study, number) for number in range(len(study.wish.axes))],
        "drawn": study.data is not None or (study.working and isinstance(study.wish, SweepWish)),
        "listed": [column.field for column in metric_columns() if column.listed],
    }
    if study.tuned is not None:
        values["tuned"] = scenario_path(encode_scenario(study.tuned.scenario))
    return page("study.html", study.wish.kind, here="/studies", kind="studies", scripts=("chart", "study"), **values)


def _range_text(study: Study, number: int) -> str:
    """What an axis covers, in words."""
    axis = study.wish.axes[number]
    title = _axis_title(study, axis.path)
    if axis.low is None:
        return f"{title}: {', '.join(map(str, axis.values))}"
    count = f", {len(axis.values)} values" if isinstance(study.wish, SweepWish) else ""
    try:
        unit = study.wish.scenario.about(axis.path).unit_text()
    except FlexlabError:
        unit = ""
    return f"{title}: {axis.low:g} to {axis.high:g}{unit}{', logarithmic' if axis.logarithmic else ''}{count}"


def _lines(study: Study) -> list[tuple[str, str, str]]:
    """(what, before, tuned) of a finished tuning."""
    found, wish = study.tuned, study.wish
    if found is None or not isinstance(wish, TuningWish):
        return []
    lines: list[tuple[str, str, str]] = []
    for path, value in found.changes.items():
        about = wish.scenario.about(path)
        unit = f" ({about.unit})" if about.unit not in ("", "1") else ""
        lines.append((f"{about.title}{unit}", f"{wish.scenario.get(path):g}", f"{value:.4g}"))
    for name in wish.cost.names:
        column = metric_column(name)
        shown = [f"{numbers[name]:.4g}" if numbers else "fails" for numbers in (found.before, found.after)]
        limit = f", at most {wish.cost.limits[name]:g}" if name in wish.cost.limits else ""
        lines.append((f"{column.title} ({column.unit}){limit}", shown[0], shown[1]))
    return lines


async def state(request: web.Request) -> web.Response:
    """How a study stands, for the script in its page."""
    study = context_of(request).studies.get(request.match_info["study"])
    if study is None:
        raise web.HTTPNotFound
    told = {"working": study.working, "share": study.share, "sentence": study.sentence, "problem": study.problem}
    return web.json_response(told, headers={hdrs.CACHE_CONTROL: "no-store"})


async def data(request: web.Request) -> web.Response:
    """A study's numbers, for the script in its page: of a sweep as far as it is, of a tuning that is finished."""
    study = context_of(request).studies.get(request.match_info["study"])
    told = None if study is None else await context_of(request).studies.data(study)
    if study is None or (told is None and study.tuned is None):
        raise web.HTTPNotFound
    if study.tuned is not None and isinstance(study.wish, TuningWish):
        columns = [metric_column(name) for name in (study.wish.cost.names[0], "force")]
        found = study.tuned
        marks = [(numbers[columns[0].field], numbers["force"]) if numbers else None
                 for numbers in (found.before, found.after)]  # fmt: skip
        told = {
            "points": found.points,
            "before": marks[0],
            "after": marks[1],
            "titles": [f"{column.title} ({column.unit})" for column in columns],
        }
    return web.json_response(told, headers={hdrs.CACHE_CONTROL: "no-store"})


async def table(request: web.Request) -> web.StreamResponse:
    """A finished sweep's table, as it is."""
    study = context_of(request).studies.get(request.match_info["study"])
    path = None if study is None else context_of(request).studies.table(study)
    if path is None:
        raise web.HTTPNotFound
    headers = {
        hdrs.CONTENT_TYPE: "application/octet-stream",
        hdrs.CONTENT_DISPOSITION: 'attachment; filename="cells.parquet"',
        hdrs.CACHE_CONTROL: "no-store",
    }
    return web.FileResponse(path, headers=headers)


async def cell(request: web.Request) -> web.Response:
    """The scenario of a sweep's cell, in the lab."""
    if not is_opened_by_person(request):
        return refuse(request, 403, "A link into the lab must be opened by a person, not from inside another page.")
    study, number = _study(request), request.match_info["cell"]
    if not isinstance(study.wish, SweepWish):
        raise web.HTTPNotFound
    plan = study.wish.plan
    if not (number.isascii() and number.isdecimal() and len(number) < 9 and int(number) < plan.cell_count):
        return message("No such cell", f"This sweep has the cells 0 to {plan.cell_count - 1}.", 404, ALL_STUDIES)
    raise web.HTTPSeeOther(scenario_path(encode_scenario(study.wish.cell_scenario(int(number)))))


async def cancel(request: web.Request) -> web.Response:
    """End a study that is being computed."""
    study = _study(request)
    context_of(request).studies.cancel(study)
    raise web.HTTPSeeOther(f"/studies/{study.id}")
