"""The plan of a sweep (base scenario, axes and design), its cells, and the computation of a cell.

The same plan has the same key. A cell is one simulated scenario, and one row of the table.
"""

import json
import threading
import warnings
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any, NamedTuple

import numpy as np

from flexlab import __version__
from flexlab.analysis.metrics import METRICS, MetricCollection, RunMetrics
from flexlab.analysis.metrics.own import own_metrics
from flexlab.analysis.result import scenario_hash
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.workers import engine
from flexlab.arguments import finite_number, whole_number
from flexlab.errors import FlexlabError, StudyError
from flexlab.files import short_hash
from flexlab.lapack import one_blas_thread
from flexlab.recording.course import coarse_note
from flexlab.scenario import Payload, Scenario
from flexlab.scenario.settings import change_settings
from flexlab.sim.assembly import Assembly
from flexlab.sim.simulate import sample_count
from flexlab.sim.world import World

DESIGNS = ("grid", "latin-hypercube", "sobol")
TABLE_FORMAT = 2
"""Format of a sweep's table: 2 has metrics by name, in SI units, and the provenance."""
MOST_CELLS = 100_000_000
MANY_CELLS = 100_000
"""Number of cells, about an hour's work, above which the command asks for confirmation."""
PARTS, LARGEST_PART = 64, 256
"""Approximate number of parts that are computed and saved one by one, and most cells in a part."""
DEFAULT_ACCURACY = 1e-7
"""Pose accuracy of a cell, m: metrics have an error of about 1e-5, and steps are up to five times those of a lab's run."""


@dataclass(frozen=True)
class Plan:
    """Everything that defines a sweep: the same plan gives the same table, byte for byte."""

    scenario: Scenario
    axes: tuple[Axis, ...]
    duration: float
    """Simulated time of a cell, s."""
    sample_period: float
    """Time between samples, s."""
    design: str = "grid"
    samples: int | None = None
    """Number of cells of a sampling design; None for a grid."""
    seed: int = 0
    """Seed of a sampling design."""

    @property
    def cell_count(self) -> int:
        """Number of cells."""
        return prod(self.shape) if self.samples is None else self.samples

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values per axis of a grid."""
        return tuple(len(axis.values) for axis in self.axes)

    def values(self, cell: int) -> tuple[Any, ...]:
        """The value of each axis in a cell; the last axis changes fastest."""
        if self.samples is not None:
            return tuple(axis.at(share) for axis, share in zip(self.axes, self._shares[cell], strict=True))
        places = np.unravel_index(cell, self.shape)
        return tuple(axis.values[place] for axis, place in zip(self.axes, places, strict=True))

    @cached_property
    def _shares(self) -> np.ndarray:
        """Shares of each axis in each cell of a sampling design, (cells, axes) in [0, 1)."""
        from scipy.stats import qmc

        count, axes = self.samples or 0, len(self.axes)
        if self.design == "sobol":
            with warnings.catch_warnings():
                # The warning recommends powers of two, but any number of points is allowed.
                warnings.simplefilter("ignore", UserWarning)
                return qmc.Sobol(axes, rng=np.random.default_rng(self.seed)).random(count)
        return qmc.LatinHypercube(axes, rng=np.random.default_rng(self.seed)).random(count)

    def changes(self, cell: int) -> dict[str, Any]:
        """The changes, by path, from the base scenario to a cell's."""
        return dict(zip((axis.path for axis in self.axes), self.values(cell), strict=True))

    def cell_scenario(self, cell: int) -> Scenario:
        """The scenario of a cell. Raises `ScenarioError` if it is not valid."""
        return change_settings(self.scenario, self.changes(cell))

    @property
    def part_size(self) -> int:
        """Number of cells in a part."""
        return min(LARGEST_PART, -(-self.cell_count // PARTS))

    def parts(self) -> Iterator[range]:
        """The cells of each part."""
        for first in range(0, self.cell_count, self.part_size):
            yield range(first, min(first + self.part_size, self.cell_count))

    def as_data(self) -> dict[str, Any]:
        """The plan as plain data, with everything else on which the results depend."""
        return {
            "scenario": self.scenario.model_dump(mode="json"),
            "vary": [axis.as_data() for axis in self.axes],
            **{name: getattr(self, name) for name in ("duration", "sample_period", "design", "samples", "seed")},
            "metrics": [*METRICS, *(own.digest for own in own_metrics())],
            "table": TABLE_FORMAT,
            # Kernels may be the same where the definition of a metric has changed.
            "engine": engine(),
            "version": __version__,
        }

    @cached_property
    def key(self) -> str:
        """A hash of 16 digits of the sweep and of what computes it."""
        return short_hash(json.dumps(self.as_data(), sort_keys=True, ensure_ascii=False))


def make_plan(
    scenario: Scenario,
    axes: tuple[Axis, ...],
    duration: float,
    sample_period: float,
    design: str = "grid",
    samples: int | None = None,
    seed: int = 0,
    accuracy: float | None = DEFAULT_ACCURACY,
) -> Plan:
    """A checked plan; `accuracy`: pose accuracy of the runs, m (None: the scenario's own). Raises `StudyError`."""
    sample_count(duration, sample_period)
    if not isinstance(design, str) or design not in DESIGNS:
        raise StudyError(f"design = {design!r:.60} is not known: choose one of {', '.join(DESIGNS)}.")
    samples = None if samples is None else whole_number("samples", samples, 1)
    seed = whole_number("seed", seed, 0)
    if (design == "grid") != (samples is None):
        how = "give it with latin-hypercube or sobol, and not with a grid"
        raise StudyError(f"samples says how many cells a design draws: {how}.")
    poorest = None if accuracy is None else finite_number("accuracy", accuracy, "m", 0.0)
    if poorest is not None and not any(axis.path.startswith("simulation") for axis in axes):
        scenario = scenario.replace({"simulation.accuracy": max(poorest, scenario.simulation.accuracy)})
    # The scenario's texts do not change any result.
    scenario = scenario.replace({"watch": ""})
    plan = Plan(scenario, axes, float(duration), float(sample_period), design, samples, seed)
    if plan.cell_count > MOST_CELLS:
        raise StudyError(f"{plan.cell_count} cells are too many: choose fewer values, {MOST_CELLS} cells at most.")
    return plan


BLOCK = 5000
"""Most samples of a run in memory at once."""
MOST_KEPT = 1024
"""Largest sum of the squared numbers of coordinates of the beams whose derived matrices a thread keeps: 64 beams of two
elements, or 4 of eight."""


class Cell(NamedTuple):
    """The result of a cell."""

    number: int
    values: tuple[Any, ...]
    """The value of each axis."""
    status: str
    """As `Run.status`, or "invalid"."""
    sentence: str
    """Why it failed, from when on its results are inaccurate, or that samples are too far apart; empty if none of these."""
    metrics: tuple[float | None, ...] | None
    """SI; None if it failed."""
    scenario: str = ""
    """Hash of its scenario; empty if that is not valid."""


class KnownBeams(threading.local):
    """The derived matrices of each thread's newest beams, so that a run with one of these beams need not derive them again."""

    def __init__(self) -> None:
        self._known: OrderedDict[Payload, Assembly] = OrderedDict()

    def of(self, payload: Payload) -> tuple[Assembly, ...]:
        """The assembly of a beam, if it is kept, as a tuple of one or none."""
        found = self._known.get(payload)
        return () if found is None else (found,)

    def note(self, assembly: Assembly) -> None:
        """Keep an assembly, and drop the least recently used ones if there are too many."""
        self._known[assembly.scenario.payload] = assembly
        self._known.move_to_end(assembly.scenario.payload)
        while len(self._known) > 1 and sum(payload.coordinate_count**2 for payload in self._known) > MOST_KEPT:
            self._known.popitem(last=False)


BEAMS = KnownBeams()
"""Keeping them changes no result."""


class Measured(NamedTuple):
    """A simulated scenario (None if not valid), status and sentence as in `Cell`, and metrics (None if it failed)."""

    scenario: Scenario | None
    status: str
    sentence: str
    metrics: RunMetrics | None


def measured(scenario: Scenario, changes: Mapping[str, Any], duration: float, sample_period: float) -> Measured:
    """Simulate a scenario with changes and return its metrics; a failure is a status, never raised."""
    with one_blas_thread():
        try:
            changed = change_settings(scenario, changes)
            world = World(changed, sample_period, BEAMS.of(changed.payload))
        except FlexlabError as error:
            return Measured(None, "invalid", str(error), None)
        ticks, metrics = sample_count(duration, sample_period), MetricCollection()
        try:
            metrics.update(world.run(min(BLOCK, ticks)))
            while world.tick < ticks and not world.status.failed:
                metrics.update(world.advance(min(BLOCK, ticks - world.tick)))
            if world.status.failed:
                return Measured(changed, str(world.status), world.status.text, None)
            found = metrics.compute()
        except StudyError as error:  # raised by a user's own metric
            return Measured(changed, "no metric", str(error), None)
        BEAMS.note(world.assembly)
        sentences = (world.warnings, coarse_note(changed, sample_period, duration))
        return Measured(changed, "finished", " ".join(filter(None, sentences)), found)


def run_part(plan: Plan, cells: Sequence[int]) -> list[Cell]:
    """Compute some cells of a sweep, one after the other. A cell that fails says why, and the next one follows."""
    done = []
    for number in cells:
        found = measured(plan.scenario, plan.changes(number), plan.duration, plan.sample_period)
        numbers = None if found.metrics is None else tuple(None if x != x else x for x in found.metrics.numbers)
        known = "" if found.scenario is None else scenario_hash(found.scenario)
        said = found.sentence.replace("\n", " ")
        done.append(Cell(number, plan.values(number), found.status, said, numbers, known))
    return done
