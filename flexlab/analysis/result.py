"""What every study gives: a table for programs that says where it comes from, and the same as a data frame."""

import hashlib
import json
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from flexlab.analysis.metrics.names import Number
from flexlab.errors import StudyError
from flexlab.recording.run_info import package_version
from flexlab.scenario import Scenario

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
