"""Cases of the leaderboard: a scenario with its variants and commands, and the scores by which laws are compared in it.

To add a case, copy one from `cases/standard.py` into a new file in `cases/`; table, figures, report and page follow from it. A
score is a metric over a window of a run, with its formula; less is better.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from math import inf, nan
from typing import Any

import numpy as np

from flexlab.analysis.metrics import Column, Metric
from flexlab.analysis.metrics import magnitudes as metrics
from flexlab.analysis.metrics.metric import Number, Peak, RootMeanSquare, of_signal
from flexlab.analysis.metrics.run_metrics import Window, value_text
from flexlab.analysis.metrics.vibration import LATER, ResidualVibration, SettlingTime
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
    """A number of a run by which laws are compared."""

    column: Column
    """Short name, title, heading and shown unit; the number itself is in SI units."""
    formula: str
    metric: type[Metric]
    number: int = 0
    """Index among the metric's numbers."""
    window: Window = ALWAYS
    """The window of samples that count, s."""
    floor: float = 1e-9
    """Smaller scores count as this one in comparisons, SI: the integrator's error is about a nanometre."""

    @property
    def name(self) -> str:
        """The name in tables for programs."""
        return self.column.field

    @property
    def metric_name(self) -> str:
        """The name of the metric's number, as in "residual_vibration.later"."""
        return Number(self.metric.name, self.number, self.metric.columns[self.number]).name

    def text(self, value: float | None) -> str:
        """A value (SI) with four digits in the shown unit; for None, the word for a missing value."""
        return value_text(self.column, nan if value is None else self.column.scale * value)


@of_signal(Peak, 0, Column("peak", "Peak position error", "peak error", "mm", 1e3))
def peak_position_error(samples: Samples) -> np.ndarray:
    """Largest √(e_x² + e_y²), m."""
    return np.hypot(*samples.tracking_error[:, :2].T)[:, None]


@of_signal(RootMeanSquare, 0, Column("rms", "RMS position error", "RMS error", "mm", 1e3))
def rms_position_error(samples: Samples) -> np.ndarray:
    """Root mean square of √(e_x² + e_y²), m."""
    return np.hypot(*samples.tracking_error[:, :2].T)[:, None]


def since(window: Window) -> str:
    """A window as the end of a formula."""
    first, last = window
    if first == -inf:
        return ""
    return f", t ≥ {first:g} s" if last == inf else f", {first:g} s ≤ t ≤ {last:g} s"


def _score(
    metric: type[Metric], formula: str, window: Window = ALWAYS, column: Column | None = None, **more: Any
) -> Score:
    return Score(column or metric.columns[0], f"{formula}{since(window)}", metric, window=window, **more)


VIBRATION = Column("vibration", "Largest vibration", "vibration", "µm", 1e6)
peak_error = partial(_score, peak_position_error, "max √(e_x² + e_y²)")
rms_error = partial(_score, rms_position_error, "√(mean(e_x² + e_y²))")
largest_vibration = partial(_score, metrics.peak_vibration, "max |w − w_qs| at mid-span", column=VIBRATION)
settled = partial(_score, SettlingTime, "time up to the last |w − w_qs| > 1 % of its peak", floor=1e-3)
peak_torque = partial(_score, metrics.peak_torque, "max |τ| of any joint")
internal_force = partial(_score, metrics.rms_internal_force, "√(mean(F_1x² + F_1y²))")
"""Scores by their formulas, over a window, s, if one is given."""


def residual(later: bool = True) -> Score:
    """The score of the vibration after the target's stop, or from `LATER` s after the stop on."""
    title = f"Residual vibration {LATER:g} s after the stop" if later else "Residual vibration after the stop"
    column = Column("residual-later" if later else "residual", title, "residual", "µm", 1e6)
    time = f"T + {LATER:g} s" if later else "T"
    return Score(column, f"max |w − w_qs| at mid-span, t > {time}, T: the stop", ResidualVibration, int(later))


SAMPLE_PERIOD = 0.001
"""s between samples of every case."""
SEED = "controller.sensor_noise.seed"
UNSAID = {"title": "", "watch": ""}
"""The scenario's texts, which change no result."""


@dataclass(frozen=True, eq=False)
class Variant:
    """One of the scenarios of a case."""

    name: str
    """Its heading in tables; empty for a single variant."""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the scenario by path."""
    law_fields: Mapping[str, Any] = field(default_factory=dict)
    """Fields of some laws, or of their slow parts; a law without them does not enter this variant."""


@dataclass(frozen=True, eq=False)
class Case:
    """One task for all laws."""

    name: str
    title: str
    what: str
    """One or two sentences on the case."""
    duration: float
    """s."""
    scores: tuple[Score, ...]
    """The first one ranks the laws."""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Changes of the preset paper, by path."""
    variants: tuple[Variant, ...] = (Variant(""),)
    commands: tuple[tuple[float, WorldCommand], ...] = ()
    """(time in s, command) pairs, as `simulate` takes them."""
    long: bool = False
    """Whether the case is computed only if asked for."""

    @property
    def main(self) -> Score:
        """The score that ranks the laws."""
        return self.scores[0]

    def plain_scenario(self, variant: Variant, seed: int) -> Scenario:
        """A variant's scenario under the preset's own law."""
        return change_settings(load_preset("paper"), {**self.changes, **variant.changes, SEED: seed, **UNSAID})


@cache
def cases() -> dict[str, Case]:
    """Every case of the files in `cases/`, by name."""
    values = (value for module in modules_in("flexlab.analysis.leaderboard.cases") for value in vars(module).values())
    found = [value for value in values if isinstance(value, Case)]
    return {case.name: case for case in sorted(found, key=lambda case: case.name)}


def chosen_cases(wanted: Sequence[str | Case] | None, long: bool) -> tuple[Case, ...]:
    """Cases by name or value; None: all, the long ones only if `long`. Raises `StudyError`."""
    if wanted is None:
        return tuple(case for case in cases().values() if long or not case.long)
    if isinstance(wanted, str) or not isinstance(wanted, Sequence):
        raise StudyError(f"cases = {wanted!r:.60} is not a list: give names, as in ['B1', 'B2'].")
    if not wanted:
        raise StudyError("cases is empty: name one case or more, as in ['B1', 'B2'], or leave it out for all.")
    return tuple(dict.fromkeys(map(_case, wanted)))


def _case(wanted: str | Case) -> Case:
    if isinstance(wanted, Case):
        return wanted
    found = cases().get(wanted.upper() if isinstance(wanted, str) else "")
    if found is None:
        raise StudyError(f"{wanted!r:.60} is not a case: choose from {', '.join(cases())}.")
    return found
