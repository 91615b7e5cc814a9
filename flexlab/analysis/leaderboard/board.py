"""The leaderboard: all laws in all cases, computed on all cores and stored row by row; and the check of stored rows."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from flexlab import __version__
from flexlab.analysis.leaderboard.case import Case, Score, Variant
from flexlab.analysis.leaderboard.entry import INVALID, Entrant, Row, Task, compute, machine
from flexlab.analysis.leaderboard.figures import draw_case
from flexlab.analysis.leaderboard.store import RowStore, engine, row_key
from flexlab.analysis.result import Result, scenario_hash
from flexlab.analysis.workers import Told, Workers, chosen_workers
from flexlab.errors import ScenarioError, StudyError
from flexlab.scenario import Scenario
from flexlab.text import html_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Leaderboard(Result):
    """The rows of all laws in all cases; `cases` define the scores."""

    cases: tuple[Case, ...]
    rows: tuple[Row, ...]
    computed: int = 0
    """How many rows had to be computed."""
    scenarios: Mapping[str, str] = field(default_factory=dict)
    """Hash of the scenario by the key of its row; empty for rows that were only read."""

    @cached_property
    def laws(self) -> tuple[str, ...]:
        """The laws that entered, in their order."""
        return tuple(dict.fromkeys(row.law for row in self.rows))

    @cached_property
    def _by_place(self) -> dict[tuple[str, str, str], Row]:
        return {row.place: row for row in self.rows}

    def row(self, case: Case, variant: Variant, law: str) -> Row | None:
        """A law's row; None where the law did not enter."""
        return self._by_place.get((case.name, variant.name, law))

    def value(self, case: Case, variant: Variant, law: str, score: Score) -> float | None:
        """A law's score, SI; None where it has none."""
        row = self.row(case, variant, law)
        return None if row is None or row.failed else row.scores.get(score.name)

    @property
    def failed(self) -> tuple[Row, ...]:
        """The rows of laws that did not reach the end of the case."""
        return tuple(row for row in self.rows if row.failed)

    @cached_property
    def table(self) -> Any:
        """A row per law, case and score: its value in SI units and in the shown unit, with formula, seed and hashes."""
        lines: list[dict[str, Any]] = []
        for row in self.rows:
            for score in next(case for case in self.cases if case.name == row.case).scores:
                value, column = row.scores.get(score.name), score.column
                shown = None if value is None else column.scale * value
                about = {"score": score.name, "metric": score.metric_name, "title": column.title, "unit": column.unit}
                about |= {"value": value, "shown": shown, "formula": score.formula}
                lines.append(row.as_data() | about | {"scenario": self.scenarios.get(row.key)})
        return pa.Table.from_pylist(lines, schema=SCHEMA)

    def plot(self, case: str = "") -> "Figure":
        """The main score of every law in a case, such as "B1"; without a name, in the first case. Raises `StudyError`."""
        known = {each.name: each for each in self.cases}
        if case and case not in known:
            raise StudyError(f"{case!r:.40} is not a case here: choose one of {', '.join(known)}.")
        found = known[case] if case else self.cases[0]
        laws = [law for law in self.laws if any(row.law == law and row.case == found.name for row in self.rows)]
        values = [[self.value(found, variant, law, found.main) for variant in found.variants] for law in laws]
        shown = np.array(values, float)  # None becomes NaN, and stays it.
        return draw_case(found, laws, found.main.column.scale * np.maximum(shown, found.main.floor))

    def __repr__(self) -> str:
        cases = ", ".join(case.name for case in self.cases)
        return f"<Leaderboard in {cases}, laws: {len(self.laws)}, rows: {len(self.rows)}, failed: {len(self.failed)}>"

    def _repr_html_(self) -> str:
        places = [(case, variant) for case in self.cases for variant in case.variants]
        heads = ("law", *(f"{case.name} {variant.name}" for case, variant in places))
        lines = ([law, *(self._main(case, variant, law) for case, variant in places)] for law in self.laws)
        return html_table(lines, heads, caption=repr(self))

    def _main(self, case: Case, variant: Variant, law: str) -> str:
        row = self.row(case, variant, law)
        if row is None:
            return ""
        return row.status if row.failed else f"{case.main.text(row.scores[case.main.name])} {case.main.column.unit}"


_WORDS = ("law", "case", "variant", "score", "metric", "title")
_ABOUT = ("status", "sentence", "note", "formula", "result_hash", "key", "engine", "scenario", "version", "machine")
SCHEMA = pa.schema(
    [(name, pa.string()) for name in _WORDS]
    + [("value", pa.float64()), ("shown", pa.float64()), ("unit", pa.string()), ("seed", pa.int64())]
    + [(name, pa.string()) for name in _ABOUT]
)


def make_tasks(cases: Iterable[Case], entrants: Sequence[Entrant], seed: int = 0) -> tuple[Task, ...]:
    """The tasks of all cases, variants and laws; a law without the fields that a variant changes does not enter the variant."""
    plain = ((case, variant, case.plain_scenario(variant, seed)) for case in cases for variant in case.variants)
    found = (_task(*place, entrant, seed) for place in plain for entrant in entrants)
    return tuple(task for task in found if task is not None)


def _task(case: Case, variant: Variant, plain: Scenario, entrant: Entrant, seed: int) -> Task | None:
    scenario: Scenario | None = None
    problem, note = "", ""
    try:
        entered = entrant.scenario(plain, variant.law_fields)
        if entered is None:
            return None
        scenario, note = entered
    except ScenarioError as error:
        problem = str(error)
    note = "; ".join(filter(None, (entrant.settings, note)))
    row = Row(
        entrant.name, case.name, variant.name, INVALID, problem, note, {}, seed, result_hash="",
        key=row_key(entrant.name, case, variant, scenario, problem), engine=engine(), version=__version__, machine="",
    )  # fmt: skip
    return Task(case, scenario, row)


def compute_rows(tasks: Sequence[Task], workers: Workers | None) -> Iterator[Row]:
    """Yield the rows of some tasks as they are done; `workers` None: a thread per core. Raises `StudyError`."""
    if tasks:
        with (workers or chosen_workers())() as run:
            for _, row in run(compute, tasks):
                yield row


def run_board(
    tasks: Sequence[Task], store: RowStore, workers: Workers | None = None, told: Told = lambda done, total: None
) -> Leaderboard:
    """The leaderboard of all tasks: rows from the store, and the others, computed and stored. Raises `StudyError`.

    The computation may be interrupted: the same call then computes the remaining rows. `workers` None: a thread per core.
    """
    store.prepare()
    known = {task.row.key: row for task in tasks if (row := store.get(task.row.key)) is not None}
    # Long tasks come first, so that no core waits for one at the end.
    missing = sorted((task for task in tasks if task.row.key not in known), key=lambda task: -task.case.duration)
    done = len(tasks) - len(missing)
    told(done, len(tasks))
    for row in compute_rows(missing, workers):
        store.put(row)
        known[row.key] = row
        done += 1
        told(done, len(tasks))
    rows = tuple(known[task.row.key] for task in tasks)
    store.put_last(rows)
    scenarios = {task.row.key: scenario_hash(task.scenario) for task in tasks if task.scenario is not None}
    return Leaderboard(tuple(dict.fromkeys(task.case for task in tasks)), rows, len(missing), scenarios)


COMPARED = ("status", "sentence", "scores", "result_hash", "seed")


def verify(
    rows: Sequence[Row], tasks: Sequence[Task], workers: Workers | None = None, told: Told = lambda done, total: None
) -> Iterator[tuple[Row, str]]:
    """Compute the tasks of some rows again, without the store, and yield each row with what differs, if anything."""
    wanted = {task.row.place: task for task in tasks}
    there = {row.place: row for row in rows}
    again = [wanted[place] for place in there if place in wanted]
    for row in rows:
        if row.place not in wanted:
            yield row, "cannot be computed here: there is no such law or case; give the law's file with --law"
    for done, found in enumerate(compute_rows(again, workers), 1):
        yield there[found.place], _difference(there[found.place], found)
        told(done, len(again))


def _difference(kept: Row, found: Row) -> str:
    name = next((name for name in COMPARED if getattr(kept, name) != getattr(found, name)), "")
    if not name:
        return ""
    said, theirs, ours = name.replace("_", " "), getattr(kept, name), getattr(found, name)
    if name == "scores":
        odd = next(key for key in {**theirs, **ours} if theirs.get(key) != ours.get(key))
        said = f"the score {odd}"
        theirs, ours = ("none" if values.get(odd) is None else repr(values[odd]) for values in (theirs, ours))
    return f"{said} is {theirs!s:.200}, and {ours!s:.200} here{_reason(kept, found)}"


def _reason(kept: Row, found: Row) -> str:
    if kept.engine != found.engine:
        return f" (it was computed by flexlab {kept.version} with other sources, {kept.engine})"
    if kept.key != found.key:
        return " (the law, its settings or the case have changed since)"
    if kept.machine != machine():
        return f" (it was computed on another processor, {kept.machine})"
    return " (law, case and engine are the same: the table was changed)"
