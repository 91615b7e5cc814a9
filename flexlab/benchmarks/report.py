"""The results of a benchmark: goals, plain data for JSON, and tables for a terminal."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any

from flexlab.benchmarks import precision
from flexlab.benchmarks.fresh_process import DURATION, LIVE_END, LIVE_START, Memory, StartTimes
from flexlab.benchmarks.live_costs import BEAM_GOAL, FRAME_GOAL, LIGHT_GOAL, MESHES, ChangeCost, RoundTrip
from flexlab.benchmarks.many_worlds import RATE_GOAL, SPEED_UP_GOAL, EnvironmentRate, WorkerScaling
from flexlab.benchmarks.precision import ASKED_ERROR, MeshPrecision, PaperCost, Scaling, WorkPoint
from flexlab.scenario.scenario import SMALLEST_STEP

if TYPE_CHECKING:
    from rich.table import Table

RATIO_GOAL = 10.0
"""Goal for the ratio of the engine's speed to that of the fastest peer with the same motion."""


@dataclass(frozen=True)
class Goal:
    """A figure with its limit."""

    what: str
    value: float
    unit: str
    limit: float
    at_least: bool
    """Whether the limit is a lower bound; otherwise it is an upper one."""

    @property
    def met(self) -> bool:
        """Whether the figure is within its limit."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def goals(found: Mapping[str, Any]) -> list[Goal]:
    """The goals whose figures were measured; `found`: all measurements by name."""
    paper, environment, peers = "the paper's run, 1 kHz samples", found["environment"], found["peers"]
    exact = [cost.ms_per_second for cost in found["paper"] if cost.samples_at_1_khz and cost.pose_error <= ASKED_ERROR]
    fastest = min(exact, default=None)
    coarse = [cost for cost in found["changes"] if cost.elements == MESHES[0]]
    fine = [cost for cost in found["changes"] if cost.elements == MESHES[-1]]
    at_most = [
        (paper, fastest, "ms/s", precision.PAPER_LIMIT),
        (f"{paper}: aim", fastest, "ms/s", precision.PAPER_AIM),
        *(
            (f"{mesh.elements} elements", mesh.fastest and mesh.fastest.ms_per_second, "ms/s", mesh.goal)
            for mesh in found["precision"]
        ),
        ("cost ~ elements to the power of", found["scaling"].exponent, "", precision.EXPONENT_GOAL),
        ("a live gain, path or gravity", max(cost.ms for cost in coarse if cost.is_light), "ms", LIGHT_GOAL),
        ("a live change of the beam", max(cost.ms for cost in coarse if not cost.is_light), "ms", BEAM_GOAL),
        (f"any live change, {MESHES[-1]} elements", max(cost.ms for cost in fine), "ms", FRAME_GOAL),
    ]
    at_least = [("speed-up of two workers", found["workers"].speed_up, "", SPEED_UP_GOAL)]
    if environment is not None:
        what, unit = f"vector environment, {environment.worlds} worlds", "thousand steps/s"
        at_least.append((what, environment.all_cores / 1e3, unit, RATE_GOAL / 1e3))
    if peers is not None:
        at_least.append(("times faster than the fastest peer", peers.ratio, "", RATIO_GOAL))
    judged = ((row, lower) for rows, lower in ((at_most, False), (at_least, True)) for row in rows)
    return [Goal(*row, lower) for row, lower in judged if row[1] is not None]


def plain(value: Any) -> Any:
    """A result as dictionaries, lists, numbers and strings, with the fields and properties of each dataclass."""
    if is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in fields(value)]
        names += [name for name, member in vars(type(value)).items() if isinstance(member, property)]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


MEGABYTE = 1e6


def paper_table(costs: list[PaperCost]) -> "Table":
    """The paper's run."""
    title = "The paper's run: ms of processor time per simulated second"
    heads = ("setting", "step", "ms per s", "pose error")
    rows = ((c.setting, step_text(c.step), f"{c.ms_per_second:.2f}", error_text(c.pose_error)) for c in costs)
    return new_table(title, heads, rows)


def precision_table(mesh: MeshPrecision) -> "Table":
    """Work and precision on one mesh; the cheapest row within `ASKED_ERROR` is bold."""
    title = f"{mesh.elements} elements: work and precision (reference known to {mesh.reference_uncertainty:.0e})"
    heads = ("integrator", "step", "µs/step", "ms per s", "pose error", "deflection")
    bold = None if mesh.fastest is None else mesh.points.index(mesh.fastest)
    return new_table(title, heads, map(_point_cells, mesh.points), bold)


def _point_cells(point: WorkPoint) -> tuple[str, ...]:
    if point.ms_per_second is None or point.us_per_step is None:
        shown = f"< {step_text(SMALLEST_STEP)}" if point.step is None else step_text(point.step)
        return point.integrator, shown, point.outcome
    costs = f"{point.us_per_step:.2f}", f"{point.ms_per_second:.2f}"
    errors = error_text(point.pose_error), error_text(point.deflection_error)
    return point.integrator, step_text(point.step), *costs, *errors


def scaling_table(scaling: Scaling) -> "Table":
    """Cost over the number of elements."""
    title = (
        f"Modal damping, 1 ms steps: cost ~ elements^{scaling.exponent:.2f} from {precision.FIRST_FITTED} elements on"
    )
    rows = ((str(mesh.elements), f"{mesh.us_per_step:.2f}", f"{mesh.real_time_factor:.0f}") for mesh in scaling.meshes)
    return new_table(title, ("elements", "µs/step", "times real time"), rows)


def changes_table(costs: list[ChangeCost]) -> "Table":
    """The cost of live changes."""
    heads = ("elements", "field", "simulation thread", "beside it")
    rows = ((str(c.elements), c.path, f"{c.ms:.2f}", f"{c.ms_beside:.1f}" if c.ms_beside else "") for c in costs)
    return new_table("Live changes: ms of processor time", heads, rows)


def workers_table(result: WorkerScaling) -> "Table":
    """One worker and two."""
    rows = (
        ("best round on one worker, wall time", f"{min(r.wall for r in result.one):.2f} s"),
        ("best round on two workers, wall time", f"{min(r.wall for r in result.two):.2f} s"),
        ("cores received by two workers", f"{result.cores_received:.2f}"),
        ("speed-up by wall time", f"{result.wall_speed_up:.2f}"),
        ("speed-up without waiting for a core", f"{result.speed_up:.2f}"),
        ("share of a run outside the kernels", f"{100 * result.locked_share:.0f} %"),
    )
    return new_table(f"Many runs at once: {result.scenarios} scenarios, 3 s each", ("", "value"), rows, bold=4)


def environment_table(rate: EnvironmentRate) -> "Table":
    """The vector environment."""
    one = ("one core, by processor time", f"{rate.one_core:.0f}")
    every = (f"all cores ({rate.cores}), by wall time", f"{rate.all_cores:.0f}")
    title = f"Vector environment, {rate.worlds} worlds, 1 kHz control"
    return new_table(title, ("", "steps/s"), (one, every), bold=1)


def round_trip_table(trip: RoundTrip) -> "Table":
    """A control law in another program."""
    rows = ("p50", f"{trip.p50_ms:.3f} ms"), (f"p99, of {trip.instants}", f"{trip.p99_ms:.3f} ms")
    return new_table("A control law in another program, 1 kHz control", ("", "wall time of an instant"), rows)


def start_table(times: StartTimes) -> "Table":
    """Cold and warm start."""
    title, heads = "Start of the engine in a fresh interpreter", ("", "imports", "to first sample", "processor time")
    starts = {
        "cold (compiles what moving arms need)": times.cold,
        "after it, on all cores (other integrators, laws)": times.rest,
        "warm (machine code on disk)": times.warm,
    }
    rows = (
        (name, f"{start.importing:.2f} s", f"{start.preparing:.2f} s", f"{start.cpu:.2f} s")
        for name, start in starts.items()
        if start is not None
    )
    return new_table(title, heads, rows)


def memory_table(memory: Memory) -> "Table":
    """Memory of a run and of the live engine."""
    rows = (
        (f"samples of a {DURATION:g} s run", f"{memory.stored / MEGABYTE:.1f} MB"),
        ("growth of the peak", f"{memory.peak_growth / MEGABYTE:.1f} MB"),
        ("growth over samples", f"{memory.overhead:.2f}"),
        (f"live engine, growth from {LIVE_START} s to {LIVE_END} s", f"{memory.live_growth / MEGABYTE:.2f} MB"),
    )
    return new_table("Memory", ("", "value"), rows)


def goals_table(goals: list[Goal]) -> "Table":
    """Every goal, and whether it is met."""
    from rich.text import Text

    title = f"Goals (ms/s: of processor time per simulated second, at pose error ≤ {ASKED_ERROR:g})"
    table = new_table(title, ("", "measured", "goal", "met"))
    for goal in goals:
        sign, met = "≥" if goal.at_least else "≤", Text("yes", "green") if goal.met else Text("no", "red")
        table.add_row(goal.what, f"{goal.value:.2f} {goal.unit}", f"{sign} {goal.limit:g} {goal.unit}", met)
    return table


def new_table(
    title: str, headings: tuple[str, ...], rows: Iterable[Sequence[str]] = (), bold: int | None = None
) -> "Table":
    """A table with title, headings and rows; `bold`: index of a bold row."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for number, heading in enumerate(headings):
        justify = "left" if number == 0 or heading == "setting" else "right"
        table.add_column(heading, justify=justify, no_wrap=number == 0)
    for number, row in enumerate(rows):
        table.add_row(*row, style="bold" if number == bold else None)
    return table


def step_text(step: float) -> str:
    """A step, s, as a table shows it."""
    return f"{1e3 * step:.3g} ms" if step >= 1e-3 else f"{1e6 * step:.3g} µs"


def error_text(error: float | None) -> str:
    """An error as a table shows it; empty for none."""
    return "" if error is None else f"{error:.1e}"
