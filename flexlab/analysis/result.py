"""What every study gives: a table for programs that says where it comes from, and the same as a data frame.

`result_hash` is one short text that says whether two results are the same, bit for bit, wherever they were computed.
"""

import hashlib
import json
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlab.analysis.metrics.metric import Number
from flexlab.errors import StudyError
from flexlab.recording.run_info import package_version
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples

if TYPE_CHECKING:
    import pandas


class Result(ABC):
    """Of a sweep, a tuning, a fit, a comparison, a replay, a validation or a leaderboard."""

    @property
    @abstractmethod
    def table(self) -> Any:
        """A pyarrow table: a row per case, SI units; "scenario" (a hash) and "version" say what it comes from."""

    def to_pandas(self) -> "pandas.DataFrame":
        """The table as a data frame. Raises `StudyError` where pandas is not installed."""
        try:
            return self.table.to_pandas()
        except ImportError:
            raise StudyError("pandas is not installed: pip install pandas brings it, or use .table.") from None


def scenario_hash(scenario: Scenario) -> str:
    """16 digits that only scenarios have that compute the same: texts do not count."""
    data = scenario.model_dump(mode="json", exclude={"title", "watch"})
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def provenance(scenario: Scenario) -> dict[str, str]:
    """What a table's row says of where it comes from: "scenario", a hash, and "version", of flexlab."""
    return {"scenario": scenario_hash(scenario), "version": package_version()}


def about_number(number: Number) -> dict[str, str]:
    """Metadata of a column: title and unit."""
    return {"title": number.column.title, "unit": number.column.si_unit}


DIGITS = 16
"""Of a hash, hexadecimal: two different results share it by chance once in 2⁶⁴."""


class ResultHash:
    """Hash of the samples of a run, gathered in blocks of any size: the same for lab, shell, Python and a file of them."""

    def __init__(self) -> None:
        self._signals: dict[str, hashlib._Hash] = {}

    def update(self, samples: Samples) -> None:
        """Take in the next block."""
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
