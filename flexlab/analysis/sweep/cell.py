"""One cell of a sweep: a scenario, simulated, as a row of numbers."""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from flexlab.analysis.metrics import MetricCollection
from flexlab.analysis.sweep.plan import Plan
from flexlab.errors import FlexlabError
from flexlab.scenario import Payload
from flexlab.sim.assembly import Assembly
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.simulate import sample_count
from flexlab.sim.world import World

BLOCK = 5000
"""Samples of a run that are in memory at once."""
MOST_KEPT = 1024
"""Sum of squares of the coordinates of the beams of which a thread keeps what was derived, one at least: matrices grow so. It is
64 beams of two elements, or 4 of eight."""


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


class KnownBeams:
    """What was derived for the beams that one thread's cells had last: where a beam comes again, it costs nothing anew."""

    def __init__(self) -> None:
        self._known: OrderedDict[Payload, Assembly] = OrderedDict()

    def of(self, payload: Payload) -> tuple[Assembly, ...]:
        """What is known of a beam: one assembly, or none."""
        found = self._known.get(payload)
        return () if found is None else (found,)

    def note(self, assembly: Assembly) -> None:
        """Keep an assembly; the one that was not needed for longest goes."""
        self._known[assembly.scenario.payload] = assembly
        self._known.move_to_end(assembly.scenario.payload)
        while len(self._known) > 1 and sum(payload.coordinate_count**2 for payload in self._known) > MOST_KEPT:
            self._known.popitem(last=False)


def run_part(plan: Plan, cells: Sequence[int], beams: KnownBeams | None = None) -> list[Cell]:
    """Compute some cells of a sweep, one after the other. A cell that fails says why and stops nobody.

    `beams`: what this thread's cells before had; the numbers are the same without.
    """
    known = KnownBeams() if beams is None else beams
    with one_blas_thread():
        return [_run(plan, number, known) for number in cells]


def _run(plan: Plan, number: int, beams: KnownBeams) -> Cell:
    values = plan.values(number)
    try:
        scenario = plan.cell_scenario(number)
        world = World(scenario, plan.sample_period, beams.of(scenario.payload))
    except FlexlabError as error:
        return Cell(number, values, "invalid", str(error).replace("\n", " "), None)
    metrics = measure(world, sample_count(plan.duration, plan.sample_period))
    if world.status.failed:
        return Cell(number, values, str(world.status), world.status.text, None)
    beams.note(world.assembly)
    shown = tuple(None if row.value != row.value else row.value for row in metrics.compute().rows)
    return Cell(number, values, "finished", world.warnings, shown)


def measure(world: World, ticks: int) -> MetricCollection:
    """Run a world on for so many ticks; the metrics of all its samples, the present one included."""
    metrics = MetricCollection()
    metrics.update(world.run(min(BLOCK, ticks)))
    while world.tick < ticks and not world.status.failed:
        metrics.update(world.advance(min(BLOCK, ticks - world.tick)))
    return metrics
