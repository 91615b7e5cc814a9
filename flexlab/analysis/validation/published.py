"""Rows of the leaderboard that ships with flexlab, computed again here: the same bits on every machine."""

from collections.abc import Iterator

from flexlab.analysis.leaderboard.board import make_tasks, verify
from flexlab.analysis.leaderboard.case import cases
from flexlab.analysis.leaderboard.entry import entrants
from flexlab.analysis.leaderboard.store import shipped_rows
from flexlab.analysis.validation.check import Check, Runs, subject, true

FIRST = 3
"""Number of the law of the first row. With it the grips that give way are held by a law whose run takes few steps."""


@subject("The published leaderboard", 25)
def published(_: Runs) -> Iterator[Check]:
    """A row of every variant of every case, with the laws in turn: status, sentence, scores and all samples."""
    rows = shipped_rows()
    laws = list(dict.fromkeys(row.law for row in rows))
    variants = dict.fromkeys((row.case, row.variant) for row in rows)
    chosen = {(*variant, laws[(FIRST + number) % len(laws)]) for number, variant in enumerate(variants)}
    kept = [row for row in rows if row.place in chosen]
    tasks = make_tasks(cases().values(), tuple(entrants().values()), seed=kept[0].seed)
    for row, difference in sorted(verify(kept, tasks), key=lambda found: found[0].place):
        yield true(f"{row.law} in {row.case} {row.variant}".rstrip() + ": every bit", not difference, difference)
