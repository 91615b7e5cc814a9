"""One cell of a sweep: a scenario, simulated, as a row of numbers."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from flexlab.analysis.metrics import MetricCollection
from flexlab.analysis.sweep.plan import Plan
from flexlab.errors import FlexlabError
from flexlab.sim.assembly import Assembly
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.simulate import sample_count
from flexlab.sim.world import World

BLOCK = 5000
"""Samples of a run that are in memory at once."""


class Cell(NamedTuple):
    """What came of a cell."""

    number: int
    values: tuple[Any, ...]
    """Of the axes."""
    status: str
    """As `Run.status`, or "invalid"."""
    sentence: str
    """Why it failed, or since when its results are no longer accurate; empty: all is well."""
    metrics: tuple[float | None, ...] | None
    """As tables show them; None: it failed."""


Executor = Callable[[Plan, Sequence[range]], Iterator[list[Cell]]]
"""Computes parts, and hands each out as it is done."""


def run_part(plan: Plan, cells: Sequence[int]) -> list[Cell]:
    """Compute some cells of a sweep, one after the other. A cell that fails says why and stops nobody."""
    done: list[Cell] = []
    known: tuple[Assembly, ...] = ()
    with one_blas_thread():
        for number in cells:
            cell, known = _run(plan, number, known)
            done.append(cell)
    return done


def _run(plan: Plan, number: int, known: tuple[Assembly, ...]) -> tuple[Cell, tuple[Assembly, ...]]:
    values = plan.values(number)
    try:
        scenario = plan.cell_scenario(number)
        world = World(scenario, plan.sample_period, known)
    except FlexlabError as error:
        return Cell(number, values, "invalid", str(error).replace("\n", " "), None), known
    metrics = measure(world, sample_count(plan.duration, plan.sample_period))
    if world.status.failed:
        return Cell(number, values, str(world.status), world.status.text, None), known
    shown = tuple(None if row.value != row.value else row.value for row in metrics.compute().rows)
    return Cell(number, values, "finished", world.accuracy_warning, shown), (world.assembly,)


def measure(world: World, ticks: int) -> MetricCollection:
    """Run a world on for so many ticks; the metrics of all its samples, the present one included."""
    metrics = MetricCollection()
    metrics.update(world.run(min(BLOCK, ticks)))
    while world.tick < ticks and not world.status.failed:
        metrics.update(world.advance(min(BLOCK, ticks - world.tick)))
    return metrics
