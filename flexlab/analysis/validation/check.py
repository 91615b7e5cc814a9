"""What a check is, how all of them are made, and the runs that they look at, each simulated once."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike

from flexlab.analysis.result import Result
from flexlab.errors import FlexlabError, StudyError
from flexlab.presets import load_preset
from flexlab.recording.run_info import package_version
from flexlab.registry import modules_in
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PERIOD = 0.001
"""s between samples of the paper's run."""
FINE = 1e-5
"""s between samples of the run whose derivatives are taken: the fastest mode moves by 0.06 rad in it."""


class Runs:
    """Simulated when they are first asked for. Raises `StudyError` for one that fails."""

    @cached_property
    def paper(self) -> Run:
        """Section IV for 6 s: four periods are left for spectra after the second."""
        return _whole("the paper's run", simulate(load_preset("paper"), 6.0, PERIOD))

    @cached_property
    def free(self) -> Run:
        """Motors off, no damping: the arms drift and a bent beam rings, for 2 s."""
        changes = {
            "controller.kind": "none",
            "payload.damping.coefficient": 0.0,
            "initial.pose_rate": (0.02, 0.02, -0.03),
            "initial.beam_coordinates": (0.008, 0.0013, 0.0, -0.008),
        }
        return _whole("the free run", simulate(load_preset("paper").replace(changes), 2.0, PERIOD))

    @cached_property
    def general(self) -> Run:
        """3 ms of the paper's system with weight, in the middle of a fast motion, its beam bent and clamped at one end.

        It has no symmetry, and is sampled finely enough to take derivatives.
        """
        return _general("pinned-clamped", (0.05, 0.006, -0.02))

    @cached_property
    def general_pinned(self) -> Run:
        """The same with the paper's boundary."""
        return _general("pinned-pinned", (0.05, 0.006, -0.02, -0.03))


def _general(boundary: str, beam_coordinates: tuple[float, ...]) -> Run:
    return general(f"the general run ({boundary})", boundary, beam_coordinates)


def general(
    name: str,
    boundary: str = "pinned-pinned",
    beam_coordinates: tuple[float, ...] = (0.05, 0.006, -0.02, -0.03),
    **changes: Any,
) -> Run:
    """3 ms of a fast, heavy, bent motion, with further changes (dots as double underlines). Raises `StudyError`."""
    start = {
        "gravity": 9.81,
        "payload.boundary": boundary,
        "initial.pose": (0.06, 0.83, 0.21),
        "initial.pose_rate": (0.9, -0.7, 1.6),
        "initial.beam_coordinates": beam_coordinates,
        "simulation.step": FINE,
    }
    return run_of(name, start | {path.replace("__", "."): value for path, value in changes.items()}, 0.003, FINE)


def run_of(name: str, changes: dict[str, Any], duration: float, period: float) -> Run:
    """A run of the paper's system with changes. Raises `StudyError` if it fails."""
    return _whole(name, simulate(load_preset("paper").replace(changes), duration, period))


def _whole(name: str, run: Run) -> Run:
    if run.status.failed:
        raise StudyError(f"{name} fails: {run.status.text}")
    return run


@dataclass(frozen=True)
class Check:
    """One statement, what is expected of it, what came out, and whether it holds."""

    statement: str
    expected: str
    found: str
    holds: bool


Group = Callable[[Runs], Iterator[Check]]
"""The checks of one subject."""


@dataclass(frozen=True)
class Validation(Result):
    """All checks by subject, and the runs on which they were made."""

    groups: dict[str, tuple[Check, ...]]
    runs: Runs

    @property
    def table(self) -> Any:
        """A row per statement: subject, statement, expected, found, whether it holds, and the version that was asked."""
        version = package_version()
        rows = [
            {"subject": subject, **vars(check), "version": version}
            for subject, checks in self.groups.items()
            for check in checks
        ]
        return pa.Table.from_pylist(rows)

    def plot(self, number: int = 3) -> "Figure":
        """The paper's Figure 2, 3, 4 or 5 of the run that was looked at."""
        from flexlab.analysis.figures import draw_figure

        return draw_figure(number, self.runs.paper)

    @property
    def checks(self) -> tuple[Check, ...]:
        """All of them."""
        return tuple(check for group in self.groups.values() for check in group)

    @property
    def holds(self) -> bool:
        """Whether every statement does."""
        return all(check.holds for check in self.checks)


def validate() -> Validation:
    """Compare what this installation computes with the paper and with mechanics: `.holds`, and a row per statement.

    The statements are those of the modules in this folder that define `SUBJECT`, `PLACE` and `checks(runs)`. A check that
    cannot be made, as its run fails, does not hold and says why.
    """
    runs = Runs()
    subjects = [module for module in modules_in("flexlab.analysis.validation") if hasattr(module, "SUBJECT")]
    subjects.sort(key=lambda module: module.PLACE)
    return Validation({module.SUBJECT: tuple(_made(module.checks, runs)) for module in subjects}, runs)


def _made(group: Group, runs: Runs) -> Iterator[Check]:
    try:
        yield from group(runs)
    except (FlexlabError, ArithmeticError, ValueError, IndexError) as error:
        # Wrong physics ends in numbers that no formula takes: that, too, is an answer.
        yield Check("can be computed", "yes", " ".join(str(error).split()) or type(error).__name__, False)


def close(
    statement: str, expected: float, found: float, unit: str = "", relative: float = 0.0, absolute: float = 0.0
) -> Check:
    """A number that must be as expected, within a relative or an absolute tolerance."""
    tolerance = max(relative * abs(expected), absolute)
    within = f" ± {100 * relative:g} %" if relative else f" ± {absolute:g}"
    holds = bool(isfinite(found) and abs(found - expected) <= tolerance)
    end = f" {unit}" if unit else ""
    return Check(statement, f"{expected:.5g}{within if tolerance else ''}{end}", f"{found:.5g}{end}", holds)


def below(statement: str, limit: float, found: ArrayLike, unit: str = "") -> Check:
    """A number that must be less than a limit; of an array, its largest magnitude."""
    value = float(np.max(np.abs(found)) if np.ndim(found) else found)
    end = f" {unit}" if unit else ""
    return Check(statement, f"< {limit:.3g}{end}", f"{value:.3g}{end}", bool(isfinite(value) and value < limit))


def alike(statement: str, limit: float, found: ArrayLike, exact: ArrayLike, whole: ArrayLike | None = None) -> Check:
    """Arrays whose largest difference must be less than a part of the largest magnitude of `whole`; None: of `exact`."""
    scale = np.max(np.abs(exact if whole is None else whole))
    return below(statement, limit, np.max(np.abs(np.asarray(found) - exact)) / scale)


def above(statement: str, limit: float, found: float) -> Check:
    """A number that must be more than a limit."""
    return Check(statement, f"> {limit:.3g}", f"{found:.3g}", bool(isfinite(found) and found > limit))
