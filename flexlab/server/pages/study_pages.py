"""`/studies`: forms for studies of the lab's scenario or of a preset; `/studies/<id>`: one study, running or finished."""

import asyncio
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from aiohttp import hdrs, web

from flexlab.analysis.sweep.axes import varied_choices, varied_fields
from flexlab.errors import FlexlabError, LabError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.server.labs import Choice
from flexlab.server.pages import button, message, page
from flexlab.server.pages.lab_pages import LINKED, enter_by_link
from flexlab.server.scenario_links import decode_scenario, encode_scenario, scenario_path
from flexlab.server.settings import secret_word
from flexlab.server.studies import MOST_VALUES, Found, Study, known_studies, metric_columns, read_study
from flexlab.server.task_book import Task
from flexlab.server.visitors import (
    context_of,
    file_answer,
    form_of,
    fresh,
    keep_visitor,
    known_visitor_of,
    told,
    visitor_of,
)
from flexlab.text import visible

ROUTES = web.RouteTableDef()

FROM_LAB = "lab"
"""The value of `?from=` for the lab's present scenario."""
USUAL = ("payload.bending_stiffness", "controller.feedback_gain")
"""Fields that a form suggests if the scenario has them."""
ALL_STUDIES = button("/studies", "Studies")
NO_STUDY = "There is no such study: a server keeps the last few, as long as it runs."


@dataclass(frozen=True)
class Begun:
    """A study that a visitor started."""

    study: Study
    visitor: str
    """Id of the visitor; empty if the study belongs to all visitors."""
    name: str
    """Name of the scenario, a preset's or the lab's."""


@ROUTES.get("/studies")
async def studies(request: web.Request) -> web.Response:
    """The forms for the lab's scenario or a preset, and the list of studies."""
    context = context_of(request)
    # In a shared lab visitors share all studies.
    mine = visitor_of(request).id if context.places.is_private else ""
    cards = await asyncio.to_thread(context.preset_cards.read)
    presets = [(card.name, card.scenario.title or card.name) for card in cards if card.scenario is not None]
    lab = await asyncio.to_thread(_lab_scenario, request)
    chosen = request.query.get("from", FROM_LAB)
    if chosen == FROM_LAB and lab is None:
        chosen = presets[0][0] if presets else ""
    try:
        of_lab = lab if chosen == FROM_LAB else None
        name, scenario = of_lab or (chosen, await asyncio.to_thread(load_preset, chosen))
    except FlexlabError as error:
        return message("No such scenario", str(error), 404, ALL_STUDIES)
    fields = {item.path: item for item in varied_fields(scenario)}
    return page(
        "studies.html",
        "Studies",
        here="/studies",
        kind="studies",
        sources=[*([(FROM_LAB, f"the lab as it is now: {lab[1].title or lab[0]}")] if lab else []), *presets],
        chosen=chosen,
        name=name,
        word=encode_scenario(scenario),
        groups=[(part, list(items)) for part, items in groupby(fields.values(), key=lambda item: item.part)],
        proposed=[*(fields[path] for path in USUAL if path in fields), None, None][:2],
        choices=varied_choices(scenario),
        metrics=metric_columns(),
        kinds=list(known_studies().values()),
        most_values=MOST_VALUES,
        studies=[_row(task) for task in context.studies.all() if task.about.visitor == mine],
    )


def _lab_scenario(request: web.Request) -> tuple[str, Scenario] | None:
    """(name, present scenario) of the visitor's lab; None without a lab, or if this process cannot read its scenario."""
    context = context_of(request)
    place = context.places.of_visitor(visitor_of(request).id)
    if place is None:
        return None
    status = place.status()
    with suppress(FlexlabError):  # It has only just begun, or has a law that only its own process knows.
        return status.name, decode_scenario(status.link)
    return None


def _row(task: Task) -> dict[str, Any]:
    begun: Begun = task.about
    study = begun.study
    return {
        "address": f"/studies/{task.key}",
        "kind": study.title,
        "title": study.scenario.title or begun.name,
        "axes": " × ".join(map(study.axis_title, study.axes)),
        "sentence": task.sentence,
    }


@ROUTES.post("/studies")
async def start(request: web.Request) -> web.Response:
    """Start the study that a form asks for."""
    form = await form_of(request)
    context = context_of(request)
    try:
        scenario = await asyncio.to_thread(decode_scenario, str(form.get("scenario", "")))
        study = await asyncio.to_thread(read_study, form, scenario)
        visitor = known_visitor_of(request)
        about = Begun(study, visitor.id if context.places.is_private else "", visible(form.get("name", ""), 80))
        name = secret_word()  # Whoever has a study's address may view and cancel it.
        context.studies.start(study.title, name, visitor_of(request), study.job(), about=about)
    except LabError as error:
        return message("Not now", str(error), 503, ALL_STUDIES)
    except FlexlabError as error:
        return message("This cannot be studied", str(error), 422, ALL_STUDIES)
    answer = web.Response(status=303, headers={hdrs.LOCATION: f"/studies/{name}"})
    if context.places.is_private:
        keep_visitor(request, answer, visitor)
    return answer


def _task(request: web.Request) -> Task:
    """The study that the address names. Raises `HTTPNotFound`."""
    task = context_of(request).studies.get(request.match_info["study"])
    if task is None:
        raise web.HTTPNotFound
    return task


@ROUTES.get("/studies/{study}")
async def study_page(request: web.Request) -> web.Response:
    """The page of a study: its progress, or its results."""
    task = context_of(request).studies.get(request.match_info["study"])
    if task is None:
        return message("No such study", NO_STUDY, 404, ALL_STUDIES)
    study: Study = task.about.study
    found = study.found(task) if task.result is not None else Found()
    return page(
        "study.html",
        study.title,
        here="/studies",
        kind="studies",
        scripts=("chart", "study"),
        task=task,
        row=_row(task),
        axis_lines=list(map(study.axis_text, study.axes)),
        lab=scenario_path(encode_scenario(study.scenario)),
        is_map=study.is_map,
        drawn=task.result is not None or (task.working and study.is_map),
        listed=[column.field for column in metric_columns() if column.listed],
        found=found,
        leads_to=found.scenario and scenario_path(encode_scenario(found.scenario)),
    )


@ROUTES.get("/studies/{study}/state")
async def state(request: web.Request) -> web.Response:
    """A study's progress, for the script in its page."""
    return told(_task(request))


@ROUTES.get("/studies/{study}/data")
async def data(request: web.Request) -> web.Response:
    """The data that the script in a study's page draws."""
    task = _task(request)
    drawing = await asyncio.to_thread(task.about.study.drawing, task)
    if drawing is None:
        raise web.HTTPNotFound
    return fresh(drawing)


@ROUTES.get("/studies/{study}/cells.parquet")
async def table(request: web.Request) -> web.StreamResponse:
    """The file with all results of a study."""
    task = _task(request)
    path = task.about.study.found(task).table if task.result is not None else None
    if path is None:
        raise web.HTTPNotFound
    return file_answer(path, path.name)


@ROUTES.get("/studies/{study}/cells/{cell:[0-9]{1,8}}")
async def cell(request: web.Request) -> web.StreamResponse:
    """Open the scenario of a map's cell in the lab."""
    try:
        scenario = _task(request).about.study.cell_scenario(int(request.match_info["cell"]))
    except FlexlabError as error:
        return message("No such cell", str(error), 404, ALL_STUDIES)
    return await enter_by_link(request, Choice(scenario, LINKED, stands=True))


@ROUTES.post("/studies/{study}/cancel")
async def cancel(request: web.Request) -> web.Response:
    """Cancel a study that is running or waiting."""
    task = _task(request)
    context_of(request).studies.cancel(task)
    raise web.HTTPSeeOther(f"/studies/{task.key}")
