"""What an explanation is: a function that looks at the evidence and gives a sentence, or none where its check fails.

To add one, copy one of `forces.py` into a file of its own: lab, command line and Python interface show it, and
`tests/analysis/test_explanations.py` asks for a scripted case. A sentence states what was measured or computed here, and only
if measurement and equation agree (or, of poles and margins, if the equation alone decides).

Evidence is what a scenario alone says, worked out once for it, and the newest samples of a run.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from flexlab.analysis.law_conditions import circumstances, conditions_in
from flexlab.analysis.lesson_measures import largest, newest, tick
from flexlab.analysis.metrics.run_metrics import between
from flexlab.analysis.modes import Modes, Ring, modes, rings_of
from flexlab.control.conditions import Circumstances, Condition
from flexlab.control.law import law_of
from flexlab.errors import FlexlabError
from flexlab.lapack import one_blas_thread
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.target import shaper_impulses
from flexlab.text import fixed_text, number_text

if TYPE_CHECKING:
    from flexlab.sim.samples import Run


LONGEST_LOOK = 5.0
"""s of a run that explanations look at."""
CALMED = 0.5
"""Time after a start or a change from which on a motion counts as steady, s: the paper's beam has then stopped ringing."""
STEADY = 1.0
"""Steady motion that is looked at, s."""
FEWEST = 64
"""Samples below which a spectrum says nothing."""


class Background(NamedTuple):
    """What a scenario says before it runs. Slow for fine meshes: made once for a scenario, and not where samples are."""

    scenario: Scenario
    modes: Modes
    conditions: tuple[Condition, ...]
    around: Circumstances | None
    """None where motors are off or no desired pose can be reached."""
    informed: Circumstances | None
    """The same for a controller that knows the payload as it is; None where it does already."""
    shaper: np.ndarray
    """A_j, 1, and t_j, s, of the input shaper, (impulses, 2)."""
    rings: dict[int, Ring]
    """Those of the closed loop by the beam's mode number, from 1."""

    @classmethod
    def of(cls, scenario: Scenario) -> "Background":
        """Raises `FlexlabError` where a scenario has no modes."""
        with one_blas_thread():
            found, around, informed = modes(scenario), None, None
            _ = found.disk_margin  # worked out here, not by the thread that looks
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
        return cls(scenario, found, conditions, around, informed, shaper, rings_of(found))


@dataclass(frozen=True)
class Evidence:
    """What is known of a run at an instant."""

    background: Background
    samples: Samples
    """The newest ones, `LONGEST_LOOK` s at most, in which nothing was changed or touched."""
    begins: bool
    """Whether the first of them is the run's first."""

    @classmethod
    def of_run(cls, run: "Run | Samples", background: Background, start: float | None = None) -> Self:
        """Of the newest part of a run in which nothing was changed; `start`: when it began, s, None: with these samples."""
        last = float(run.time[-1]) if len(run) else 0.0
        seen = between(run, last - LONGEST_LOOK, last)
        first = start if start is not None or not len(run) else float(run.time[0])
        return cls(background, seen, len(run) > 0 and bool(seen.time[0] == first))

    @property
    def scenario(self) -> Scenario:
        """The scenario at work."""
        return self.background.scenario

    @property
    def length(self) -> float:
        """Of the samples, s."""
        return float(self.samples.time[-1] - self.samples.time[0])

    @cached_property
    def period(self) -> float:
        """Sample period, s."""
        return tick(self.samples)

    @cached_property
    def last_second(self) -> Samples:
        """The newest second, or what there is of it."""
        return newest(self.samples, STEADY)

    @cached_property
    def steady(self) -> Samples | None:
        """The newest second of steady motion; None before there is one."""
        return newest(self.samples, STEADY) if self.length >= CALMED + STEADY - 1e-9 else None

    @property
    def moving(self) -> bool:
        """Whether the target moves in the newest second."""
        return bool(np.any(np.ptp(self.last_second.desired_pose, axis=0) > 1e-6))

    @cached_property
    def strongest(self) -> tuple[float, float]:
        """Frequency, Hz, and amplitude, m, of the strongest oscillation of the newest second's vibration above 2 Hz."""
        signal = self.last_second.vibration
        if len(signal) < FEWEST:
            return 0.0, 0.0
        window = np.hanning(len(signal))
        amplitude = np.abs(np.fft.rfft((signal - signal.mean()) * window, 8 * len(signal))) * 2 / window.sum()
        hertz = np.fft.rfftfreq(8 * len(signal), self.period)
        best = int(np.argmax(np.where(hertz > 2, amplitude, 0)))
        return float(hertz[best]), float(amplitude[best])

    @cached_property
    def peak_vibration(self) -> float:
        """m."""
        return largest(self.samples.vibration)

    def field(self, name: str, usual: float | None = None) -> float | None:
        """A gain of the law, or of the slow part of a composite one: the smallest of three; `usual` if it has none."""
        law = self.scenario.controller
        for part in (law, getattr(law, "slow", None)):
            if part is not None and hasattr(part, name):
                return float(np.min(getattr(part, name)))
        return usual


Look = Callable[[Evidence], str | None]
"""The sentence that the evidence bears out; None: nothing to say."""


@dataclass(frozen=True)
class Explanation:
    """One kind of sentence."""

    name: str
    equation: str
    """What connects cause and effect, with its number in the paper where it has one."""
    plot: str
    """The title, or the beginning of titles, of the plots in the lab on which it is seen."""
    place: int
    """Rank: smaller ones are more important."""
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
"""Below this a number of a sentence, in the units that people read, is rounding."""


def n(value: float) -> str:
    """A number in a sentence: three digits, or all that stand before the point."""
    if abs(value) < NOTHING:
        return "0"
    return number_text(value, 3) if abs(value) < 1000 else fixed_text(value, 0)


def register(name: str, equation: str, plot: str, place: int) -> Callable[[Look], Look]:
    """Function decorator: adds an explanation to `EXPLANATIONS`. Raises ValueError for a name that is taken."""

    def add(look: Look) -> Look:
        if name in EXPLANATIONS:
            raise ValueError(f"two explanations are called {name!r}")
        EXPLANATIONS[name] = Explanation(name, equation, plot, place, look)
        ordered = sorted(EXPLANATIONS.items(), key=lambda item: item[1].place)
        EXPLANATIONS.clear()
        EXPLANATIONS.update(ordered)
        return look

    return add


def explain(evidence: Evidence) -> tuple[Explained, ...]:
    """All that the evidence bears out, the most important first."""
    if len(evidence.samples) < 2 or not np.isfinite(evidence.samples.vibration).all():
        return ()
    found = ((each, each.look(evidence)) for each in EXPLANATIONS.values())
    # A signal that an old recording lacks reads as NaN: nothing was measured, so nothing is said.
    said = ((each, text) for each, text in found if text is not None and not re.search(r"\bnan\b", text))
    return tuple(Explained(each.name, text, each.equation, each.plot) for each, text in said)


def explain_run(run: "Run") -> tuple[Explained, ...]:
    """What can be said of a run's newest `LONGEST_LOOK` s, as if nothing had changed since its first sample's scenario.

    Nothing of one whose scenario has no modes, as where an arm cannot reach: the run's status says why.
    """
    try:
        background = Background.of(run.scenario)
    except FlexlabError:
        return ()
    return explain(Evidence.of_run(run, background))
