"""All laws in all cases: what is not known yet is computed, on all cores, and kept as it is done."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from flexlab.analysis.leaderboard.case import Case, Variant
from flexlab.analysis.leaderboard.entry import Entrant, Row, Task, compute
from flexlab.analysis.leaderboard.store import RowStore, engine, machine, row_key
from flexlab.analysis.result import Result
from flexlab.analysis.workers import Told, Workers, chosen_workers
from flexlab.errors import ScenarioError, StudyError
from flexlab.recording.run_info import package_version
from flexlab.scenario import Scenario
from flexlab.text import html_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Leaderboard(Result):
    """Rows of laws in cases; `cases` say what the scores are."""

    cases: tuple[Case, ...]
    rows: tuple[Row, ...]
    computed: int = 0
    """How many rows were not known before."""

    @cached_property
    def laws(self) -> tuple[str, ...]:
        """Those that entered, in their order."""
        return tuple(dict.fromkeys(row.law for row in self.rows))

    @cached_property
    def _by_place(self) -> dict[tuple[str, str, str], Row]:
        return {row.place: row for row in self.rows}

    def row(self, case: Case, variant: Variant, law: str) -> Row | None:
        """One row; None where the law did not enter."""
        return self._by_place.get((case.name, variant.name, law))

    @property
    def failed(self) -> tuple[Row, ...]:
        """Laws that did not come to the end of a case."""
        return tuple(row for row in self.rows if row.failed)

    @cached_property
    def table(self) -> pa.Table:
        """A row per law, case and score: value in SI units and in the unit that is shown, with formula, seed and hashes."""
        return pa.Table.from_pylist(list(self._lines()), schema=SCHEMA)

    def _lines(self) -> Iterator[dict[str, Any]]:
        for row in self.rows:
            about = row.as_data()
            del about["scores"]
            for score in next(case for case in self.cases if case.name == row.case).scores:
                value = row.scores.get(score.name)
                yield {
                    **about,
                    "score": score.name,
                    "metric": score.metric_name,
                    "title": score.column.title,
                    "value": value,
                    "shown": None if value is None else score.column.scale * value,
                    "unit": score.column.unit,
                    "formula": score.formula,
                }

    def plot(self, case: str = "") -> "Figure":
        """The main score of every law in a case, by its name; the first case without one. Raises `StudyError`."""
        from flexlab.analysis.leaderboard.report import draw_case

        found = [each for each in self.cases if each.name == (case or self.cases[0].name)]
        if not found:
            raise StudyError(
                f"{case!r:.40} is no case here: choose one of {', '.join(each.name for each in self.cases)}."
            )
        return draw_case(self, found[0])

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        cases = ", ".join(case.name for case in self.cases)
        return f"<Leaderboard of {len(self.laws)} laws in {cases}: {len(self.rows)} rows{failed}>"

    def _repr_html_(self) -> str:
        """Laws and their main scores, for notebooks."""
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
_ABOUT = ("status", "sentence", "note", "formula", "result_hash", "key", "engine", "version", "machine")
SCHEMA = pa.schema(
    [(name, pa.string()) for name in _WORDS]
    + [("value", pa.float64()), ("shown", pa.float64()), ("unit", pa.string()), ("seed", pa.int64())]
    + [(name, pa.string()) for name in _ABOUT]
)
"""Columns of the table."""


def make_tasks(cases: Iterable[Case], entrants: Sequence[Entrant], seed: int = 0) -> tuple[Task, ...]:
    """All rows that are to be, by cases, variants and laws; a law that lacks what a variant changes does not enter there."""
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
    key = row_key(entrant.name, case, variant, scenario, problem)
    return Task(entrant, case, variant, scenario, problem, note, seed, key)


def compute_rows(tasks: Sequence[Task], workers: Workers) -> Iterator[Row]:
    """The rows of some tasks as they are done. Raises `StudyError`."""
    with workers() as run:
        for _, row in run(partial(_compute, engine(), package_version()), tasks):
            yield row


def _compute(engine: str, version: str, task: Task) -> Row:
    return compute(task, engine, version, machine())


def run_board(
    tasks: Sequence[Task], store: RowStore, workers: Workers | None = None, told: Told = lambda done, total: None
) -> Leaderboard:
    """The rows of all tasks: those in the store, and the others computed and put there. Raises `StudyError`.

    `workers`: None: a thread per core.

    May be interrupted at any time: the same call goes on with the rows that are not done.
    """
    store.prepare()
    known = {task.key: row for task in tasks if (row := store.get(task.key)) is not None}
    # Long ones first: they would otherwise be what all others have been done for long ago.
    missing = sorted((task for task in tasks if task.key not in known), key=lambda task: -task.case.duration)
    done = len(tasks) - len(missing)
    told(done, len(tasks))
    for row in compute_rows(missing, workers or chosen_workers()) if missing else ():
        store.put(row)
        known[row.key] = row
        done += 1
        told(done, len(tasks))
    rows = tuple(known[task.key] for task in tasks)
    store.put_last(rows)
    return Leaderboard(tuple(dict.fromkeys(task.case for task in tasks)), rows, len(missing))


COMPARED = ("status", "sentence", "scores", "result_hash", "seed")


@dataclass(frozen=True)
class Finding:
    """What came of one kept row."""

    row: Row
    sentence: str
    """What differs; empty: nothing, to the last bit."""


def verify(
    rows: Sequence[Row],
    tasks: Sequence[Task],
    workers: Workers | None = None,
    told: Told = lambda done, total: None,
) -> Iterator[Finding]:
    """Compute the tasks of the rows again, whatever is kept of them, and say of each row what differs."""
    wanted = {task.place: task for task in tasks}
    there = {row.place: row for row in rows}
    again = [wanted[place] for place in there if place in wanted]
    for row in rows:
        if row.place not in wanted:
            yield Finding(row, "cannot be computed here: there is no such law or case; give the law's file with --law")
    for done, found in enumerate(compute_rows(again, workers or chosen_workers()) if again else (), 1):
        yield Finding(there[found.place], _difference(there[found.place], found))
        told(done, len(again))


def _difference(kept: Row, found: Row) -> str:
    ours, theirs = found.as_data(), kept.as_data()
    for name in COMPARED:
        if ours[name] != theirs[name]:
            return f"{_words(name, theirs[name], ours[name])}{_reason(kept, found)}"
    return ""


def _words(name: str, kept: object, found: object) -> str:
    if name == "scores" and isinstance(kept, Mapping) and isinstance(found, Mapping):
        odd = next(key for key in {**kept, **found} if kept.get(key) != found.get(key))
        return f"the score {odd} is {_number(kept.get(odd))}, and {_number(found.get(odd))} here"
    return f"{name.replace('_', ' ')} is {kept!s:.200}, and {found!s:.200} here"


def _number(value: object) -> str:
    return "none" if value is None else f"{value!r}"


def _reason(kept: Row, found: Row) -> str:
    if kept.engine != found.engine:
        return f" (it was computed by flexlab {kept.version} with other sources, {kept.engine})"
    if kept.key != found.key:
        return " (the law, its settings or the case were others then)"
    if kept.machine != machine():
        return f" (it was computed on another processor, {kept.machine})"
    return " (law, case and engine are the same: the table was changed)"
