"""Results of the comparisons as tables for a terminal."""

from rich.table import Table

from flexlab.benchmarks.report import error_text, new_table, step_text
from peers.beam_comparison import BeamComparison
from peers.chain_comparison import ChainComparison
from peers.peer_comparison import SAME_POSE, PeerComparison

WHOLE = 1e3
"""Costs of this and more are shown without decimals, ms."""


def peers_table(result: PeerComparison) -> Table:
    """Table of the other engines on the same system."""
    title = f"Other engines on the same arms, beam modes and law (other motion: not within {SAME_POSE:g})"
    table = new_table(title, ("engine", "setting", "step", "pose error", "deflection", "ms per s"))
    for row in (result.own, *result.rows):
        cost = "other motion" if row.ms_per_second is None else f"{row.ms_per_second:.1f}"
        errors = error_text(row.pose_error), error_text(row.deflection_error)
        style = "bold" if row in (result.own, result.fastest) else None
        table.add_row(row.engine, row.setting, step_text(row.step), *errors, cost, style=style)
    for engine, reason in result.missing.items():
        table.add_row(engine, reason)
    return table


def chain_table(result: ChainComparison) -> Table:
    """Table of the environment's beam and MuJoCo's chains; parts: elements or segments; steps/s: an environment's on one core.

    Bold: the environment's own beam and the cheapest chains that are at least as accurate.
    """
    dearer = "" if result.missing is None else f"; MuJoCo is {result.missing}"
    if result.ratio is not None:
        dearer = f": {result.ratio:.1f} times the cost at the same pose error"
    if result.ratio_in_both is not None:
        dearer += f", {result.ratio_in_both:.1f} at the same deflection error too"
    headings = ("engine", "parts", "setting", "step", "pose error", "midspan error", "ms per s", "steps/s")
    table = new_table(f"The environment's beam and chains of rigid segments{dearer}", headings)
    table.columns[2].no_wrap = True
    for row in (*result.own, *result.chains):
        style = "bold" if row in (result.own[0], result.equal, result.equal_in_both) else None
        errors = error_text(row.pose_error), error_text(row.deflection_error)
        cost = f"{row.ms_per_second:.{1 if row.ms_per_second < WHOLE else 0}f}", f"{row.environment_rate:.0f}"
        table.add_row(row.engine, str(row.parts), row.integrator, step_text(row.step), *errors, *cost, style=style)
    return table


def beam_table(result: BeamComparison) -> Table:
    """Table of the beam with axial load compared with a geometrically exact one."""
    title = "The beam that feels the force along it, beside a geometrically exact one: same to first order"
    if result.missing is not None:
        title += f"; Exudyn is {result.missing}"
    table = new_table(title, ("preset", "deflection (mm)", "difference (%)", "% per mm"))
    for row in result.rows:
        percent, mm = 100 * row.difference, 1e3 * row.deflection
        table.add_row(row.preset, f"{mm:.2f}", f"{percent:.2f}", f"{percent / mm:.3f}")
    return table
