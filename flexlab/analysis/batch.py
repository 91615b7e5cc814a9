"""Many runs at once, on all cores or on a cluster."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from flexlab.analysis.workers import chosen_workers, progress_bar
from flexlab.errors import ScenarioError
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.row_layout import empty_samples
from flexlab.sim.samples import Run, Status
from flexlab.sim.signals import own_signals
from flexlab.sim.simulate import sample_count, simulate


def simulate_many(
    scenarios: Sequence[Scenario | Mapping[str, Any]],
    duration: float = 3.0,
    sample_period: float = 0.001,
    workers: int | None = None,
    progress: bool = True,
    choose: Callable[[Scenario], Scenario] = lambda scenario: scenario,
    cluster: str | None = None,
) -> list[Run]:
    """Simulate every scenario (or plain data of one), in order, on `workers` threads (None: one per core), or on a `cluster`.

    A scenario that is not valid becomes a run without samples whose status is "invalid" and says why; one that cannot go
    on ends early, as in `simulate`. `progress` draws a bar on a terminal. `choose` changes each scenario. Raises `StudyError`
    for unusable arguments, and for a cluster that fails.
    """
    sample_count(duration, sample_period)
    known = chosen_workers(workers, cluster)
    chosen = [_chosen(scenario, choose) for scenario in scenarios]
    valid = [number for number, scenario in enumerate(chosen) if isinstance(scenario, Scenario)]
    found = {number: run for number, run in enumerate(chosen) if isinstance(run, Run)}
    with progress_bar(progress, "runs") as told, known() as run:
        for done, (number, one) in enumerate(
            run(partial(_simulated, duration, sample_period), (chosen[k] for k in valid)), 1
        ):
            found[valid[number]] = one
            told(done, len(valid))
    return [found[number] for number in range(len(chosen))]


def _chosen(scenario: Scenario | Mapping[str, Any], choose: Callable[[Scenario], Scenario]) -> Scenario | Run:
    """A scenario, changed; a run that says why it is not valid."""
    try:
        return choose(scenario if isinstance(scenario, Scenario) else parse_scenario(scenario))
    except ScenarioError as error:
        return _invalid(scenario if isinstance(scenario, Scenario) else Scenario(), str(error))


def _simulated(duration: float, sample_period: float, scenario: Scenario) -> Run:
    try:
        with one_blas_thread():
            return simulate(scenario, duration, sample_period)
    except ScenarioError as error:
        return _invalid(scenario, str(error))


def _invalid(scenario: Scenario, reason: str) -> Run:
    nothing = empty_samples(len(scenario.arms), scenario.payload.coordinate_count, own_signals(scenario))
    return Run(**nothing.signals(), scenario=scenario, status=Status("invalid", reason))
