"""Results of all studies: a table with its provenance, also as a data frame, and the hash of a run.

Two runs with the same `result_hash` are the same, bit for bit, wherever they were computed.
"""

import hashlib
import json
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlab import __version__
from flexlab.analysis.metrics.metric import named
from flexlab.errors import StudyError
from flexlab.files import DIGITS, short_hash
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples

if TYPE_CHECKING:
    import pandas


class Result(ABC):
    """The result of a sweep, tuning, fit, comparison, replay, validation or leaderboard."""

    @property
    @abstractmethod
    def table(self) -> Any:
        """A pyarrow table in SI units; its columns "scenario" (a hash) and "version" say where each row comes from."""

    def to_pandas(self) -> "pandas.DataFrame":
        """The table as a data frame. Raises `StudyError` where pandas is not installed."""
        try:
            return self.table.to_pandas()
        except ImportError:
            raise StudyError("pandas is not installed: pip install pandas brings it, or use .table.") from None


def scenario_hash(scenario: Scenario) -> str:
    """A hash of 16 digits over everything in a scenario but its texts."""
    return short_hash(json.dumps(scenario.model_dump(mode="json", exclude={"title", "watch"}), sort_keys=True))


def provenance(scenario: Scenario | None) -> dict[str, str | None]:
    """The provenance of a table's row: "scenario", its hash, if there is one, and "version", flexlab's."""
    return {"scenario": None if scenario is None else scenario_hash(scenario), "version": __version__}


def number_column(table: Any, name: str) -> np.ndarray:
    """A column of numbers of a pyarrow table, (rows,), SI, NaN for missing ones. Raises `StudyError` for an unknown name.

    Metrics are named as in "rms_error.y"; their short names of earlier versions give the units of tables.
    """
    scale = 1.0
    with suppress(StudyError):
        if not isinstance(name, str) or name not in table.column_names:
            found = named(name)
            name, scale = found.name, found.scale
    return scale * named_column(table, name).to_numpy(zero_copy_only=False).astype(float)


def named_column(table: Any, name: str) -> Any:
    """A column of a pyarrow table. Raises `StudyError` for an unknown name."""
    if not isinstance(name, str) or name not in table.column_names:
        raise StudyError(f"{name!r:.60} is not a column: there are {', '.join(table.column_names)}.")
    return table.column(name)


class ResultHash:
    """The hash of a run's samples, given in blocks of any size."""

    def __init__(self) -> None:
        self._signals: dict[str, hashlib._Hash] = {}

    def update(self, samples: Samples) -> None:
        """Add the next block of samples."""
        for name, values in samples.signals().items():
            hashed = self._signals.setdefault(name, hashlib.sha256())
            hashed.update(np.ascontiguousarray(values, dtype="<f8").tobytes())

    def text(self) -> str:
        """The hash of all blocks so far, `DIGITS` hexadecimal digits."""
        whole = hashlib.sha256()
        for name in sorted(self._signals):
            whole.update(name.encode() + self._signals[name].digest())
        return whole.hexdigest()[:DIGITS]


def result_hash(samples: Samples) -> str:
    """The hash of a run, or of a part of one."""
    gathered = ResultHash()
    gathered.update(samples)
    return gathered.text()
