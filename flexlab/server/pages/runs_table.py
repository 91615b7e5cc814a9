"""What the table of runs shows, for the start page and the library."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from flexlab.analysis.metrics import METRICS
from flexlab.analysis.metrics.noted import noted_text, noted_value
from flexlab.recording.store.run_index import RunRow
from flexlab.scenario.field_text import field_title


@dataclass(frozen=True)
class TableColumn:
    """The head of a column. `kind`: how it is sorted."""

    name: str
    kind: str
    title: str
    unit: str = ""


COLUMNS = tuple(
    TableColumn(name, kind, name)
    for name, kind in (
        ("Started", "time"),
        ("Preset", "text"),
        ("Duration", "number"),
        ("Size", "number"),
        ("State", "text"),
    )
)
METRIC_COLUMNS = [column for metric in METRICS.values() for column in metric.columns if column.listed]
"""Those of which a table has room; a run's own page has all."""
LAST_COLUMNS = (
    TableColumn("Note, changes", "text", "Note, and what was changed against the preset"),
    TableColumn("", "text", ""),
)
PATH = re.compile(r"[a-z_0-9]+(\.[a-z_0-9]+)*")
CHANGES_SHOWN = 3
"""Of what was changed in a run, how many lines stand in the table."""


def table_values(rows: Sequence[RunRow], short: bool = False) -> dict[str, Any]:
    """The values of `runs_table.html`; the short table has no metrics, notes and actions."""
    metrics = (TableColumn(_capital(c.heading), "number", c.key, f"[{c.unit}]") for c in METRIC_COLUMNS)
    return {
        "rows": rows,
        "short": short,
        "columns": COLUMNS if short else (*COLUMNS, *metrics, *LAST_COLUMNS),
        "metric_columns": METRIC_COLUMNS,
        "noted_text": noted_text,
        "noted_value": noted_value,
        "changes_text": _changes_text,
    }


def _changes_text(row: RunRow) -> str:
    left = len(row.changes) - CHANGES_SHOWN
    return "; ".join(map(_in_words, row.changes[:CHANGES_SHOWN])) + (f"; {left} more" if left > 0 else "")


def _in_words(change: str) -> str:
    """A change against the preset, "path: old → new" in the notes, with the field's title."""
    path, colon, values = change.partition(": ")
    return f"{field_title(path)}: {values}" if colon and PATH.fullmatch(path) else change


def _capital(heading: str) -> str:
    return heading[0].upper() + heading[1:]
