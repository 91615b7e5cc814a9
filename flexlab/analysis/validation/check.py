"""Checks, the function that makes all of them, and the runs that several of them share, each simulated once."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike

from flexlab import __version__
from flexlab.analysis.paper_equations import internal_force_eq_26
from flexlab.analysis.result import Result
from flexlab.errors import FlexlabError, StudyError
from flexlab.presets import load_preset
from flexlab.registry import modules_in
from flexlab.sim.commands import WorldCommand
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PERIOD = 0.001
"""Sample period of the paper's run, s."""
FINE = 1e-5
"""Sample period of runs that are differentiated, s; the fastest mode's phase advances by 0.06 rad in it."""
EVERY = 75
"""Every 75th sample of such a run is compared with mass points."""
CENTER = (0.0, 0.75, 0.0)
"""The middle of the paper's path, m, m, rad."""
STILL = {"trajectory": {"kind": "hold", "pose": CENTER}}
"""A constant desired pose."""
MOVING = {
    "gravity": 9.81,
    "initial.pose": (0.06, 0.83, 0.21),
    "initial.pose_rate": (0.9, -0.7, 1.6),
    "initial.beam_coordinates": (0.05, 0.006, -0.02, -0.03),
}
"""Weight, and a fast start with a bent beam."""
UNEQUAL = {
    "left_arm.base": (-0.52, 0.04),
    "left_arm.link_mass": (8.5, 7.0, 3.5),
    "right_arm.base": (0.5, -0.03),
    "right_arm.link_length": (0.66, 0.63, 0.22),
    "right_arm.link_center": (0.3, 0.36, 0.08),
    "right_arm.link_inertia": (0.2, 0.3, 0.02),
}
"""Arms that differ in all their numbers, so that none can stand for another."""
SWINGING = {
    "trajectory.amplitude": (0.2, 0.15, 0.1),
    "trajectory.frequency": (1.0, 0.8, 1.3),
    "trajectory.phase": (0.0, 0.4, -0.3),
}
"""A path whose coordinates differ in all their numbers."""
DAMPING = 0.1
"""The paper's damping coefficient of q̇."""


class Runs:
    """Runs that several subjects share, each simulated when first needed. Raises `StudyError` for one that fails."""

    @cached_property
    def paper(self) -> Run:
        """Section IV for 6 s, which leaves four periods after the first two for spectra."""
        return run_of("the paper's run", {}, 6.0, PERIOD)

    @cached_property
    def free(self) -> Run:
        """2 s without motors and damping: the arms drift and the bent beam rings."""
        changes = {
            "controller.kind": "none",
            "payload.damping.coefficient": 0.0,
            "initial.pose_rate": (0.02, 0.02, -0.03),
            "initial.beam_coordinates": (0.008, 0.0013, 0.0, -0.008),
        }
        return run_of("the free run", changes, 2.0, PERIOD)

    @cached_property
    def general(self) -> Run:
        """The motion of `general` with a beam that is clamped at one end, so that nothing is symmetric."""
        changes = {"payload.boundary": "pinned-clamped", "initial.beam_coordinates": (0.05, 0.006, -0.02)}
        return general("the general run (pinned-clamped)", changes)

    @cached_property
    def general_pinned(self) -> Run:
        """The motion of `general` with the paper's boundary."""
        return general("the general run (pinned-pinned)", {})


def general(name: str, changes: dict[str, Any], commands: Sequence[tuple[float, WorldCommand]] = ()) -> Run:
    """3 ms with weight and `UNEQUAL` arms, moving fast with a bent beam, sampled finely enough to take derivatives.

    Raises `StudyError` if the run fails.
    """
    return run_of(name, MOVING | UNEQUAL | SWINGING | {"simulation.step": FINE} | changes, 0.003, FINE, commands)


def run_of(
    name: str,
    changes: dict[str, Any],
    duration: float,
    period: float,
    commands: Sequence[tuple[float, WorldCommand]] = (),
) -> Run:
    """A run of the paper's system with changes, and with commands at times in s. Raises `StudyError` if it fails."""
    run = simulate(load_preset("paper").replace(changes), duration, period, commands)
    if run.status.failed:
        raise StudyError(f"{name} fails: {run.status.text}")
    return run


@dataclass(frozen=True)
class Check:
    """A statement, the expected value, the value found here, and whether the statement holds."""

    statement: str
    expected: str
    found: str
    holds: bool


Group = Callable[[Runs], Iterator[Check]]
"""Makes the checks of one subject."""
_subjects: dict[str, tuple[int, Group]] = {}
"""Title → (rank in the report, its checks)."""


def subject(title: str, place: int) -> Callable[[Group], Group]:
    """Function decorator: a function's checks become a subject of the report, in the order of `place`."""

    def add(group: Group) -> Group:
        _subjects[title] = place, group
        return group

    return add


@dataclass(frozen=True)
class Validation(Result):
    """All checks by subject, and the runs on which they were made."""

    groups: dict[str, tuple[Check, ...]]
    runs: Runs

    @property
    def table(self) -> Any:
        """A row per statement: subject, statement, expected, found, whether it holds, and flexlab's version."""
        checks = [(subject, check) for subject, group in self.groups.items() for check in group]
        version = {"version": __version__}
        return pa.Table.from_pylist([{"subject": subject} | vars(check) | version for subject, check in checks])

    def plot(self, number: int = 3) -> "Figure":
        """The paper's Figure 2, 3, 4 or 5, drawn from the run of Section IV."""
        from flexlab.analysis.figures import draw_figure

        return draw_figure(number, self.runs.paper)

    def __repr__(self) -> str:
        held = sum(check.holds for check in self.checks)
        return f"<Validation: {held} of {len(self.checks)} statements hold>"

    @property
    def checks(self) -> tuple[Check, ...]:
        """The checks of all subjects."""
        return tuple(check for group in self.groups.values() for check in group)

    @property
    def holds(self) -> bool:
        """Whether every statement holds."""
        return all(check.holds for check in self.checks)


def validate() -> Validation:
    """Compare what this installation computes with the paper and with mechanics: see `.holds` and `.table`.

    The statements are the checks of every `subject` in this folder. A subject whose run fails gets one more check, which
    does not hold and says why.
    """
    modules_in("flexlab.analysis.validation")
    runs = Runs()
    ordered = sorted(_subjects.items(), key=lambda item: item[1][0])
    return Validation({title: tuple(_made(group, runs)) for title, (_, group) in ordered}, runs)


def _made(group: Group, runs: Runs) -> Iterator[Check]:
    try:
        yield from group(runs)
    except (FlexlabError, ArithmeticError, ValueError, IndexError) as error:
        # Wrong physics may give numbers with which a formula fails.
        yield Check("can be computed", "yes", " ".join(str(error).split()) or type(error).__name__, False)


def close(
    statement: str, expected: float, found: float, unit: str = "", relative: float = 0.0, absolute: float = 0.0
) -> Check:
    """A number must equal the expected one within a relative or an absolute tolerance."""
    tolerance = max(relative * abs(expected), absolute)
    within = f" ± {100 * relative:g} %" if relative else f" ± {absolute:g}"
    holds = bool(isfinite(found) and abs(found - expected) <= tolerance)
    wanted = f"{expected:.5g}{within if tolerance else ''} {unit}".rstrip()
    return Check(statement, wanted, f"{found:.5g} {unit}".rstrip(), holds)


def below(statement: str, limit: float, found: ArrayLike, unit: str = "") -> Check:
    """A number, or the largest magnitude of an array, must be less than a limit."""
    value = float(np.max(np.abs(found)) if np.ndim(found) else found)
    holds = bool(isfinite(value) and value < limit)
    return Check(statement, f"< {limit:.3g} {unit}".rstrip(), f"{value:.3g} {unit}".rstrip(), holds)


def alike(statement: str, limit: float, found: ArrayLike, exact: ArrayLike, whole: ArrayLike | None = None) -> Check:
    """The largest difference of two arrays must be less than `limit` times the largest magnitude of `whole` (None: `exact`)."""
    scale = np.max(np.abs(exact if whole is None else whole))
    return below(statement, limit, np.max(np.abs(np.asarray(found) - exact)) / scale)


def above(statement: str, limit: float, found: float) -> Check:
    """A number must be more than a limit."""
    return Check(statement, f"> {limit:.3g}", f"{found:.3g}", bool(isfinite(found) and found > limit))


def true(statement: str, holds: bool, otherwise: str = "no") -> Check:
    """A statement must be true; `otherwise`: what the report says if it is not."""
    return Check(statement, "yes", "yes" if holds else otherwise, holds)


def balanced(statement: str, run: Run, whole: float | None = None) -> Check:
    """Energy gained must equal work less losses, within 1e-6 of `whole`, J (None: of all work and damping)."""
    gained, work = run.total_energy, run.input_work + run.axial_work + run.own.get("material_energy", 0.0)
    lost = run.dissipated_energy + run.own.get("friction_loss", 0.0) + run.own.get("grip_loss", 0.0)
    imbalance = np.abs((gained - gained[0]) - (work - work[0]) + (lost - lost[0])).max()
    moved = np.abs(np.diff(run.input_work)).sum() + np.ptp(run.dissipated_energy) if whole is None else whole
    return below(statement, 1e-6, imbalance / moved)


def same_internal_force(statement: str, run: Run) -> Check:
    """Eq. (26) must give the recorded internal force of Eqs. (13)-(15), within 1e-9 of its largest value."""
    return alike(statement, 1e-9, internal_force_eq_26(run), run.internal_force)
