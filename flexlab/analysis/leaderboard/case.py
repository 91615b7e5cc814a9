"""What a case is: a scenario, what is varied in it, what is done to it, and by what laws are compared in it.

A case is a `Case(...)` in a file in `cases/`; table, figures, report and page follow from it. Copy one of
`cases/standard.py`. A score is a metric over a window of a run, with its formula. Less is better.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import inf, nan
from typing import Any

import numpy as np

from flexlab.analysis.metrics import Column, Metric
from flexlab.analysis.metrics.magnitudes import PeakTorque, PeakVibration, RmsInternalForce
from flexlab.analysis.metrics.metric import Peak, RootMeanSquare
from flexlab.analysis.metrics.residual_vibration import LATER, ResidualVibration
from flexlab.analysis.metrics.run_metrics import Window, between, value_text
from flexlab.analysis.metrics.settling_time import SettlingTime
from flexlab.errors import StudyError
from flexlab.presets import load_preset
from flexlab.registry import modules_in
from flexlab.scenario import Scenario
from flexlab.scenario.settings import change_settings
from flexlab.sim.commands import WorldCommand
from flexlab.sim.samples import Samples

ALWAYS: Window = (-inf, inf)


@dataclass(frozen=True)
class Score:
    """One number about a run by which laws are compared."""

    column: Column
    """Short name, title, heading, unit; the number is kept in SI units."""
    formula: str
    metric: Callable[[], Metric]
    number: int = 0
    """Which of the metric's numbers."""
    window: Window = ALWAYS
    """Which samples count, s."""
    floor: float = 1e-9
    """Less than this counts as this where laws are compared, SI: a nanometre is the integrator's error."""

    @property
    def name(self) -> str:
        """In tables for programs."""
        return self.column.field

    @property
    def metric_name(self) -> str:
        """Of the number that is looked at, as in "residual_vibration.later"; within the window, SI."""
        metric = self.metric if isinstance(self.metric, type) else type(self.metric())
        part = metric.columns[self.number].part
        return f"{metric.name}.{part}" if part else metric.name

    def text(self, value: float | None) -> str:
        """A value (SI, None: there is none) with four digits in its unit, or the word that stands for a missing one."""
        return value_text(self.column, nan if value is None else self.column.scale * value)


class Tally:
    """The scores of a run, gathered in pieces."""

    def __init__(self, scores: tuple[Score, ...]):
        self._parts = [(score, score.metric()) for score in scores]

    def update(self, samples: Samples) -> None:
        """Take in the next piece."""
        for score, metric in self._parts:
            piece = between(samples, *score.window)
            if len(piece):
                metric.update(piece)

    def compute(self) -> dict[str, float | None]:
        """SI, by the scores' names; None where there is no number."""
        values = {score.name: float(metric.compute()[score.number]) for score, metric in self._parts}
        return {name: value if np.isfinite(value) else None for name, value in values.items()}


class PeakPositionError(Peak):
    """Largest √(e_x² + e_y²), m."""

    name, place = "peak_position_error", 0
    columns = (Column("peak", "Peak position error", "peak error", "mm", 1e3),)

    def signal(self, samples: Samples) -> np.ndarray:
        """(N, 1)."""
        return _position_error(samples)


class RmsPositionError(RootMeanSquare):
    """Root mean square of √(e_x² + e_y²), m."""

    name, place = "rms_position_error", 0
    columns = (Column("rms", "RMS position error", "RMS error", "mm", 1e3),)

    def signal(self, samples: Samples) -> np.ndarray:
        """(N, 1)."""
        return _position_error(samples)


def _position_error(samples: Samples) -> np.ndarray:
    return np.hypot(samples.tracking_error[:, 0], samples.tracking_error[:, 1])[:, None]


def since(window: Window) -> str:
    """A window as a formula ends."""
    first, last = window
    if first == -inf:
        return ""
    return f", t ≥ {first:g} s" if last == inf else f", {first:g} s ≤ t ≤ {last:g} s"


def peak_error(window: Window = ALWAYS) -> Score:
    """max √(e_x² + e_y²)."""
    return Score(PeakPositionError.columns[0], f"max √(e_x² + e_y²){since(window)}", PeakPositionError, window=window)


def rms_error(window: Window = ALWAYS) -> Score:
    """√(mean(e_x² + e_y²))."""
    return Score(RmsPositionError.columns[0], f"√(mean(e_x² + e_y²)){since(window)}", RmsPositionError, window=window)


def largest_vibration(window: Window) -> Score:
    """max |w(0, t) - its quasi-static part|."""
    column = Column("vibration", "Largest vibration", "vibration", "µm", 1e6)
    return Score(column, f"max |w − w_qs| at mid-span{since(window)}", PeakVibration, window=window)


def residual(later: bool = True) -> Score:
    """What rings after the target has stopped, at once or `LATER` s after it."""
    title = f"Residual vibration {LATER:g} s after the stop" if later else "Residual vibration after the stop"
    column = Column("residual-later" if later else "residual", title, "residual", "µm", 1e6)
    time = f"T + {LATER:g} s" if later else "T"
    return Score(column, f"max |w − w_qs| at mid-span, t > {time}, T: the stop", ResidualVibration, int(later))


def settled(window: Window = ALWAYS) -> Score:
    """How long the vibration stays above a hundredth of its peak."""
    formula = f"last t with |w − w_qs| > 1 % of its peak{since(window)}"
    return Score(SettlingTime.columns[0], formula, SettlingTime, window=window, floor=1e-3)


def peak_torque(window: Window = ALWAYS) -> Score:
    """max |τ| of all joints."""
    return Score(PeakTorque.columns[0], f"max |τ| of any joint{since(window)}", PeakTorque, window=window)


def internal_force(window: Window = ALWAYS) -> Score:
    """RMS of the force by which the arms press against each other."""
    return Score(RmsInternalForce.columns[0], f"√(mean(F_1x² + F_1y²)){since(window)}", RmsInternalForce, window=window)


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
    """Every case by name: what the files of `cases/` define."""
    values = (value for module in modules_in("flexlab.analysis.leaderboard.cases") for value in vars(module).values())
    found = [value for value in values if isinstance(value, Case)]
    return {case.name: case for case in sorted(found, key=lambda case: case.name)}


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
