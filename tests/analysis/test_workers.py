"""Studies are computed on threads, which end with the study, even if Ctrl-C or a failure ends it."""

import pytest

from flexlab.analysis.workers import Work, chosen_workers
from flexlab.presets import load_preset
from flexlab.sim.simulate import simulate

DAY = 86_400.0
"""Duration, s, of a run that is still under way when the other one is done."""


completed: list[float] = []
"""Durations of the runs that went on to their ends."""


def simulated(duration: float) -> None:
    simulate(load_preset("paper"), duration, 1.0)
    completed.append(duration)


def failing_at_once(duration: float) -> None:
    _ = 1 / duration
    simulated(duration)


def interrupted(work: Work) -> None:
    """Press Ctrl-C when the first of two runs is done."""
    with chosen_workers(2)() as run:
        for _ in run(work, (0.0, DAY)):
            raise KeyboardInterrupt


@pytest.mark.parametrize(("work", "error"), [(simulated, KeyboardInterrupt), (failing_at_once, ZeroDivisionError)])
def test_a_study_that_is_interrupted_or_fails_stops_the_runs_under_way(work: Work, error: type[BaseException]) -> None:
    """It used to wait until they were done."""
    with pytest.raises(error):
        interrupted(work)
    assert DAY not in completed
