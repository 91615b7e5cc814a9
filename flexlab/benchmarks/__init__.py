"""`flexlab bench`: speed and accuracy of the engine on this machine, compared with its goals."""

import json
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from flexlab.benchmarks import report
from flexlab.benchmarks.fresh_process import measure_memory, start_times
from flexlab.benchmarks.live_costs import change_costs, measure_round_trip
from flexlab.benchmarks.many_worlds import measure_environment, worker_scaling
from flexlab.benchmarks.measure import this_machine
from flexlab.benchmarks.precision import mesh_precision, mesh_scaling, paper_costs
from flexlab.benchmarks.report import plain
from flexlab.presets import load_preset
from flexlab.sim.world import World
from flexlab.text import console

if TYPE_CHECKING:
    from rich.console import Console

Result = TypeVar("Result")


@dataclass(frozen=True)
class Plan:
    """The extent of a benchmark."""

    meshes: tuple[int, ...]
    """Number of elements of each work-precision table."""
    duration: float
    """Simulated time of each of their runs, s; errors are largest within the first 0.1 s."""
    repeats: int
    """Repetitions of each run."""
    rounds: int
    """Rounds of the measurements with many runs."""
    cold: bool
    """Whether to measure a cold start, which compiles everything."""


FULL = Plan(meshes=(2, 8, 32, 64), duration=1.0, repeats=3, rounds=5, cold=True)
"""Takes several minutes, most of them for the cold start."""
QUICK = Plan(meshes=(2, 8), duration=0.3, repeats=3, rounds=2, cold=False)
"""Takes a minute or two."""


def run_bench(as_json: bool, quick: bool = False, peers: ModuleType | None = None) -> None:
    """Measure and print, as tables or as one JSON object. Raises `StudyError` if a measurement cannot be done.

    `quick`: fewer and shorter measurements, no cold start. `peers`: the module that compares with MuJoCo and Exudyn
    (`tests/peers`), as far as they are installed.
    """
    show = None if as_json else console()
    found = measure(QUICK if quick else FULL, peers, show)
    if as_json:
        print(json.dumps(plain(found), indent=2, ensure_ascii=False, allow_nan=False))


def measure(plan: Plan, peers: ModuleType | None, show: "Console | None") -> dict[str, Any]:
    """Measure everything, by name; None where a library or system lacks what it needs.

    `show`: a console that gets each table as soon as it is complete.
    """
    World(load_preset("paper")).run(1)  # Compiles everything before the first measurement.
    length, repeats, part = plan.duration, plan.repeats, partial(_part, show)
    found: dict[str, Any] = {
        "machine": part("the machine", this_machine, lambda its: its.text + "\n"),
        "paper": part("the paper's run", lambda: paper_costs(3 * length, 2 * repeats), report.paper_table),
        "precision": [
            part(f"{n} elements", lambda n=n: mesh_precision(n, length, repeats), report.precision_table)
            for n in plan.meshes
        ],
        "scaling": part("all meshes", lambda: mesh_scaling(length, 2 * repeats), report.scaling_table),
        "changes": part("live changes", lambda: change_costs(10 * repeats), report.changes_table),
        "workers": part("many runs", lambda: worker_scaling(plan.rounds), report.workers_table),
        "environment": part("the environment", lambda: measure_environment(2 * plan.rounds), report.environment_table),
        "round_trip": part(
            "a law in another program", lambda: measure_round_trip(400 * plan.rounds), report.round_trip_table
        ),
        "start": part("starts", lambda: start_times(plan.cold), report.start_table),
        "memory": part("memory", measure_memory, report.memory_table),
        "peers": part("other engines", lambda: peers.compare_peers(length), peers.peers_table) if peers else None,
        "chain": part("chains of segments", peers.compare_chains, peers.chain_table) if peers else None,
        "exact_beam": part("exact beams", peers.compare_beams, peers.beam_table) if peers else None,
    }
    return found | {"goals": part("goals", lambda: report.goals(found), report.goals_table)}


def _part(show: "Console | None", what: str, work: Callable[[], Result], table: Callable[[Any], Any]) -> Result:
    """Do one measurement under a spinner and show its table, if there is a result."""
    if show is None:
        return work()
    notes = console(stderr=True)
    with notes.status(f"measuring: {what}") if notes.is_terminal else nullcontext():
        result = work()
    if result is not None:
        show.print(table(result))
    return result
