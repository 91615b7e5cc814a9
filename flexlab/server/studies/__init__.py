"""Studies of the page *Studies*: what a form asks, what is computed, and what the study's page shows.

To add one, copy a file of `studies/`. A form's work is bounded, so that no visitor can take the machine from the labs.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self

from flexlab.analysis.metrics import METRICS
from flexlab.analysis.metrics.metric import Column
from flexlab.analysis.sweep.axes import CHOSEN, Axis, parse_axes
from flexlab.analysis.workers import Workers, chosen_workers
from flexlab.errors import FlexlabError, StudyError
from flexlab.machine import cores
from flexlab.registry import modules_in
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import TITLES, field_title, options, titled
from flexlab.server.task_book import Outcome, Task
from flexlab.text import number_text, typed_number, visible

MOST_STUDIES = 30
"""Finished studies that a server keeps."""
MOST_AT_ONCE = 2, 5, 6, 1
"""Most running and waiting studies of one visitor, one address and all, and extra for the teacher. One runs at a time."""
MOST_VALUES = 900
"""Most values of an axis, and most cells: a map on a screen shows no more than 30 by 30."""
LONGEST_RUN = 20.0
"""Longest simulated time of a cell or candidate, s."""
MOST_SIMULATED = 6000.0
"""Longest simulated time of all cells or candidates together, s: about half a minute of work for the paper's beam."""
AXES = ("1", "2")
"""Endings of the form's fields for each axis."""
ELSEWHERE = "or use the command line, which takes any number"
LONGEST_NUMBER = 12
"""Significant digits of a typed number quoted in a sentence."""
LONGEST_SHOWN = 30
"""Most characters of an input quoted in a message."""

Form = Mapping[str, Any]
_PATH = re.compile(r"'?\b([a-z]\w*(?:\.\w+)+)\b'?(?:='?([^\s:']+):([^\s:']+)\S*)?")
"""A field as the command line's sentences name it, perhaps with a range, LOW:HIGH:COUNT."""

_DECIMAL_COMMA = re.compile(r"^(?![+-]?[1-9]\d{0,2},\d{3}\Z)([^,.]*),([^,.]*)\Z")
"""A number with a decimal comma, the only point on some phones' keys; not 1,000, which may be a thousand."""


@dataclass(frozen=True)
class Question:
    """A field of a study's form, besides the varied fields and the simulated time."""

    name: str
    words: str
    default: str = ""
    is_metric: bool = False
    none: str = ""
    """Label of "no metric"; empty if a metric must be chosen."""
    range: tuple[int, int] | None = None
    """Range of a whole number."""


@dataclass(frozen=True)
class Found:
    """The result of a study in words; its drawing comes from `Study.drawing`."""

    lines: Sequence[tuple[str, str, str]] = ()
    """(what, before, now) of each number that the study changed."""
    remark: str = ""
    problem: str = ""
    """A problem of the result, in a sentence; empty if there is none."""
    scenario: Scenario | None = None
    """The scenario that the study found."""
    table: Path | None = None
    """File with all results."""


class Study(ABC):
    """A study that a visitor asked for. A file of `studies/` defines one subclass as `STUDY`."""

    kind: ClassVar[str]
    """Its name in forms, and the command that does the same without bounds: flexlab KIND."""
    place: ClassVar[int]
    """Rank on the page."""
    title: ClassVar[str]
    what: ClassVar[str]
    """Its purpose, in a sentence or two."""
    run_words: ClassVar[str]
    """Its name for one simulation: "cell"."""
    is_map: ClassVar[bool] = False
    """Whether it varies fields over a number of values, or over choices, and draws a map that fills cell by cell."""
    questions: ClassVar[tuple[Question, ...]] = ()

    scenario: Scenario
    axes: tuple[Axis, ...]

    @classmethod
    @abstractmethod
    def read(cls, form: Form, scenario: Scenario, duration: float) -> Self:
        """The study that a form asks for; `duration`: simulated time, s. Raises `StudyError` or `ScenarioError`."""

    @abstractmethod
    def job(self) -> Callable[..., Outcome]:
        """The function that computes it, run in a separate process as `TaskBook.start` describes."""

    @abstractmethod
    def drawing(self, task: Task) -> dict[str, Any] | None:
        """The drawing of the results so far, as data for the page's script; None if there are none. For any thread."""

    def cell_scenario(self, cell: int) -> Scenario:
        """The scenario of a cell of the map. Raises `FlexlabError` for a cell that does not exist."""
        raise StudyError(f"{visible(cell)}: this study has no cells.")

    def found(self, task: Task) -> Found:
        """The result of a finished study, in words."""
        return Found()

    def axis_title(self, axis: Axis) -> str:
        """The title and symbol of a varied field."""
        if axis.path in TITLES or not self.scenario.has(axis.path):
            return TITLES.get(axis.path, axis.path)
        return titled(self.scenario.about(axis.path))

    def axis_text(self, axis: Axis) -> str:
        """The title and values of a varied field."""
        title = self.axis_title(axis)
        if axis.low is None or axis.high is None:
            return f"{title}: {', '.join(map(str, axis.values))}"
        count = f", {len(axis.values)} values" if self.is_map else ""
        unit = self.scenario.about(axis.path).unit_text() if self.scenario.has(axis.path) else ""
        spacing = ", equal ratios" if axis.logarithmic else ""
        return f"{title}: {number_text(axis.low)} to {number_text(axis.high)}{unit}{spacing}{count}"


@cache
def known_studies() -> dict[str, type[Study]]:
    """Every study by its kind, in the order of the page."""
    found: list[type[Study]] = [module.STUDY for module in modules_in("flexlab.server.studies")]
    return {study.kind: study for study in sorted(found, key=lambda study: study.place)}


def workers() -> Workers:
    """The workers of a study, on all cores but one, which is left to the labs."""
    return chosen_workers(max(cores() - 1, 1))


def metric_columns() -> list[Column]:
    """The metrics that a form offers."""
    return [column for metric in METRICS.values() for column in metric.columns if column.field != "window"]


def read_study(form: Form, scenario: Scenario) -> Study:
    """The study that a form asks for. Raises `StudyError` or `ScenarioError` with what is wrong."""
    try:
        study = known_studies()[text_of(form, "kind")]
    except KeyError:
        known = ", ".join(known_studies())
        raise StudyError(
            f"{visible(form.get('kind', ''), LONGEST_SHOWN)!r} is not a study: choose one of {known}."
        ) from None
    duration = number_of(form, "duration", "Simulated time")
    if not 0 < duration <= LONGEST_RUN:
        given, most = number_text(duration), number_text(LONGEST_RUN)
        raise StudyError(f"Simulated time = {given} s is outside 0 to {most} s: choose within it.")
    try:
        return study.read(form, scenario, duration)
    except FlexlabError as error:
        raise StudyError(_in_titles(str(error), scenario)) from None


def _in_titles(sentence: str, scenario: Scenario) -> str:
    """Replace the fields' names in a sentence with their titles in the form."""

    def title(found: re.Match[str]) -> str:
        named = field_title(found[1], scenario).partition(" (")[0]
        if named == found[1]:
            return found[0]
        return named if found[2] is None else f"{named}: {_shown(found[2])} to {_shown(found[3])}"

    return _PATH.sub(title, sentence)


def _shown(typed: str) -> str:
    value = typed_number(typed)
    return typed if math.isnan(value) else number_text(value, LONGEST_NUMBER)


def check_work(count: int, duration: float, what: str, command: str) -> None:
    """Raise `StudyError` for more simulated time than a form may ask for."""
    if count * duration > MOST_SIMULATED:
        raise StudyError(
            f"{count} {what} of {number_text(duration)} s simulate {number_text(count * duration)} s, over the "
            f"{number_text(MOST_SIMULATED)} s that this page "
            f"gives a study: choose fewer or shorter ones, {ELSEWHERE}: flexlab {command}."
        )


def axes_of(form: Form, scenario: Scenario, counted: bool) -> tuple[Axis, ...]:
    """The fields that a form varies; `counted`: whether it says how many values. Raises `StudyError` or `ScenarioError`."""
    texts: list[str] = []
    for end in AXES:
        path = text_of(form, f"field{end}")
        if not path:
            continue
        if path in CHOSEN:
            texts.append(f"{path}={','.join(_chosen(form, end, path, counted))}")
            continue
        low = number_of(form, f"low{end}", f"The lower limit of {path}")
        high = number_of(form, f"high{end}", f"The upper limit of {path}")
        if form.get(f"log{end}") and low <= 0:
            raise StudyError(
                f"{path} has equal ratios and begins at {number_text(low)}: begin above 0, or untick equal ratios."
            )
        count = whole_of(form, f"count{end}", f"Values of {path}") if counted else 2
        if not 2 <= count <= MOST_VALUES:
            shown = number_text(count, LONGEST_NUMBER)
            raise StudyError(f"{shown} values of {path} are outside 2 to {MOST_VALUES}: choose within it.")
        spacing = ":log" if form.get(f"log{end}") else ""
        # `parse_axes` reads the numbers again, so they keep every digit.
        texts.append(f"{path}={low!r}:{high!r}{spacing}:{count}")
    if not texts:
        raise StudyError("Nothing is varied: choose a field.")
    return parse_axes(texts, scenario)


def _chosen(form: Form, end: str, path: str, counted: bool) -> list[str]:
    """The ticked options of a field that is a choice. Raises `StudyError`."""
    if not counted:
        raise StudyError(f"{path} is a choice: a tuning searches numbers; compare choices with a sweep.")
    # A box's value is "path=word"; the boxes of other fields do not count.
    several = getattr(form, "getall", None)
    boxes: list[Any] = [form.get(f"words{end}")] if several is None else several(f"words{end}", [])
    ticked = [box.removeprefix(f"{path}=") for box in boxes if isinstance(box, str) and box.startswith(f"{path}=")]
    known = options(path)
    if odd := [word for word in ticked if word not in known]:
        raise StudyError(f"{visible(odd[0], LONGEST_SHOWN)!r} is no {TITLES[path]}: choose one of {', '.join(known)}.")
    if not ticked:
        raise StudyError(f"{TITLES[path]}: nothing is ticked; tick what to compare.")
    return ticked


def text_of(form: Form, name: str) -> str:
    """A field of a form, without blanks around it."""
    value = form.get(name, "")
    return value.strip() if isinstance(value, str) else ""


def number_of(form: Form, name: str, what: str) -> float:
    """A number of a form, also with a decimal comma or the minus sign that pages show. Raises `StudyError`."""
    text = text_of(form, name)
    number = typed_number(_DECIMAL_COMMA.sub(r"\1.\2", text.replace("−", "-")))
    if math.isnan(number):
        raise StudyError(f"{what} {text[:LONGEST_SHOWN]!r} is not a number: write one such as 0.5 or 1e3.")
    return number


def whole_of(form: Form, name: str, what: str) -> int:
    """A whole number of a form. Raises `StudyError`."""
    number = number_of(form, name, what)
    if number != int(number):
        raise StudyError(f"{what} = {number_text(number)} is not a whole number: write one such as 12.")
    return int(number)
