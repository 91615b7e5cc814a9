"""The search for the parameters that cost least: differential evolution within bounds, on all cores.

Storn and Price, J. Global Optim. 11 (1997) 341 (scipy.optimize). Robust if asked: a candidate costs what it costs in the worst
of a set of scenarios.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from flexlab.analysis.metrics import RunMetrics
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.cell import measure
from flexlab.analysis.tuning.cost import FAILED, Cost
from flexlab.errors import FlexlabError, StudyError
from flexlab.scenario import Scenario
from flexlab.scenario.settings import change_settings
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.simulate import sample_count
from flexlab.sim.world import World

FEWEST_CANDIDATES, MOST_CANDIDATES = 8, 100_000
BELOW_ONE = 1 - 1e-12
"""Largest share of a range: shares are below 1."""
CANDIDATES_PER_FIELD = 8
"""Of a generation."""


@dataclass(frozen=True)
class Candidate:
    """Parameters that were tried."""

    changes: dict[str, Any]
    cost: float
    metrics: RunMetrics | None
    """Of the scenario in which it costs most; None: it fails there."""
    reason: str
    """Why it fails."""


@dataclass(frozen=True)
class Tuning:
    """What a search tried; the first candidate is the scenario as it was."""

    scenario: Scenario
    cost: Cost
    candidates: tuple[Candidate, ...]

    @property
    def before(self) -> Candidate:
        """The scenario as it was."""
        return self.candidates[0]

    @property
    def best(self) -> Candidate:
        """The candidate that costs least."""
        return min(self.candidates, key=lambda candidate: candidate.cost)

    @property
    def tuned(self) -> Scenario:
        """The scenario with the best parameters."""
        return change_settings(self.scenario, self.best.changes)

    def __repr__(self) -> str:
        found = ", ".join(f"{path} = {value:.5g}" for path, value in self.best.changes.items()) or "nothing better"
        return f"<Tuning of {len(self.candidates)} candidates: cost {self.before.cost:.4g} → {self.best.cost:.4g}, {found}>"


def tune(
    scenario: Scenario,
    axes: Sequence[Axis],
    cost: Cost,
    robust: Sequence[Axis] = (),
    duration: float = 3.0,
    candidates: int = 200,
    seed: int = 0,
    told: Callable[[int, int], None] = lambda done, total: None,
) -> Tuning:
    """Search the ranges `axes` for the least `cost`, the worst over all combinations of `robust`. Raises `StudyError`."""
    sample_count(duration, 0.001)
    for axis in axes:
        if axis.low is None:
            raise StudyError(f"{axis.path}: a range is searched, not a list: write LOW:HIGH or LOW:HIGH:log.")
    if not axes:
        raise StudyError("Nothing may change: say what, as in controller.feedback_gain=50:500:log.")
    if (
        isinstance(candidates, bool)
        or not isinstance(candidates, int)
        or not FEWEST_CANDIDATES <= candidates <= MOST_CANDIDATES
    ):
        limits = f"{FEWEST_CANDIDATES} to {MOST_CANDIDATES}"
        raise StudyError(f"candidates = {candidates!r:.60} is not usable: give a whole number from {limits}.")
    variants = [
        change_settings(scenario, dict(zip((axis.path for axis in robust), values, strict=True)))
        for values in product(*(axis.values for axis in robust))
    ]
    tried = [_try(variants, {}, cost, duration)]
    if tried[0].metrics is None and not any(axis.path.startswith("controller") for axis in axes):
        raise StudyError(f"The scenario fails as it is: {tried[0].reason}")

    def one(shares: np.ndarray) -> float:
        changes = {axis.path: axis.at(min(float(share), BELOW_ONE)) for axis, share in zip(axes, shares, strict=True)}
        tried.append(_try(variants, changes, cost, duration))
        told(len(tried), candidates)
        return tried[-1].cost

    size = max(5, min(CANDIDATES_PER_FIELD * len(axes), candidates // 3))
    rounds = max(candidates // size - 1, 1)
    start = np.random.default_rng(seed)
    population = start.random((size, len(axes)))
    with one_blas_thread(), ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="flexlab-tune") as pool:
        ordered: Callable[..., Iterable[float]] = lambda function, values: list(pool.map(function, list(values)))  # noqa: E731
        differential_evolution(
            one, [(0.0, 1.0)] * len(axes), init=population, maxiter=rounds, rng=start, updating="deferred",
            workers=ordered, polish=False, tol=1e-6,
        )  # fmt: skip
    return Tuning(scenario, cost, (tried[0], *sorted(tried[1:], key=lambda item: (item.cost, str(item.changes)))))


def _try(variants: Sequence[Scenario], changes: dict[str, Any], cost: Cost, duration: float) -> Candidate:
    worst: Candidate | None = None
    for variant in variants:
        metrics, reason = _run(variant, changes, duration)
        found = Candidate(changes, cost.of(metrics), metrics, reason)
        if worst is None or found.cost > worst.cost:
            worst = found
        if worst.cost >= FAILED:
            break
    assert worst is not None
    return worst


def _run(scenario: Scenario, changes: dict[str, Any], duration: float) -> tuple[RunMetrics | None, str]:
    try:
        world = World(change_settings(scenario, changes))
    except FlexlabError as error:
        return None, str(error)
    metrics = measure(world, sample_count(duration, world.tick_period))
    return (None, world.status.text) if world.status.failed else (metrics.compute(), "")
