"""What a study is to its page: a form that asks for it, a job that computes it, and what its page shows.

A file in `studies/` that defines `STUDY` is all that a new one takes. What a form asks is bounded, as a visitor's page must not
take the machine from the labs.
"""

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexlab.analysis.metrics import METRICS
from flexlab.analysis.metrics.metric import Column
from flexlab.analysis.sweep.axes import CHOSEN, Axis, parse_axes
from flexlab.errors import FlexlabError, StudyError
from flexlab.registry import Registry
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import TITLES, options, short_title
from flexlab.server.task_book import Outcome, Task
from flexlab.text import number_text, typed_number, visible

MOST_STUDIES = 30
"""Finished ones that are remembered."""
MOST_AT_ONCE = 2, 5, 6, 1
"""Studies that work or wait: of one visitor, of one address, of all, and more for the teacher. One works at a time."""
MOST_VALUES = 900
"""Values of an axis, and cells of all: 30 by 30 are as fine as a map on a screen is read."""
LONGEST_RUN = 20.0
"""s that a cell or a candidate may simulate."""
MOST_SIMULATED = 6000.0
"""s that all cells or candidates of a study may simulate together: half a minute's work for the paper's beam."""
AXES = ("1", "2")
"""What the form's fields of each axis end with."""
ELSEWHERE = "or use the command line, which takes any number"
LONGEST_SHOWN = 30
"""Characters of what was typed that a sentence repeats."""

Form = Mapping[str, Any]
Job = Callable[..., Outcome]


@dataclass(frozen=True)
class Question:
    """A field of a study's form, besides what is varied and the simulated time."""

    name: str
    words: str
    default: str = ""
    is_metric: bool = False
    none: str = ""
    """Of a metric: what stands there for none; empty: one must be chosen."""
    range: tuple[int, int] | None = None
    """Of a whole number."""


@dataclass(frozen=True)
class Found:
    """What came of a study, in words, besides its drawing."""

    lines: Sequence[tuple[str, str, str]] = ()
    """(what, before, now) of what it changed."""
    remark: str = ""
    problem: str = ""
    """What is wrong with it; empty: nothing."""
    scenario: Scenario | None = None
    """Where it leads."""
    table: Path | None = None
    """A file with all of it."""


class Study(ABC):
    """A study that somebody asks for."""

    scenario: Scenario
    axes: tuple[Axis, ...]

    @abstractmethod
    def job(self) -> tuple[Job, tuple[Any, ...]]:
        """What computes it in a process of its own, and with what."""

    @abstractmethod
    def drawing(self, task: Task) -> dict[str, Any] | None:
        """What the page's script draws, as far as it is computed; None: nothing yet. For any thread."""

    @property
    def is_map(self) -> bool:
        """Whether cells are drawn, from the first one on, of a metric that the page lets choose."""
        return False

    def cell_scenario(self, cell: int) -> Scenario:
        """The scenario of a cell of the map. Raises `FlexlabError` for none."""
        raise StudyError(f"{visible(cell)}: this study has no cells.")

    def found(self, task: Task) -> "Found":
        """What its page says of it, once it is done."""
        return Found()

    def axis_title(self, axis: Axis) -> str:
        """A varied field in words, with its symbol."""
        if axis.path in TITLES:
            return TITLES[axis.path]
        try:
            about = self.scenario.about(axis.path)
        except FlexlabError:
            return axis.path
        return f"{short_title(about)} {about.symbol}".strip()

    def axis_text(self, axis: Axis) -> str:
        """What an axis covers, in words."""
        title = self.axis_title(axis)
        if axis.low is None or axis.high is None:
            return f"{title}: {', '.join(map(str, axis.values))}"
        count = f", {len(axis.values)} values" if self.is_map else ""
        try:
            unit = self.scenario.about(axis.path).unit_text()
        except FlexlabError:
            unit = ""
        spacing = ", equal ratios" if axis.logarithmic else ""
        return f"{title}: {number_text(axis.low)} to {number_text(axis.high)}{unit}{spacing}{count}"


@dataclass(frozen=True)
class StudyKind:
    """A study as the page offers it."""

    kind: str
    """Its name in forms, and the command that does the same without bounds: flexlab KIND."""
    place: int
    """Rank on the page."""
    title: str
    what: str
    """What it does, in a sentence or two."""
    run_words: str
    """What is simulated again and again: "cell"."""
    counts: bool
    """Whether an axis has a number of values, and may be a choice."""
    questions: tuple[Question, ...]
    read: Callable[[Form, Scenario, float], Study]
    """(form, scenario, simulated time in s) → what is asked for. Raises `StudyError` or `ScenarioError` with what is wrong."""


STUDIES = Registry(StudyKind, "study", "STUDY", "flexlab.server.studies")


def threads() -> int:
    """How many a study takes: one core stays for the labs."""
    return max((os.cpu_count() or 1) - 1, 1)


def metric_columns() -> list[Column]:
    """The metrics that a study may be about."""
    return [column for metric in METRICS.values() for column in metric.columns if column.field != "window"]


def read_study(form: Form, scenario: Scenario) -> Study:
    """The study that a form asks for. Raises `StudyError` or `ScenarioError` with what is wrong."""
    try:
        kind = STUDIES[text_of(form, "kind")]
    except KeyError:
        known = ", ".join(STUDIES.all())
        raise StudyError(f"{visible(form.get('kind', ''), LONGEST_SHOWN)!r} is no study: choose of {known}.") from None
    duration = number_of(form, "duration", "Simulated time")
    if not 0 < duration <= LONGEST_RUN:
        raise StudyError(
            f"Simulated time = {number_text(duration)} s is outside 0 to {number_text(LONGEST_RUN)} s: choose "
            "within it."
        )
    return kind.read(form, scenario, duration)


def check_work(count: int, duration: float, what: str, command: str) -> None:
    """Raises `StudyError` for more than a page may ask for."""
    if count * duration > MOST_SIMULATED:
        raise StudyError(
            f"{count} {what} of {number_text(duration)} s simulate {number_text(count * duration)} s, over the "
            f"{number_text(MOST_SIMULATED)} s that this page "
            f"gives a study: choose fewer or shorter ones, {ELSEWHERE}: flexlab {command}."
        )


def axes_of(form: Form, scenario: Scenario, counted: bool) -> tuple[Axis, ...]:
    """What a form varies. Raises `StudyError` or `ScenarioError`."""
    texts: list[str] = []
    for end in AXES:
        path = text_of(form, f"field{end}")
        if not path:
            continue
        if path in CHOSEN:
            texts.append(f"{path}={','.join(_chosen(form, end, path, counted))}")
            continue
        low, high = number_of(form, f"low{end}", f"From, of {path},"), number_of(form, f"high{end}", f"To, of {path},")
        # Every digit, as a text that is read again.
        parts = [repr(low), repr(high), *(["log"] if form.get(f"log{end}") else [])]
        if counted:
            count = whole_of(form, f"count{end}", f"Values of {path}")
            if count > MOST_VALUES:
                raise StudyError(
                    f"{number_text(count, 12)} values of {path} are too many: choose {MOST_VALUES} at most."
                )
            parts.append(str(count))
        else:
            parts.append("2")
        texts.append(f"{path}={':'.join(parts)}")
    if not texts:
        raise StudyError("Nothing is varied: choose a field.")
    return parse_axes(texts, scenario)


def _chosen(form: Form, end: str, path: str, counted: bool) -> list[str]:
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


def text_of(form: Form, name: str) -> str:
    """A field of a form, without blanks around it."""
    value = form.get(name, "")
    return value.strip() if isinstance(value, str) else ""


def number_of(form: Form, name: str, what: str) -> float:
    """A number of a form. Raises `StudyError`."""
    text = text_of(form, name)
    number = typed_number(text)
    if math.isnan(number):
        raise StudyError(f"{what} {text[:LONGEST_SHOWN]!r} is no number: write one such as 0.5 or 1e3.")
    return number


def whole_of(form: Form, name: str, what: str) -> int:
    """A whole number of a form. Raises `StudyError`."""
    number = number_of(form, name, what)
    if number != int(number):
        raise StudyError(f"{what} = {number_text(number)} is no whole number: write one such as 12.")
    return int(number)
