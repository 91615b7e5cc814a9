"""What a check is, and how all of them are made."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isfinite

from flexlab.analysis.validation.runs import Runs
from flexlab.errors import FlexlabError
from flexlab.registry import modules_in


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
class Validation:
    """All checks by subject, and the runs on which they were made."""

    groups: dict[str, tuple[Check, ...]]
    runs: Runs

    @property
    def checks(self) -> tuple[Check, ...]:
        """All of them."""
        return tuple(check for group in self.groups.values() for check in group)

    @property
    def holds(self) -> bool:
        """Whether every statement does."""
        return all(check.holds for check in self.checks)


def validate() -> Validation:
    """Make every check: modules of this folder that define `SUBJECT`, `PLACE` and `checks(runs)`, by place.

    A check that cannot be made, as its run fails, does not hold and says why.
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


def below(statement: str, limit: float, found: float, unit: str = "") -> Check:
    """A number that must be less than a limit."""
    end = f" {unit}" if unit else ""
    return Check(statement, f"< {limit:.3g}{end}", f"{found:.3g}{end}", bool(isfinite(found) and found < limit))


def above(statement: str, limit: float, found: float, unit: str = "") -> Check:
    """A number that must be more than a limit."""
    end = f" {unit}" if unit else ""
    return Check(statement, f"> {limit:.3g}{end}", f"{found:.3g}{end}", bool(isfinite(found) and found > limit))
