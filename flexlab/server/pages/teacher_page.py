"""`/teacher`: all labs at a glance, for the teacher: join one, send a preset, pause, pace, lock.

The teacher's rules for the class are kept beside the runs, so that a restarted server goes on with them.
"""

import asyncio
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from aiohttp import hdrs, web
from pydantic import TypeAdapter, ValidationError

from flexlab.analysis.own_lessons import lesson_menu, lesson_mistakes, own_lessons, short_name
from flexlab.errors import LabError
from flexlab.guide import STEPS, ClassRules, step_text
from flexlab.presets import load_preset, preset_names
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.people import names_told_apart
from flexlab.server.auth import ask_for_token
from flexlab.server.labs import Choice, Lab, Request, state_of
from flexlab.server.labs.recorded_lab import little_space
from flexlab.server.limits import for_teacher
from flexlab.server.pages import page
from flexlab.server.visitors import context_of, form_of, fresh, is_teacher, set_cookie
from flexlab.sim.commands import Pause, Play
from flexlab.text import counted

ROUTES = web.RouteTableDef()

FILE = Path(".class")
"""File in the folder of the runs; `notes` adds its suffix."""
RULES = "rules"

_RULES = TypeAdapter(ClassRules)
NOT_YOURS = (
    "This page is the teacher's: use the address that flexlab printed for the teacher, or enter the teacher's token."
)


def keep_rules(logs: Path, rules: ClassRules) -> None:
    """Save the rules for the next server of this folder. Raises OSError."""
    logs.mkdir(parents=True, exist_ok=True)
    write_notes(logs / FILE, **{RULES: asdict(rules)})


def kept_rules(logs: Path) -> ClassRules:
    """The saved rules, without a lesson that no longer exists; the defaults if the file is missing or malformed."""
    try:
        rules = _RULES.validate_python(read_notes(logs / FILE).get(RULES, {}))
    except ValidationError:
        return ClassRules()
    if not 1 <= rules.step <= len(STEPS):
        return ClassRules()
    # Between two servers a lesson may be deleted or, by another version, renamed.
    return rules if not rules.lesson or rules.lesson in _lessons() else replace(rules, lesson="", step=len(STEPS))


@ROUTES.get("/teacher")
async def teacher(request: web.Request) -> web.Response:
    """The page; its script requests the labs every 0.4 s."""
    if not is_teacher(request):
        return ask_for_token(request, NOT_YOURS)
    context = context_of(request)
    answer = page(
        "teacher.html",
        "Class",
        here="/teacher",
        kind="wide",
        scripts=("teacher",),
        presets=await asyncio.to_thread(preset_names),
        lessons=await asyncio.to_thread(_lessons),
        mistakes=await asyncio.to_thread(lesson_mistakes),
        steps=STEPS,
        said=request.query.get("said", "")[:200],
        little=await asyncio.to_thread(little_space, context.settings.logs),
    )
    if context.settings.teacher_token is None:
        # Where everybody is the teacher, only those who have been on this page may enter other people's labs.
        set_cookie(request, answer, context.cookie("teacher"), context.signed("teacher", None), "Strict")
    return answer


@ROUTES.get("/teacher/labs")
async def labs(request: web.Request) -> web.Response:
    """All labs, their guesses, and the class's rules as JSON, for the page's script."""
    if not is_teacher(request):
        raise web.HTTPForbidden
    context = context_of(request)
    running, rules = context.places.running(), context.places.rules
    people = [(place.name, place.owner) for place in running]
    names = await asyncio.to_thread(names_told_apart, people, context.settings.logs)
    told = {
        "labs": [_told(place, names[place.name, place.owner], rules) for place in running],
        "questions": _questions(running, rules),
        "rules": {"lesson": rules.lesson, "step": str(rules.step), "lock": rules.locked, "hide": rules.hides_names},
    }
    return fresh(told)


def _told(place: Lab, name: str, rules: ClassRules) -> dict[str, Any]:
    status = place.status()
    error = 1000 * status.error
    guesses = [f"{short_name(progress.lesson)}: {progress.guess}" for progress in status.lessons if progress.guess]
    return {
        "lab": place.path,
        "who": f"Student {place.number}" if rules.hides_names else who(place, name),
        "preset": status.name,
        "title": status.title,
        "lesson": status.lesson,
        "guesses": f"Guessed: {'; '.join(guesses)}" if guesses else "",
        "time": round(status.time, 1),
        # JSON has no infinite number: one lab would blank the page for all.
        "error": round(error, 3) if math.isfinite(error) else None,
        "state": state_of(place),
        "watching": place.visitors,
        "problem": for_teacher(status.problem),
    }


def _questions(places: Sequence[Lab], rules: ClassRules) -> list[dict[str, Any]]:
    """The question of the class's lesson, or all questions that labs have reached, with the count of each answer.

    The right answer is marked once the whole class may see it.
    """
    found = [progress for place in places for progress in place.status().lessons if progress.options]
    met = [progress for progress in found if rules.lesson in ("", progress.lesson)]
    told: list[dict[str, Any]] = []
    # Sorted by the length of the prefix first, so that "Lesson 2" comes before "Lesson 10" and one's own lessons come last.
    for lesson in sorted(
        {one.lesson: one for one in met}.values(), key=lambda one: (len(one.lesson.partition(":")[0]), one.lesson)
    ):
        counts = Counter(progress.guess for progress in met if progress.lesson == lesson.lesson)
        shown = rules.lesson == lesson.lesson and rules.step == len(STEPS)
        options = [
            {"text": option, "count": counts[option], "right": shown and option == lesson.answer}
            for option in lesson.options
        ]
        of = len(places) if rules.lesson else counts.total()
        told.append({"lesson": lesson.lesson, "question": lesson.question, "options": options, "of": of})
    return told


def who(place: Lab, name: str) -> str:
    """A lab's name: its visitor's name, or a number."""
    return name or ("Everybody" if place.path == "/lab" else f"Visitor {place.number}")


def _lessons() -> list[str]:
    return list(lesson_menu(own_lessons()))


@ROUTES.post("/teacher/rules")
async def rule(request: web.Request) -> web.StreamResponse:
    """Set the pace, the lock and the hiding of names for the whole class."""
    form = await _form(request)
    lesson, step = str(form.get("lesson", "")), str(form.get("step", len(STEPS)))
    if lesson and lesson not in await asyncio.to_thread(_lessons):
        raise LabError(f"There is no lesson {lesson[:60]!r}: choose one from the list.")
    if step not in map(str, range(1, len(STEPS) + 1)):
        raise LabError(f"step = {step[:20]!r} is not a step of a lesson: choose 1 to {len(STEPS)}.")
    rules = ClassRules(lesson, int(step), "lock" in form, "hide" in form)
    context = context_of(request)
    await context.places.rule(rules)
    if context.settings.resumes_class:
        try:
            await asyncio.to_thread(keep_rules, context.settings.logs, rules)
        except OSError as error:
            raise LabError(f"The rules hold until the server ends, but cannot be saved ({error.strerror}).") from None
    pace = f"All are at {step_text(rules.step)} of “{lesson}”" if lesson else "Everybody chooses their own lesson"
    return _answer(request, f"{pace}; {'nobody can play' if rules.locked else 'all can play'}.")


@ROUTES.post("/teacher/send")
async def send(request: web.Request) -> web.StreamResponse:
    """Open a preset in one lab or in all."""
    preset = str((await _form(request)).get("preset", ""))
    if preset not in await asyncio.to_thread(preset_names):
        raise LabError(f"There is no preset {preset[:60]!r}: choose one from the list.")
    scenario = await asyncio.to_thread(load_preset, preset)
    places = await _tell(request, Choice(scenario, preset))
    return _answer(request, f"{scenario.title or preset} was sent to {_count(places)}.")


@ROUTES.post("/teacher/pause")
async def pause(request: web.Request) -> web.StreamResponse:
    """Pause one lab or all."""
    return _answer(request, f"{_count(await _tell(request, Pause()))} paused.")


@ROUTES.post("/teacher/resume")
async def resume(request: web.Request) -> web.StreamResponse:
    """Resume one lab, or all that somebody watches; the others wait until somebody comes back."""
    watched = await _tell(request, Play(), watched=True)
    places = [place for place in watched if place.status().state != "stopped"]  # A run that failed needs a reset.
    nobody = "Nobody is watching: a lab resumes when somebody comes back to it."
    return _answer(request, f"{_count(places)} running again." if watched else nobody)


async def _form(request: web.Request) -> Any:
    if not is_teacher(request):
        raise web.HTTPForbidden
    return await form_of(request)


async def _tell(request: web.Request, what: Request, watched: bool = False) -> list[Lab]:
    """Send a request to the lab that the form names, or to all, and return them; `watched`: only labs that somebody watches."""
    lab, places = str((await _form(request)).get("lab", "")), context_of(request).places
    chosen = [place for place in places.running() if place.path == lab or not lab]
    if lab and not chosen:
        raise LabError("This lab is closed: reload the page.")
    chosen = [place for place in chosen if place.visitors or not watched]
    await asyncio.gather(*(place.ask(what) for place in chosen))
    return chosen


def _count(places: list[Lab]) -> str:
    return counted(len(places), "lab")


def _answer(request: web.Request, sentence: str) -> web.StreamResponse:
    """Return the sentence as JSON for the page's script, or redirect to the page if there is no script."""
    if request.headers.get(hdrs.ACCEPT, "") == "application/json":
        return fresh({"sentence": sentence})
    raise web.HTTPSeeOther("/teacher?" + urlencode({"said": sentence}))
