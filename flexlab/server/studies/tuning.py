"""The tuning of the page *Studies*: what it changed and gained, and the trade-off between two metrics."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flexlab.analysis.metrics.metric import named
from flexlab.analysis.metrics.run_metrics import value_text
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.tuning import Candidate, Cost, Tuning, parse_cost, tune
from flexlab.errors import StudyError
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import field_title
from flexlab.server.studies import (
    ELSEWHERE,
    Form,
    Found,
    Question,
    Study,
    axes_of,
    check_work,
    number_of,
    text_of,
    whole_of,
    workers,
)
from flexlab.server.task_book import Outcome, Task
from flexlab.text import number_text

FEWEST_CANDIDATES, MOST_CANDIDATES = 16, 400


@dataclass
class TuningStudy(Study):
    """A tuning of one or two fields for one metric, under a limit of another."""

    kind, place, title, run_words = "tuning", 20, "Tuning", "run"
    what = "Searches the ranges for the values that make one metric smallest, and shows what that costs in another."
    questions = (
        Question("cost", "Metric to minimize", "rms-y", is_metric=True),
        Question("limited", "Metric to limit", is_metric=True, none="no limit"),
        Question("limit", "Limit"),
        Question("candidates", "Candidates to try", "100", range=(FEWEST_CANDIDATES, MOST_CANDIDATES)),
    )

    scenario: Scenario
    axes: tuple[Axis, ...]
    cost: Cost
    duration: float
    candidates: int

    @classmethod
    def read(cls, form: Form, scenario: Scenario, duration: float) -> "TuningStudy":
        """The tuning that a form asks for. Raises `StudyError` or `ScenarioError`."""
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
        return cls(scenario, axes, parse_cost({text_of(form, "cost"): 1.0}, limits), duration, candidates)

    def job(self) -> Callable[..., Outcome]:
        """The function that searches the ranges."""
        return self.search

    def search(self, report: Callable[[float], None]) -> Outcome:
        """Search the ranges for the least cost; the result is the `Tuning`."""
        found = tune(
            self.scenario,
            self.axes,
            self.cost,
            duration=self.duration,
            candidates=self.candidates,
            told=lambda done, total: report(done / total),
            workers=workers(),
        )
        return Outcome(found)

    def drawing(self, task: Task) -> dict[str, Any] | None:
        """The trade-off among all candidates."""
        tuned: Tuning | None = task.result
        if tuned is None:
            return None
        columns = [named(name).column for name in self.cost.traded()]

        def point(candidate: Candidate) -> tuple[float, ...] | None:
            if candidate.metrics is None:
                return None
            values = tuple(candidate.metrics[column.field] for column in columns)
            return values if all(map(math.isfinite, values)) else None

        tried = [found for candidate in tuned.candidates if (found := point(candidate))]
        titles = [column.label for column in columns]
        before, after = point(tuned.before), point(tuned.best)
        return {"points": tried, "before": before, "after": after, "titles": titles}

    def found(self, task: Task) -> Found:
        """The changed fields, then the metrics of the cost."""
        tuned: Tuning = task.result
        lines: list[tuple[str, str, str]] = []
        for path, value in tuned.best.changes.items():
            lines.append((field_title(path, self.scenario), number_text(self.scenario.get(path)), number_text(value)))
        for name in self.cost.names:
            column = named(name).column
            before, after = (
                "fails" if candidate.metrics is None else value_text(column, candidate.metrics[name])
                for candidate in (tuned.before, tuned.best)
            )
            limit = f", at most {number_text(self.cost.limits[name])}" if name in self.cost.limits else ""
            lines.append((f"{column.label}{limit}", before, after))
        remark = f"Candidates tried: {len(tuned.candidates)}."
        return Found(lines, remark, tuned.problem, tuned.tuned)


STUDY = TuningStudy
