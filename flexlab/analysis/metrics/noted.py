"""Metrics as the notes on a recording hold them: numbers by title and unit, None for what had no value."""

from collections.abc import Mapping
from math import nan
from typing import Any

from flexlab.analysis.metrics.metric import METRICS, Column
from flexlab.analysis.metrics.run_metrics import value_text

UNKNOWN = "–"


def measured(noted: Any) -> bool:
    """Whether the notes have all metrics of today: one that came later, or means something else now, is missing."""
    return isinstance(noted, Mapping) and all(
        column.key in noted for metric in METRICS.values() for column in metric.columns
    )


def noted_text(column: Column, noted: Mapping[str, Any]) -> str:
    """A number as a table shows it: "not settled" for one that had no value, "–" for one that was never measured."""
    if column.key not in noted:
        return UNKNOWN
    value = noted[column.key]
    return value_text(column, nan if value is None else value)


def noted_value(column: Column, noted: Mapping[str, Any]) -> float:
    """A number to sort by: what has no value comes after all others."""
    value = noted.get(column.key)
    usable = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if usable else 1e300 if column.key in noted else 2e300


def noted_texts(noted: Mapping[str, Any]) -> dict[str, str]:
    """All of them by title and unit, those that this version does not know too."""
    columns = {column.key: column for metric in METRICS.values() for column in metric.columns}
    return {
        str(key): noted_text(columns[key], noted) if key in columns else value_text(Column("", "", "", ""), value)
        for key, value in noted.items()
    }
