"""An explanation: a function of the evidence that returns a sentence, or None if its check fails.

To add one, copy an explanation from `forces.py` into a new file; lab, command line and Python interface then show it, and
`tests/analysis/test_explanations.py` needs a scripted case. A sentence states numbers of this run, and is given only if
measurement and equation agree; for poles and margins the equation alone decides.

The evidence consists of the background, computed once per scenario, and the newest samples of a run.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt
from typing import Any, NamedTuple, Self

import numpy as np

from flexlab.analysis.law_conditions import circumstances, conditions_in
from flexlab.analysis.lesson_measures import largest, newest, strongest_line, tick
from flexlab.analysis.metrics.run_metrics import between
from flexlab.analysis.modes import Modes, PoleRow, Ring, fastest_growth, modes, rings_of
from flexlab.control.conditions import Circumstances, Condition
from flexlab.control.law import law_of
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.lapack import one_blas_thread
from flexlab.recording.course import changed_scenario, is_pulled
from flexlab.scenario import Scenario
from flexlab.scenario.payload import ModalDamping
from flexlab.sim.commands import WorldCommand
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event
from flexlab.sim.target import shaper_impulses
from flexlab.text import fixed_text, number_text

LONGEST_LOOK = 5.0
"""Length of the newest part of a run that explanations use, s."""
CALMED = 0.5
"""Time after a start or change from which a motion counts as steady, s; the paper's beam has stopped ringing by then."""
STEADY = 1.0
"""Length of the steady motion that explanations use, s."""
FEWEST = 64
"""Fewest samples for a spectrum."""


class Background(NamedTuple):
    """Everything that follows from a scenario alone: slow to compute for fine meshes, so computed once, beside the run."""

    scenario: Scenario
    modes: Modes
    conditions: tuple[Condition, ...]
    around: Circumstances | None
    """None if motors are off or no desired pose can be reached."""
    informed: Circumstances | None
    """`around` for a controller with the right model of the payload; None if the controller already has it."""
    shaper: np.ndarray
    """A_j, 1, and t_j, s, of the input shaper's impulses, (impulses, 2)."""
    rings: dict[int, Ring]
    """Number of a beam mode, counted from 1 → its oscillation in the closed loop."""
    fastest: PoleRow | None
    """The fastest growing pole, or the one that decays least; None without poles."""
    inertial_force: np.ndarray
    """B ẍ_d + C̄ ẋ_d along the path of `around`, N, N, N·m, (N, 3)."""
    filled: "Background | None" = None
    """That of the payload after its mass has changed; None if it does not change, or the loop is then unknown."""

    @classmethod
    def of(cls, scenario: Scenario) -> "Background":
        """The background of a scenario. Raises `FlexlabError` for a scenario without modes."""
        with one_blas_thread():
            found, around, informed = modes(scenario), None, None
            _ = found.disk_margin  # Computed here, not in the thread that explains.
            if law_of(scenario.controller).drives:
                around = circumstances(scenario)
                around = around if len(around.path) else None
            if around is not None and scenario.controller.model != type(scenario.controller.model)():
                informed = circumstances(scenario.replace({"controller.model": {}}))
            try:
                shaper = shaper_impulses(scenario)
            except FlexlabError:
                shaper = np.zeros((0, 2))
        conditions = () if around is None else conditions_in(around)
        after = filled(scenario)
        # The shaper stays as it was made for the mass at the start.
        then = None if after is None else cls.of(after)._replace(shaper=shaper)
        along = () if around is None else zip(around.path, around.inertias(), strict=True)
        force = [B @ now.desired[2] + now.C.sum(axis=0) @ now.desired[1] for now, B in along]
        return cls(
            scenario, found, conditions, around, informed, shaper, rings_of(found), fastest_growth(found),
            np.reshape(force, (-1, 3)), then,
        )  # fmt: skip


def filled(scenario: Scenario) -> Scenario | None:
    """The scenario of a payload after its mass has changed (`physics.mass_change`).

    None if the mass does not change, for a law whose observer is for the mass at the start while the law follows the change,
    and for a mass that no scenario may have.
    """
    payload, model = scenario.payload, scenario.controller.model
    factor, part = payload.mass_change.factor, model.mass_change_factor
    if not payload.mass_change.active or (part and hasattr(scenario.controller, "observer")):
        return None
    changes: dict[str, Any] = {
        "payload.linear_density": payload.linear_density * factor,
        "payload.mass_change.factor": 1.0,
        "controller.model.linear_density_factor": model.linear_density_factor * (1 + part * (factor - 1)) / factor,
    }
    if isinstance(payload.damping, ModalDamping):  # D stays, and ζ = D/(2ω m).
        changes["payload.damping.ratio"] = payload.damping.ratio / sqrt(factor)
    try:
        return scenario.replace(changes)
    except ScenarioError:
        return None


@dataclass(frozen=True)
class Evidence:
    """The background of a run's scenario with its present mass, and its newest samples."""

    background: Background
    samples: Samples
    """The newest samples since the last change or touch, `LONGEST_LOOK` s at most."""
    begins: bool
    """Whether the samples begin with the run's first one."""
    touched: bool = False
    """Whether anything changed or touched the run before the samples."""

    @classmethod
    def of_run(
        cls, run: Samples, background: Background, start: float | None = None, events: Sequence[Event] = ()
    ) -> Self:
        """The evidence of the newest part of a run, after the last of its events that changed or touched anything.

        The end of a change of the payload's mass counts as such an event, and while the mass changes there is no evidence.

        `background`: that of the run's present scenario; `start`: time of the run's first sample, s (None: of the first given).
        """
        if not len(run):
            return cls(background, run, False)
        first, last = float(run.time[0]) if start is None else start, float(run.time[-1])
        touched = max((event.time for event in events if isinstance(event.command, WorldCommand)), default=first)
        change, unknown = background.scenario.payload.mass_change, is_pulled(events)
        if change.active and last > change.begin:
            touched = max(touched, change.begin + change.duration)
            unknown |= touched > last or background.filled is None
            background = background.filled or background
        # Bending by a hand that pulls is no vibration, and no sentence knows this cause.
        since = inf if unknown else max(touched, last - LONGEST_LOOK)
        seen = between(run, since, last)
        if first < touched == since and len(seen):  # The sample at a change is the last one before it.
            seen = seen.slice(1, len(seen))
        begins = touched == first and len(seen) > 0 and bool(seen.time[0] == first)
        return cls(background, seen, begins, touched > first)

    @property
    def scenario(self) -> Scenario:
        """The present scenario."""
        return self.background.scenario

    @property
    def length(self) -> float:
        """Duration of the samples, s."""
        return float(self.samples.time[-1] - self.samples.time[0])

    @cached_property
    def period(self) -> float:
        """Sample period, s."""
        return tick(self.samples)

    @cached_property
    def last_second(self) -> Samples:
        """The newest second, or less if there are fewer samples."""
        return newest(self.samples, STEADY)

    @cached_property
    def steady(self) -> Samples | None:
        """The newest second of steady motion; None before there is a full one."""
        return self.last_second if self.length >= CALMED + STEADY - 1e-9 else None

    @property
    def moving(self) -> bool:
        """Whether the target moves in the newest second."""
        return bool(np.any(np.ptp(self.last_second.desired_pose, axis=0) > 1e-6))

    @cached_property
    def strongest(self) -> tuple[float, float]:
        """Frequency, Hz, and amplitude, m, of the strongest oscillation above 2 Hz in the newest second's vibration."""
        signal = self.last_second.vibration
        return (0.0, 0.0) if len(signal) < FEWEST else strongest_line(signal, self.period, 8 * len(signal))

    @cached_property
    def peak_vibration(self) -> float:
        """Largest vibration of the samples, m."""
        return largest(self.samples.vibration)

    def field(self, name: str, usual: float | None = None) -> float | None:
        """A gain of the law or of its slow part, the smallest if there are three; `usual` if neither has it."""
        law = self.scenario.controller
        for part in (law, getattr(law, "slow", None)):
            if part is not None and hasattr(part, name):
                return float(np.min(getattr(part, name)))
        return usual


Look = Callable[[Evidence], str | None]
"""Returns the sentence that the evidence supports, or None."""


class Explanation(NamedTuple):
    """One kind of sentence."""

    name: str
    equation: str
    """The equation that connects cause and effect, with its number in the paper, if any."""
    plot: str
    """The title of the lab's plot that shows it, or the beginning of the titles of several."""
    place: int
    """Rank; smaller ones are more important."""
    look: Look


@dataclass(frozen=True)
class Explained:
    """A sentence about a run, with the equation behind it and the plot that shows it."""

    name: str
    sentence: str
    equation: str
    plot: str

    def __str__(self) -> str:
        return f"{self.sentence} [{self.plot}; {self.equation}]"


EXPLANATIONS: dict[str, Explanation] = {}
"""Every explanation by its name, the most important first."""
NOTHING = 1e-9
"""Magnitude below which a number in a sentence is rounding error."""


def n(value: float) -> str:
    """A number in a sentence, with three digits or all digits before the point."""
    if abs(value) < NOTHING:
        return "0"
    return number_text(value, 3) if abs(value) < 1000 else fixed_text(value, 0)


def register(equation: str, plot: str, place: int) -> Callable[[Look], Look]:
    """Function decorator: adds an explanation, named as its function, to `EXPLANATIONS`. Raises ValueError for a taken name."""

    def add(look: Look) -> Look:
        name = look.__name__.replace("_", " ")
        if name in EXPLANATIONS:
            raise ValueError(f"two explanations are called {name!r}")
        EXPLANATIONS[name] = Explanation(name, equation, plot, place, look)
        ordered = sorted(EXPLANATIONS.items(), key=lambda item: item[1].place)
        EXPLANATIONS.clear()
        EXPLANATIONS.update(ordered)
        return look

    return add


def explain(evidence: Evidence) -> tuple[Explained, ...]:
    """All explanations that the evidence supports, the most important first."""
    if len(evidence.samples) < 2 or not np.isfinite(evidence.samples.vibration).all():
        return ()
    found = ((each, each.look(evidence)) for each in EXPLANATIONS.values())
    # A signal that an old recording lacks is NaN, and a sentence with NaN states nothing.
    said = ((each, text) for each, text in found if text is not None and not re.search(r"\bnan\b", text))
    return tuple(Explained(each.name, text, each.equation, each.plot) for each, text in said)


@np.errstate(over="ignore", invalid="ignore")  # Imported values may be of any size.
def explain_run(
    run: Samples, scenario: Scenario, start: float | None = None, events: Sequence[Event] = ()
) -> tuple[Explained, ...]:
    """The explanations of a run's newest `LONGEST_LOOK` s since its last change or touch, under the scenario that it then has.

    `scenario`: the scenario at the run's start; `start` as for `Evidence.of_run`. Empty if the scenario has no modes, as when an
    arm cannot reach its pose; the run's status says why.
    """
    try:
        background = Background.of(changed_scenario(scenario, events))
    except FlexlabError:
        return ()
    return explain(Evidence.of_run(run, background, start, events))
