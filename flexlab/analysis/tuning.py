"""Tuning: a search, within stated bounds, for the parameters with the least cost.

The cost is a weighted sum of metrics under limits. The search is differential evolution on all cores, after Storn and Price,
J. Global Optim. 11 (1997) 341 (scipy.optimize). In a robust tuning, the worst of several scenarios gives a candidate's cost.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from flexlab.analysis.figures import BLUE, GRAY, VERMILION, empty_figure, style
from flexlab.analysis.metrics import RunMetrics
from flexlab.analysis.metrics.metric import named
from flexlab.analysis.result import Result, provenance
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.figures import SIZE, pareto_front
from flexlab.analysis.sweep.plan import measured
from flexlab.analysis.workers import Told, Workers, chosen_workers
from flexlab.arguments import whole_number
from flexlab.errors import FlexlabError, StudyError
from flexlab.lapack import one_blas_thread
from flexlab.scenario import Scenario
from flexlab.scenario.settings import change_settings
from flexlab.sim.simulate import sample_count
from flexlab.sim.snapshot import TICK
from flexlab.text import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WITHIN, BEYOND, FAILS = range(3)
"""Outcomes of a candidate, from best to worst: within the limits, beyond them, a run that fails."""
STAGE = 1000.0
"""Penalty of the search from one outcome to the next: more than asinh of any number."""
NOT_SETTLED = 10.0
"""The settling time of a run that has not settled, in durations of the run."""
SETTLING = "settling_time"


@dataclass(frozen=True)
class Cost:
    """Weights and limits by metric: "rms_error.y" in SI units, earlier names such as "rms-y" in the units of tables."""

    weights: Mapping[str, float]
    limits: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """All metrics with a weight or a limit."""
        return tuple(dict.fromkeys((*self.weights, *self.limits)))

    def traded(self, *wanted: str) -> list[str]:
        """The two metrics of a trade-off: the `wanted` ones, then those of the cost, then usual ones. Raises `StudyError`."""
        found: dict[str, str] = {}
        for name in (*wanted, *self.names, "rms_error.y", "rms_internal_force"):
            found.setdefault(named(name).name, name)
        return list(found.values())[:2]

    def of(self, metrics: RunMetrics | None) -> float:
        """The weighted sum of metrics, whatever the limits; NaN for None, a failed run, and if a metric has no value."""
        if metrics is None or self.lacks(metrics):
            return math.nan
        values = numbers_of(metrics)
        return sum(weight * values[name] for name, weight in self.weights.items())

    def excess(self, metrics: RunMetrics | None) -> float:
        """The sum of a run's relative excesses over the limits: 0 within all limits, NaN as in `of`.

        A run that has not settled exceeds every limit of its settling time, by more than any run that has.
        """
        if metrics is None or self.lacks(metrics):
            return math.nan
        values = numbers_of(metrics)
        return sum(
            max(values[name] - limit, NOT_SETTLED * limit if math.isnan(metrics[name]) else 0.0) / limit
            for name, limit in self.limits.items()
        )

    def holds(self, metrics: RunMetrics) -> bool:
        """Whether a run keeps within the limits."""
        return self.excess(metrics) == 0

    def lacks(self, metrics: RunMetrics) -> str:
        """Why the run has no cost: a sentence naming the metric without a value, or "" if there is a cost."""
        values = numbers_of(metrics)
        missing = [name for name in self.names if math.isnan(values[name])]
        return f"The metric {missing[0]} has no value in this run." if missing else ""


def numbers_of(metrics: RunMetrics) -> dict[str, float]:
    """Value by each name of a metric, NaN if missing; the settling time of an unsettled run is ten times its duration."""
    found = metrics.by_name()
    found |= {row.column.field: row.value for row in metrics.rows}
    if math.isnan(metrics[SETTLING]):
        found[SETTLING] = found[named(SETTLING).column.field] = NOT_SETTLED * metrics.duration
    return found


def parse_cost(weights: Sequence[str] | Mapping[str, float], limits: Sequence[str] | Mapping[str, float] = ()) -> Cost:
    """A cost from texts such as `rms_error.y=1`, or from mappings; a missing weight is 1. Raises `StudyError`."""
    cost = Cost(_numbers("cost", weights, default=1.0), _numbers("limit", limits, default=None))
    if not cost.weights:
        example = "rms_error.y=1,rms_internal_force=0.01"
        raise StudyError(f"The cost names no metric: say what is to be small, as in {example}.")
    return cost


def _numbers(what: str, given: Sequence[str] | Mapping[str, float], default: float | None) -> dict[str, float]:
    named_ones = isinstance(given, (Mapping, str))
    if not named_ones and not (isinstance(given, Sequence) and all(isinstance(text, str) for text in given)):
        example = '{"rms_error.y": 1.0} or ["rms_error.y=1"]'
        raise StudyError(f"{what} = {given!r:.60} is not usable: give metrics by name, as in {example}.")
    if isinstance(given, Mapping):
        pairs = [(str(name), value) for name, value in given.items()]
    else:
        texts = [word.strip() for text in ([given] if isinstance(given, str) else given) for word in text.split(",")]
        pairs = [tuple(part.strip() for part in text.partition("=")[::2]) for text in texts if text]
    found: dict[str, float] = {}
    for word, value in pairs:
        try:
            metric = named(word)
        except StudyError as error:
            raise StudyError(f"{what}: {error}") from None
        name = word if word == metric.name else metric.column.field  # In place of a title with its unit.
        try:
            number = default if value == "" else float(value)
        except (TypeError, ValueError, OverflowError):
            number = None
        if number is None or not math.isfinite(number) or number <= 0:
            raise StudyError(f"{what}: {name}={value!s:.60} is not usable: give a number above 0.")
        if first := next((one for one in found if named(one).name == metric.name), None):
            raise StudyError(f"{what}: {name} is named twice{'' if first == name else f', also as {first}'}.")
        found[name] = number
    return found


FEWEST_CANDIDATES, MOST_CANDIDATES = 8, 100_000
BELOW_ONE = 1 - 1e-12
"""Largest share of a range: `Axis.at` takes shares below 1."""
CANDIDATES_PER_FIELD = 8
"""Candidates in a generation, per varied field."""


@dataclass(frozen=True)
class Candidate:
    """One set of parameters and its cost."""

    changes: dict[str, Any]
    cost: float
    """Weighted sum of metrics; NaN if the candidate fails."""
    excess: float
    """Sum of the relative excesses over the limits; NaN if the candidate fails."""
    metrics: RunMetrics | None
    """Metrics in the worst scenario; None: the run fails there."""
    reason: str
    """Why it fails."""

    @property
    def rank(self) -> tuple[int, float, float]:
        """The sort key of the search: those within the limits by cost, then those beyond by excess, then those that fail."""
        if math.isnan(self.cost):
            return FAILS, 0.0, 0.0
        return (BEYOND, self.excess, self.cost) if self.excess > 0 else (WITHIN, 0.0, self.cost)

    @property
    def numbers(self) -> dict[str, float]:
        """Value by each name of a metric, as from `numbers_of`; empty if the candidate fails."""
        return {} if self.metrics is None else numbers_of(self.metrics)


@dataclass(frozen=True)
class Tuning(Result):
    """All candidates of a search; the first is the scenario as it was, the others follow by cost."""

    scenario: Scenario
    cost: Cost
    candidates: tuple[Candidate, ...]

    @property
    def before(self) -> Candidate:
        """The scenario as it was."""
        return self.candidates[0]

    @property
    def best(self) -> Candidate:
        """The candidate within the limits that costs least, or else the one that exceeds them least."""
        return min(self.candidates, key=lambda candidate: candidate.rank)

    @property
    def tuned(self) -> Scenario:
        """The scenario with the best parameters."""
        return change_settings(self.scenario, self.best.changes)

    @property
    def holds(self) -> bool:
        """Whether the best candidate keeps within the limits."""
        return self.best.rank[0] == WITHIN

    @property
    def problem(self) -> str:
        """A sentence on what is wrong with the best candidate, or ""."""
        changed = self.candidates[1:]
        if changed and all(candidate.reason for candidate in changed):
            return f"Every run that was tried fails: {self.best.reason or changed[0].reason}"
        return "" if self.holds else "Nothing that was tried keeps within the limits: widen the ranges or the limits."

    @cached_property
    def table(self) -> Any:
        """A row per candidate, first the scenario as it was, then from the best: changes, cost, excess, metrics by name, SI.

        The excess is as in `Candidate`; cost and excess of a candidate that fails are null.
        """
        paths = dict.fromkeys(path for candidate in self.candidates for path in candidate.changes)
        known = dict.fromkeys(name for each in self.candidates if each.metrics for name in each.metrics.by_name())
        names, rows = [name for name in known if name not in ("cost", "excess")], []
        for candidate in self.candidates:
            found = {} if candidate.metrics is None else candidate.metrics.by_name()
            rows.append(
                {path: candidate.changes.get(path, self._before(path)) for path in paths}
                | {"cost": _told(candidate.cost), "excess": _told(candidate.excess), "sentence": candidate.reason}
                | {name: _told(found.get(name, math.nan)) for name in names}
                | self._provenance(candidate)
            )
        return pa.Table.from_pylist(rows)

    def _before(self, path: str) -> float | None:
        """The number of a field before tuning, or None; one of several equal numbers, as they are varied together."""
        value = self.scenario.get(path) if self.scenario.has(path) else None
        if isinstance(value, tuple) and len(set(value)) == 1:
            (value,) = set(value)
        return value if isinstance(value, (int, float)) else None

    def _provenance(self, candidate: Candidate) -> dict[str, Any]:
        """Scenario and version of a candidate; no scenario if it is invalid."""
        try:
            return provenance(change_settings(self.scenario, candidate.changes))
        except FlexlabError:
            return provenance(None)

    def plot(self, first: str = "", second: str = "") -> "Figure":
        """The trade-off between two metrics among all candidates; by default the first two of the cost. Raises `StudyError`."""
        wanted = (named(name).name for name in (first, second) if not isinstance(name, str) or name)
        first, second = self.cost.traded(*wanted)
        found = [candidate.metrics for candidate in self.candidates if candidate.metrics is not None]
        x, y = (np.array([metrics[name] for metrics in found]) for name in (first, second))
        with style():
            figure = empty_figure(*SIZE)
            axes = figure.add_subplot()
            axes.plot(x, y, "o", color=GRAY, markersize=3, alpha=0.6, label="tried")
            best = pareto_front(x, y)
            axes.step(x[best], y[best], "-", where="post", color=GRAY, linewidth=1)
            for candidate, color, words in ((self.before, VERMILION, "before"), (self.best, BLUE, "chosen")):
                if metrics := candidate.metrics:
                    axes.plot(metrics[first], metrics[second], "o", color=color, markersize=8, label=words)
            axes.set_xlabel(named(first).title)
            axes.set_ylabel(named(second).title)
            for name, draw in ((first, axes.axvline), (second, axes.axhline)):
                if name in self.cost.limits:
                    draw(self.cost.limits[name], color=VERMILION, linestyle=":", linewidth=1)
            axes.legend(frameon=False)
        return figure

    def __repr__(self) -> str:
        found = ", ".join(f"{path} = {value:.5g}" for path, value in self.best.changes.items()) or "nothing better"
        before = ("{:.4g}", "{:.4g} beyond the limits", "of a failure")[self.before.rank[0]].format(self.before.cost)
        costs = f"cost {before} → {self.best.cost:.4g}"
        return f"<Tuning of {counted(len(self.candidates), 'candidate')}: {self.problem or f'{costs}, {found}'}>"


def tune(
    scenario: Scenario,
    axes: Sequence[Axis],
    cost: Cost,
    robust: Sequence[Axis] = (),
    duration: float = 3.0,
    candidates: int = 200,
    seed: int = 0,
    told: Told = lambda done, total: None,
    workers: Workers | None = None,
) -> Tuning:
    """Search the ranges `axes` for the least `cost`, the worst over all combinations of `robust`. Raises `StudyError`.

    `workers`: None for one thread per core.
    """
    from scipy.optimize import differential_evolution  # It is slow to load.

    sample_count(duration, TICK)
    for axis in axes:
        if axis.low is None:
            raise StudyError(f"{axis.path}: a range is searched, not a list: write LOW:HIGH or LOW:HIGH:log.")
    if not axes:
        raise StudyError("Nothing may change: say what, as in controller.feedback_gain=50:500:log.")
    if both := {axis.path for axis in axes} & {axis.path for axis in robust}:
        raise StudyError(f"{min(both)} is both searched and varied by robust: leave it out of one of them.")
    candidates = whole_number("candidates", candidates, FEWEST_CANDIDATES, MOST_CANDIDATES)
    variants = [
        change_settings(scenario, dict(zip((axis.path for axis in robust), values, strict=True)))
        for values in product(*(axis.values for axis in robust))
    ]
    tried = [tried_in(variants, cost, duration, {})]
    if tried[0].metrics is None and not any(axis.path.startswith("controller") for axis in axes):
        raise StudyError(f"The scenario fails as it is: {tried[0].reason}")

    size = max(5, min(CANDIDATES_PER_FIELD * len(axes), candidates // 3))
    start = np.random.default_rng(whole_number("seed", seed, 0))
    with one_blas_thread(), (workers or chosen_workers())() as run:

        def costs(_: object, generation: Iterable[np.ndarray]) -> list[float]:
            """The costs of a generation, given as shares of the ranges; of candidates too many, infinity."""
            every = list(generation)
            changes = [
                {axis.path: axis.at(min(float(share), BELOW_ONE)) for axis, share in zip(axes, shares, strict=True)}
                for shares in every[: candidates - len(tried)]
            ]
            first, found = len(tried), dict[int, Candidate]()
            for number, candidate in run(partial(tried_in, variants, cost, duration), changes):
                found[number] = candidate
                told(first + len(found), candidates)
            tried.extend(found[number] for number in range(len(changes)))
            beyond = [math.inf] * (len(every) - len(changes))
            return [_energy(candidate, abs(tried[0].cost)) for candidate in tried[first:]] + beyond

        differential_evolution(
            lambda shares: costs(None, [shares])[0],
            [(0.0, 1.0)] * len(axes), init=start.random((size, len(axes))), maxiter=math.ceil((candidates - 1) / size) - 1,
            rng=start, updating="deferred", workers=costs, polish=False, tol=0, atol=1e-6,
        )  # fmt: skip
    return Tuning(scenario, cost, (tried[0], *sorted(tried[1:], key=lambda item: (item.rank, str(item.changes)))))


def _energy(candidate: Candidate, scale: float) -> float:
    """One number that orders candidates as their rank does; `scale`: the cost of one, NaN or 0 if there is none."""
    stage, excess, cost = candidate.rank
    size = cost / scale if scale > 0 else cost
    return STAGE * stage + min(math.asinh(excess if stage == BEYOND else size), STAGE - 1)


def _told(value: float) -> float | None:
    return None if math.isnan(value) else value


def tried_in(variants: Sequence[Scenario], cost: Cost, duration: float, changes: dict[str, Any]) -> Candidate:
    """The candidate with these changes, as it does in the worst of several scenarios."""
    found: list[Candidate] = []
    for variant in variants:
        run = measured(variant, changes, duration, TICK)
        reason = run.sentence if run.metrics is None else cost.lacks(run.metrics)
        found.append(Candidate(changes, cost.of(run.metrics), cost.excess(run.metrics), run.metrics, reason))
        if found[-1].rank[0] == FAILS:
            break
    return max(found, key=lambda candidate: candidate.rank)
