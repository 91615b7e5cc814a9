"""Metrics as the notes on a recording hold them: numbers by title and unit, None for what had no value."""

from collections.abc import Mapping
from math import nan
from typing import Any

from flexlab.analysis.metrics.metric import METRICS, Column
from flexlab.analysis.metrics.run_metrics import DURATION, NOT_FINISHED, value_text

UNKNOWN = "–"


def measured(noted: Any) -> bool:
    """Whether the notes have all metrics of today: one that came later, or means something else now, is missing."""
    return isinstance(noted, Mapping) and all(
        column.key in noted for metric in METRICS.values() for column in metric.columns
    )


def results(noted: Mapping[str, Any], stopped: bool) -> dict[str, Any]:
    """The metrics that are results: of a run that stopped before its end only the duration, whatever earlier versions noted."""
    kept = {column.key for column in METRICS[DURATION].columns}
    return {key: None if stopped and key not in kept else value for key, value in noted.items()}


def noted_text(column: Column, noted: Mapping[str, Any], stopped: bool = False) -> str:
    """A number as a table shows it: "not settled" for one that had no value, "–" for one that was never measured.

    `stopped`: whether the run stopped before its end.
    """
    if column.key not in noted:
        return UNKNOWN
    value = results(noted, stopped)[column.key]
    if value is None and stopped:
        return NOT_FINISHED
    return value_text(column, nan if value is None else value)


def noted_value(column: Column, noted: Mapping[str, Any], stopped: bool = False) -> float:
    """A number to sort by: what has no value comes after all others."""
    value = results(noted, stopped).get(column.key)
    usable = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if usable else 1e300 if column.key in noted else 2e300


def noted_texts(noted: Mapping[str, Any], stopped: bool = False) -> dict[str, str]:
    """All of them by title and unit, those that this version does not know too."""
    columns = {column.key: column for metric in METRICS.values() for column in metric.columns}
    return {
        str(key): noted_text(columns[key], noted, stopped)
        if key in columns
        else value_text(Column("", "", "", ""), value)
        for key, value in noted.items()
    }
