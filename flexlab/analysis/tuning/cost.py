"""What a tuning makes small, a weighted sum of metrics, and what it must not exceed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flexlab.analysis.metrics import METRICS, RunMetrics
from flexlab.errors import StudyError

FAILED = 1e12
"""Cost of a run that fails, and of each unit relative to its limit by which a limit is passed a millionth of it: any run that
keeps within its limits is better than one that does not, and that better than one that fails."""
NOT_SETTLED = 10.0
"""Times its length that a run which has not settled counts as settling time."""


@dataclass(frozen=True)
class Cost:
    """Weights and limits by the metrics' short names, as in "rms-y", in the units of tables."""

    weights: Mapping[str, float]
    limits: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """All metrics that count."""
        return tuple(dict.fromkeys((*self.weights, *self.limits)))

    def of(self, metrics: RunMetrics | None) -> float:
        """The cost of a run; of None, which failed, `FAILED`."""
        if metrics is None:
            return FAILED
        values = numbers_of(metrics)
        excess = sum(max(values[name] / limit - 1, 0.0) for name, limit in self.limits.items())
        total = sum(weight * values[name] for name, weight in self.weights.items())
        return min(total + FAILED * 1e-6 * excess, FAILED)

    def holds(self, metrics: RunMetrics) -> bool:
        """Whether a run keeps within the limits."""
        values = numbers_of(metrics)
        return all(values[name] <= limit for name, limit in self.limits.items())


def numbers_of(metrics: RunMetrics) -> dict[str, float]:
    """Short name → number as tables show it; a settling time that there is not counts as ten times the run's length."""
    numbers = {row.column.field: row.value for row in metrics.rows}
    return {name: NOT_SETTLED * metrics.duration if math.isnan(value) else value for name, value in numbers.items()}


def parse_cost(weights: Sequence[str] | Mapping[str, float], limits: Sequence[str] | Mapping[str, float] = ()) -> Cost:
    """A cost of texts `rms-y=1` or of mappings; a weight may be left out, it is then 1. Raises `StudyError`."""
    cost = Cost(_numbers("cost", weights, default=1.0), _numbers("limit", limits, default=None))
    if not cost.weights:
        raise StudyError("The cost names no metric: say what is to be small, as in rms-y=1,force=0.01.")
    return cost


def _numbers(what: str, given: Sequence[str] | Mapping[str, float], default: float | None) -> dict[str, float]:
    if isinstance(given, Mapping):
        pairs = [(str(name), value) for name, value in given.items()]
    else:
        texts = [word.strip() for text in ([given] if isinstance(given, str) else given) for word in text.split(",")]
        pairs = [tuple(part.strip() for part in text.partition("=")[::2]) for text in texts if text]
    known = [column.field for metric in METRICS.values() for column in metric.columns]
    found: dict[str, float] = {}
    for name, value in pairs:
        if name not in known:
            raise StudyError(f"{what}: {name!r:.60} is no metric: choose from {', '.join(known)}.")
        try:
            number = default if value == "" else float(value)
        except (TypeError, ValueError):
            number = None
        if number is None or not math.isfinite(number) or number <= 0:
            raise StudyError(f"{what}: {name}={value!s:.60} is not usable: give a number above 0.")
        if name in found:
            raise StudyError(f"{what}: {name} is named twice.")
        found[name] = number
    return found
