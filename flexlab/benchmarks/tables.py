"""The results as tables for a person at a terminal."""

from typing import TYPE_CHECKING

from flexlab.benchmarks.changes import ChangeCost
from flexlab.benchmarks.environment_rate import EnvironmentRate
from flexlab.benchmarks.memory import DURATION, LIVE_END, LIVE_START, Memory
from flexlab.benchmarks.peers.chain_comparison import ChainComparison
from flexlab.benchmarks.peers.peer_comparison import SAME_POSE, PeerComparison
from flexlab.benchmarks.precision import ASKED_ERROR, MeshPrecision, PaperCost, WorkPoint
from flexlab.benchmarks.report import Goal
from flexlab.benchmarks.scaling import FIRST_FITTED, Scaling
from flexlab.benchmarks.startup import Start, StartTimes
from flexlab.benchmarks.workers import WorkerScaling
from flexlab.scenario.scenario import SMALLEST_STEP

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

MEGABYTE = 1e6

WHOLE = 1e3
"""ms from which decimals say nothing."""


def paper_table(costs: list[PaperCost]) -> "Table":
    """The paper's run."""
    table = _table(
        "The paper's run: ms of processor time per simulated second", ("setting", "step", "ms per s", "pose error")
    )
    for cost in costs:
        table.add_row(cost.setting, _step(cost.step), f"{cost.ms_per_second:.2f}", _error(cost.pose_error))
    return table


def precision_table(mesh: MeshPrecision) -> "Table":
    """Work against precision on one mesh; the cheapest row within the asked error is bold."""
    title = f"{mesh.elements} elements: work and precision (reference known to {mesh.reference_uncertainty:.0e})"
    table = _table(title, ("integrator", "step", "µs/step", "ms per s", "pose error", "deflection"))
    best = mesh.fastest
    for point in mesh.points:
        table.add_row(*_point_cells(point), style="bold" if point == best else None)
    return table


def _point_cells(point: WorkPoint) -> tuple[str, ...]:
    if point.ms_per_second is None or point.us_per_step is None:
        shown = f"< {_step(SMALLEST_STEP)}" if point.step is None else _step(point.step)
        return point.integrator, shown, point.outcome
    figures = f"{point.us_per_step:.2f}", f"{point.ms_per_second:.2f}"
    return point.integrator, _step(point.step), *figures, _error(point.pose_error), _error(point.deflection_error)


def scaling_table(scaling: Scaling) -> "Table":
    """Cost against the mesh."""
    title = f"Modal damping, 1 ms steps: cost ~ elements^{scaling.exponent:.2f} from {FIRST_FITTED} elements on"
    table = _table(title, ("elements", "µs/step", "times real time"))
    for mesh in scaling.meshes:
        table.add_row(str(mesh.elements), f"{mesh.us_per_step:.2f}", f"{mesh.real_time_factor:.0f}")
    return table


def changes_table(costs: list[ChangeCost]) -> "Table":
    """What a live change costs."""
    table = _table("Live changes: ms of processor time", ("elements", "field", "simulation thread", "beside it"))
    for cost in costs:
        beside = f"{cost.ms_beside:.1f}" if cost.ms_beside else ""
        table.add_row(str(cost.elements), cost.path, f"{cost.ms:.2f}", beside)
    return table


def workers_table(result: WorkerScaling) -> "Table":
    """One worker against two."""
    table = _table(f"Many runs at once: {result.scenarios} scenarios, 3 s each", ("", "value"))
    table.add_row("best round on one worker, wall time", f"{min(r.wall for r in result.one):.2f} s")
    table.add_row("best round on two workers, wall time", f"{min(r.wall for r in result.two):.2f} s")
    table.add_row("cores received by two workers", f"{result.cores_received:.2f}")
    table.add_row("speed-up by wall time", f"{result.wall_speed_up:.2f}")
    table.add_row("speed-up without waiting for a core", f"{result.speed_up:.2f}", style="bold")
    table.add_row("share of a run outside the kernels", f"{100 * result.locked_share:.0f} %")
    return table


def environment_table(rate: EnvironmentRate) -> "Table":
    """The vector environment."""
    table = _table(f"Vector environment, {rate.worlds} worlds, 1 kHz control", ("", "steps/s"))
    table.add_row("one core, by processor time", f"{rate.one_core:.0f}")
    table.add_row(f"all cores ({rate.cores}), by wall time", f"{rate.all_cores:.0f}", style="bold")
    return table


def start_table(times: StartTimes) -> "Table":
    """Cold and warm start."""
    table = _table("Start of the engine in a fresh interpreter", ("", "imports", "to first sample", "processor time"))

    def row(name: str, start: Start) -> None:
        table.add_row(name, f"{start.importing:.2f} s", f"{start.preparing:.2f} s", f"{start.cpu:.2f} s")

    if times.cold is not None:
        row("cold (compiles what moving arms need)", times.cold)
    if times.rest is not None:
        row("after it, compiling meanwhile (other integrators, laws)", times.rest)
    row("warm (machine code on disk)", times.warm)
    return table


def memory_table(memory: Memory) -> "Table":
    """Memory of a run and of the live engine."""
    table = _table("Memory", ("", "value"))
    table.add_row(f"samples of a {DURATION:g} s run", f"{memory.stored / MEGABYTE:.1f} MB")
    table.add_row("growth of the peak", f"{memory.peak_growth / MEGABYTE:.1f} MB")
    table.add_row("growth over samples", f"{memory.overhead:.2f}")
    table.add_row(f"live engine, growth from {LIVE_START} s to {LIVE_END} s", f"{memory.live_growth / MEGABYTE:.2f} MB")
    return table


def peers_table(result: PeerComparison) -> "Table":
    """Other engines on the same system."""
    title = f"Other engines on the same arms, beam modes and law (other motion: not within {SAME_POSE:g})"
    table = _table(title, ("engine", "setting", "step", "pose error", "deflection", "ms per s"))
    for row in (result.own, *result.rows):
        cost = "other motion" if row.ms_per_second is None else f"{row.ms_per_second:.1f}"
        errors = _error(row.pose_error), _error(row.deflection_error)
        style = "bold" if row in (result.own, result.fastest) else None
        table.add_row(row.engine, row.setting, _step(row.step), *errors, cost, style=style)
    for engine, reason in result.missing.items():
        table.add_row(engine, reason)
    return table


def chain_table(result: ChainComparison) -> "Table":
    """The environment's beam and MuJoCo's chains (parts: elements, segments); steps/s of an environment on one core.

    Bold: the environment's own and the cheapest chains that are as exact.
    """
    dearer = "" if result.missing is None else f"; MuJoCo is {result.missing}"
    if result.ratio is not None:
        dearer = f": {result.ratio:.1f} times the cost at the same pose error"
    if result.ratio_in_both is not None:
        dearer += f", {result.ratio_in_both:.1f} at the same deflection error too"
    headings = ("engine", "parts", "setting", "step", "pose error", "midspan error", "ms per s", "steps/s")
    table = _table(f"The environment's beam and chains of rigid segments{dearer}", headings)
    table.columns[2].no_wrap = True
    for row in (*result.own, *result.chains):
        style = "bold" if row in (result.own[0], result.equal, result.equal_in_both) else None
        errors = _error(row.pose_error), _error(row.deflection_error)
        cost = f"{row.ms_per_second:.{1 if row.ms_per_second < WHOLE else 0}f}", f"{row.environment_rate:.0f}"
        table.add_row(row.engine, str(row.parts), row.integrator, _step(row.step), *errors, *cost, style=style)
    return table


def goals_table(goals: list[Goal]) -> "Table":
    """Every goal and whether it was met."""
    table = _table(
        f"Goals (ms/s: of processor time per simulated second, at pose error ≤ {ASKED_ERROR:g})",
        ("", "measured", "goal", "met"),
    )
    for goal in goals:
        sign = "≥" if goal.at_least else "≤"
        table.add_row(goal.what, f"{goal.value:.2f} {goal.unit}", f"{sign} {goal.limit:g} {goal.unit}", _mark(goal.met))
    return table


def _table(title: str, headings: tuple[str, ...]) -> "Table":
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for number, heading in enumerate(headings):
        table.add_column(
            heading, justify="left" if number == 0 or heading == "setting" else "right", no_wrap=number == 0
        )
    return table


def _mark(good: bool) -> "Text":
    from rich.text import Text

    return Text("yes", "green") if good else Text("no", "red")


def _step(step: float) -> str:
    return f"{1e3 * step:.3g} ms" if step >= 1e-3 else f"{1e6 * step:.3g} µs"


def _error(error: float | None) -> str:
    return "" if error is None else f"{error:.1e}"
