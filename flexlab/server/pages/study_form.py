"""What a visitor asks of a study, read from a form: bounded, as a visitor's page must not take the machine from the labs."""

import math
from collections.abc import Mapping
from typing import Any

from flexlab.analysis.metrics import METRICS
from flexlab.analysis.metrics.metric import Column
from flexlab.analysis.sweep.axes import CHOSEN, Axis, parse_axes
from flexlab.analysis.sweep.plan import make_plan
from flexlab.analysis.tuning import parse_cost
from flexlab.errors import StudyError
from flexlab.plain_text import visible
from flexlab.scenario import Scenario
from flexlab.scenario.choices import TITLES, options
from flexlab.server.studies import SweepWish, TuningWish

MOST_CELLS = 900
"""Cells of a sweep: 30 by 30 are as fine as a map on a screen is read."""
LONGEST_RUN = 20.0
"""s that a cell or a candidate may simulate."""
MOST_SIMULATED = 6000.0
"""s that all cells or candidates of a study may simulate together: half a minute's work for the paper's beam."""
FEWEST_CANDIDATES, MOST_CANDIDATES = 16, 400
AXES = ("1", "2")
"""What the form's fields of each axis end with."""
ELSEWHERE = "or use the command line, which takes any number"
SAMPLE_PERIOD = 1e-3
"""s."""
LONGEST_SHOWN = 30
"""Characters of what was typed that a sentence repeats."""


def metric_columns() -> list[Column]:
    """The metrics that a study may be about."""
    return [column for metric in METRICS.values() for column in metric.columns if column.field != "window"]


def read_wish(form: Mapping[str, Any], scenario: Scenario) -> SweepWish | TuningWish:
    """The study that a form asks for. Raises `StudyError` or `ScenarioError` with what is wrong."""
    duration = _number(form, "duration", "Simulated time")
    if not 0 < duration <= LONGEST_RUN:
        raise StudyError(f"Simulated time = {duration:g} s is outside 0 to {LONGEST_RUN:g} s: choose within it.")
    if form.get("kind") == "tuning":
        return _tuning(form, scenario, duration)
    axes = _axes(form, scenario, counted=True)
    plan = make_plan(scenario, axes, duration, SAMPLE_PERIOD)
    if plan.cell_count > MOST_CELLS:
        raise StudyError(
            f"{plan.cell_count} cells are too many for this page: choose fewer values, {MOST_CELLS} cells at most, "
            f"{ELSEWHERE}: flexlab sweep."
        )
    _check_work(plan.cell_count, duration, "cells", "flexlab sweep")
    return SweepWish(scenario, plan)


def _tuning(form: Mapping[str, Any], scenario: Scenario, duration: float) -> TuningWish:
    axes = _axes(form, scenario, counted=False)
    candidates = _whole(form, "candidates", "Candidates")
    if not FEWEST_CANDIDATES <= candidates <= MOST_CANDIDATES:
        limits = f"{FEWEST_CANDIDATES} to {MOST_CANDIDATES}"
        raise StudyError(f"{candidates} candidates are outside {limits}: choose within it, {ELSEWHERE}: flexlab tune.")
    _check_work(candidates, duration, "candidates", "flexlab tune")
    limited = _text(form, "limited")
    limits = {limited: _number(form, "limit", "The limit")} if limited else {}
    return TuningWish(scenario, axes, parse_cost({_text(form, "cost"): 1.0}, limits), duration, candidates)


def _check_work(count: int, duration: float, what: str, command: str) -> None:
    if count * duration > MOST_SIMULATED:
        raise StudyError(
            f"{count} {what} of {duration:g} s simulate {count * duration:g} s, over the {MOST_SIMULATED:g} s that this page "
            f"gives a study: choose fewer or shorter ones, {ELSEWHERE}: {command}."
        )


def _axes(form: Mapping[str, Any], scenario: Scenario, counted: bool) -> tuple[Axis, ...]:
    texts: list[str] = []
    for end in AXES:
        path = _text(form, f"field{end}")
        if not path:
            continue
        if path in CHOSEN:
            texts.append(f"{path}={','.join(_chosen(form, end, path, counted))}")
            continue
        low, high = _number(form, f"low{end}", f"From, of {path},"), _number(form, f"high{end}", f"To, of {path},")
        # Every digit, as a text that is read again.
        parts = [repr(low), repr(high), *(["log"] if form.get(f"log{end}") else [])]
        if counted:
            count = _whole(form, f"count{end}", f"Values of {path}")
            if count > MOST_CELLS:
                raise StudyError(f"{count} values of {path} are too many: choose {MOST_CELLS} at most.")
            parts.append(str(count))
        else:
            parts.append("2")
        texts.append(f"{path}={':'.join(parts)}")
    if not texts:
        raise StudyError("Nothing is varied: choose a field.")
    return parse_axes(texts, scenario)


def _chosen(form: Mapping[str, Any], end: str, path: str, counted: bool) -> list[str]:
    """The words that were ticked for a field that is a choice. Raises `StudyError`."""
    if not counted:
        raise StudyError(f"{path} is a choice: a tuning searches numbers; compare choices with a sweep.")
    # A form says each box as "path=word", and only the chosen field's boxes count.
    several = getattr(form, "getall", None)
    boxes: list[Any] = [form.get(f"words{end}")] if several is None else several(f"words{end}", [])
    ticked = [box.removeprefix(f"{path}=") for box in boxes if isinstance(box, str) and box.startswith(f"{path}=")]
    known = options(path)
    if odd := [word for word in ticked if word not in known]:
        raise StudyError(f"{visible(odd[0], LONGEST_SHOWN)!r} is no {TITLES[path]}: choose of {', '.join(known)}.")
    if not ticked:
        raise StudyError(f"{TITLES[path]}: nothing is ticked; tick what is to be compared.")
    return ticked


def _text(form: Mapping[str, Any], name: str) -> str:
    value = form.get(name, "")
    return value.strip() if isinstance(value, str) else ""


def _number(form: Mapping[str, Any], name: str, what: str) -> float:
    text = _text(form, name)
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise StudyError(f"{what} {text[:LONGEST_SHOWN]!r} is no number: write one such as 0.5 or 1e3.")
    return number


def _whole(form: Mapping[str, Any], name: str, what: str) -> int:
    number = _number(form, name, what)
    if number != int(number):
        raise StudyError(f"{what} = {number:g} is no whole number: write one such as 12.")
    return int(number)
