"""Whether rows come out again, bit for bit: every task computed anew and compared with the row that is kept."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from flexlab.analysis.leaderboard.board import compute_rows
from flexlab.analysis.leaderboard.content import machine
from flexlab.analysis.leaderboard.row import Row, Task
from flexlab.analysis.sweep.execution import Told

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
    workers: int | None = None,
    told: Told = lambda done, total: None,
) -> Iterator[Finding]:
    """Compute the tasks of the rows again, whatever is kept of them, and say of each row what differs."""
    wanted = {task.place: task for task in tasks}
    there = {row.place: row for row in rows}
    again = [wanted[place] for place in there if place in wanted]
    for row in rows:
        if row.place not in wanted:
            yield Finding(row, "cannot be computed here: there is no such law or case; give the law's file with --law")
    for done, found in enumerate(compute_rows(again, workers) if again else (), 1):
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
