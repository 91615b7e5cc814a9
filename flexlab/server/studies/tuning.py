"""A tuning on its page: what changed, what that gains, what less of one metric costs in another."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.figures import metric_column
from flexlab.analysis.tuning import Candidate, Cost, numbers_of, parse_cost, tune
from flexlab.analysis.workers import chosen_workers
from flexlab.errors import StudyError
from flexlab.scenario import Scenario
from flexlab.server.study import (
    ELSEWHERE,
    Form,
    Found,
    Job,
    Question,
    Study,
    StudyKind,
    axes_of,
    check_work,
    number_of,
    text_of,
    threads,
    whole_of,
)
from flexlab.server.task_book import Outcome, Task
from flexlab.text import number_text

FEWEST_CANDIDATES, MOST_CANDIDATES = 16, 400
FORCE = "force"
"""The metric over which the trade-off is drawn."""

Numbers = dict[str, float]


@dataclass(frozen=True)
class Tuned:
    """What a search found."""

    changes: Numbers
    """Field → value, of the best candidate."""
    before: Numbers | None
    """Metric → number of the scenario as it was; None: it fails."""
    after: Numbers | None
    holds: bool
    """Whether the best candidate keeps within the limits."""
    tried: int
    scenario: Scenario
    points: tuple[tuple[float, float], ...]
    """Of every candidate that ran: the metric that was made small, and RMS internal force."""


@dataclass
class TuningStudy(Study):
    """A tuning that somebody wants."""

    scenario: Scenario
    axes: tuple[Axis, ...]
    cost: Cost
    duration: float
    candidates: int

    def job(self) -> tuple[Job, tuple[Any, ...]]:
        """The search."""
        return tuning_study, (self.scenario, self.axes, self.cost, self.duration, self.candidates)

    def drawing(self, task: Task) -> dict[str, Any] | None:
        """The trade-off among what was tried."""
        tuned: Tuned | None = task.result
        if tuned is None:
            return None
        columns = [metric_column(name) for name in (self.cost.names[0], FORCE)]
        before, after = (
            (numbers[columns[0].field], numbers[FORCE]) if numbers else None for numbers in (tuned.before, tuned.after)
        )
        titles = [f"{column.title} ({column.unit})" for column in columns]
        return {"points": tuned.points, "before": before, "after": after, "titles": titles}

    def found(self, task: Task) -> Found:
        """The fields, then the metrics that count."""
        tuned: Tuned = task.result
        lines: list[tuple[str, str, str]] = []
        for path, value in tuned.changes.items():
            about = self.scenario.about(path)
            unit = f" ({about.unit})" if about.unit not in ("", "1") else ""
            lines.append((f"{about.title}{unit}", number_text(self.scenario.get(path)), number_text(value)))
        for name in self.cost.names:
            column = metric_column(name)
            shown = [number_text(numbers[name]) if numbers else "fails" for numbers in (tuned.before, tuned.after)]
            limit = f", at most {number_text(self.cost.limits[name])}" if name in self.cost.limits else ""
            lines.append((f"{column.title} ({column.unit}){limit}", shown[0], shown[1]))
        problem = (
            "" if tuned.holds else "Nothing that was tried keeps within the limits: widen the ranges or the limits."
        )
        return Found(lines, f"{tuned.tried} candidates were tried.", problem, tuned.scenario)


def read(form: Form, scenario: Scenario, duration: float) -> TuningStudy:
    """The tuning that a form asks for."""
    axes = axes_of(form, scenario, counted=False)
    candidates = whole_of(form, "candidates", "Candidates")
    if not FEWEST_CANDIDATES <= candidates <= MOST_CANDIDATES:
        limits = f"{FEWEST_CANDIDATES} to {MOST_CANDIDATES}"
        raise StudyError(
            f"{number_text(candidates, 12)} candidates are outside {limits}: choose within it, {ELSEWHERE}: flexlab tune."
        )
    check_work(candidates, duration, "candidates", "tune")
    limited = text_of(form, "limited")
    limits = {limited: number_of(form, "limit", "The limit")} if limited else {}
    return TuningStudy(scenario, axes, parse_cost({text_of(form, "cost"): 1.0}, limits), duration, candidates)


STUDY = StudyKind(
    "tuning",
    20,
    "Tuning",
    "Searches the ranges for the values that make one metric smallest, and shows what that costs in another.",
    "run",
    False,
    (
        Question("cost", "Make small", "rms-y", is_metric=True),
        Question("limited", "Not above the limit", is_metric=True, none="no limit"),
        Question("limit", "Limit"),
        Question("candidates", "Candidates to try, about", "100", range=(FEWEST_CANDIDATES, MOST_CANDIDATES)),
    ),
    read,
)


def tuning_study(
    scenario: Scenario,
    axes: tuple[Axis, ...],
    cost: Cost,
    duration: float,
    candidates: int,
    report: Callable[[float], None],
) -> Outcome:
    """Search the ranges for what costs least."""
    found = tune(
        scenario,
        axes,
        cost,
        (),
        duration,
        candidates,
        told=lambda done, total: report(min(done / total, 1.0)),
        workers=chosen_workers(threads()),
    )
    best, first = found.best, cost.names[0]
    ran = [numbers_of(candidate.metrics) for candidate in found.candidates if candidate.metrics is not None]
    tuned = Tuned(
        {path: float(value) for path, value in best.changes.items()},
        _numbers(found.before),
        _numbers(best),
        best.metrics is not None and cost.holds(best.metrics),
        len(found.candidates),
        found.tuned,
        tuple((numbers[first], numbers[FORCE]) for numbers in ran),
    )
    return Outcome(tuned)


def _numbers(candidate: Candidate) -> Numbers | None:
    return None if candidate.metrics is None else numbers_of(candidate.metrics)
