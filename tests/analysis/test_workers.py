"""Studies are computed on threads, which end when the study ends, also by Ctrl-C or by a failure."""

import pytest

from flexlab.analysis.workers import Work, chosen_workers
from flexlab.presets import load_preset
from flexlab.sim.simulate import simulate

DAY = 86_400.0
"""s. Such a run takes ten minutes and more."""


def simulated(duration: float) -> None:
    simulate(load_preset("paper"), duration, 1.0)


def failing_at_once(duration: float) -> None:
    _ = 1 / duration
    simulated(duration)


def interrupted(work: Work) -> None:
    """Press Ctrl-C when the first of two runs is done."""
    with chosen_workers(2)() as run:
        for _ in run(work, (0.0, DAY)):
            raise KeyboardInterrupt


@pytest.mark.parametrize(("work", "error"), [(simulated, KeyboardInterrupt), (failing_at_once, ZeroDivisionError)])
def test_a_study_that_ends_ends_the_runs_under_way(work: Work, error: type[BaseException]) -> None:
    """It used to wait for them."""
    with pytest.raises(error):
        interrupted(work)
