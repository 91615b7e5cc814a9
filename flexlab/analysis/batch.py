"""Many runs at once on all cores: the kernels hold no lock, so threads are enough."""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from flexlab.errors import ScenarioError, StudyError
from flexlab.plain_text import console
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.row_layout import empty_samples
from flexlab.sim.samples import Run, Status
from flexlab.sim.signals import own_signals
from flexlab.sim.simulate import sample_count, simulate

MOST_WORKERS = 256
"""More threads than any machine of today has use for."""


def simulate_many(
    scenarios: Sequence[Scenario | Mapping[str, Any]],
    duration: float = 3.0,
    sample_period: float = 0.001,
    workers: int | None = None,
    progress: bool = True,
    choose: Callable[[Scenario], Scenario] = lambda scenario: scenario,
) -> list[Run]:
    """Simulate every scenario (or plain data of one), in order, on `workers` threads (None: one per core).

    A scenario that is not valid becomes a run without samples whose status is "invalid" and says why; one that cannot go
    on ends early, as in `simulate`. `progress` draws a bar on a terminal. `choose` changes each scenario. Raises `StudyError`
    for unusable arguments.
    """
    sample_count(duration, sample_period)
    workers = thread_count(workers)

    def one(scenario: Scenario | Mapping[str, Any]) -> Run:
        try:
            valid = scenario if isinstance(scenario, Scenario) else parse_scenario(scenario)
            return simulate(choose(valid), duration, sample_period)
        except ScenarioError as error:
            return _invalid(scenario if isinstance(scenario, Scenario) else Scenario(), str(error))

    with one_blas_thread(), ThreadPoolExecutor(workers, thread_name_prefix="flexlab-batch") as pool:
        results = pool.map(one, scenarios)
        return list(_with_bar(results, len(scenarios)) if progress else results)


def thread_count(workers: int | None) -> int:
    """How many threads to use: one per core for None. Raises `StudyError` for what is no usable number."""
    workers = os.cpu_count() or 1 if workers is None else workers
    if isinstance(workers, bool) or not isinstance(workers, int) or not 1 <= workers <= MOST_WORKERS:
        raise StudyError(f"workers = {workers!r} is not usable: give a whole number from 1 to {MOST_WORKERS}, or None.")
    return workers


def _with_bar(results: Any, total: int) -> Any:
    from rich.progress import track

    notes = console(stderr=True)
    return track(results, "simulating", total, console=notes, transient=True, disable=not notes.is_terminal)


def _invalid(scenario: Scenario, reason: str) -> Run:
    nothing = empty_samples(len(scenario.arms), scenario.payload.coordinate_count, own_signals(scenario))
    return Run(**nothing.signals(), scenario=scenario, status=Status("invalid", reason))
