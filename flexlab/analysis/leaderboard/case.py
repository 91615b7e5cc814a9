"""What a case is: a scenario, what is varied in it, what is done to it, and by what laws are compared in it.

A case is a file in `cases/` that defines `CASE = Case(...)`; table, figures, report and page follow from it. Copy
`cases/b3_impulse.py`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from flexlab.analysis.leaderboard.score import Score
from flexlab.errors import StudyError
from flexlab.presets import load_preset
from flexlab.registry import modules_in
from flexlab.scenario import Scenario
from flexlab.scenario.settings import change_settings
from flexlab.sim.commands import WorldCommand

SAMPLE_PERIOD = 0.001
"""s between samples of every case."""
SEED = "controller.sensor_noise.seed"
UNSAID = {"title": "", "watch": ""}
"""What a scenario says of itself changes no result."""


@dataclass(frozen=True, eq=False)
class Variant:
    """One of the scenarios of a case."""

    name: str
    """What is special about it, in a few signs; empty where there is only one."""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the scenario by path."""
    law_fields: Mapping[str, Any] = field(default_factory=dict)
    """Fields that some laws have, or their slow part: a law without them does not enter here."""


@dataclass(frozen=True, eq=False)
class Case:
    """One task for all laws."""

    name: str
    title: str
    what: str
    """One or two sentences for people."""
    duration: float
    """s."""
    scores: tuple[Score, ...]
    """The first one ranks."""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """What makes the preset paper into this case, by path."""
    variants: tuple[Variant, ...] = (Variant(""),)
    commands: tuple[tuple[float, WorldCommand], ...] = ()
    """(time in s, command) pairs, as `simulate` takes them."""
    long: bool = False
    """Whether it is left out unless asked for."""

    @property
    def main(self) -> Score:
        """What ranks."""
        return self.scores[0]

    def plain_scenario(self, variant: Variant, seed: int) -> Scenario:
        """A variant under the preset's own law."""
        return change_settings(load_preset("paper"), {**self.changes, **variant.changes, SEED: seed, **UNSAID})


@cache
def cases() -> dict[str, Case]:
    """Every case by name, in the order of the files' names."""
    found = [module.CASE for module in modules_in("flexlab.analysis.leaderboard.cases")]
    return {case.name: case for case in found}


def chosen_cases(wanted: Sequence[str | Case] | None, long: bool) -> tuple[Case, ...]:
    """Cases by name or value; None: all, the long ones only if asked for. Raises `StudyError`."""
    if wanted is None:
        return tuple(case for case in cases().values() if long or not case.long)
    if isinstance(wanted, str) or not isinstance(wanted, Sequence):
        raise StudyError(f"cases = {wanted!r:.60} is no list: give names, as in ['B1', 'B2'].")
    return tuple(dict.fromkeys(map(_case, wanted)))


def _case(wanted: str | Case) -> Case:
    if isinstance(wanted, Case):
        return wanted
    found = cases().get(wanted.upper() if isinstance(wanted, str) else "")
    if found is None:
        raise StudyError(f"{wanted!r:.60} is no case: choose from {', '.join(cases())}.")
    return found
