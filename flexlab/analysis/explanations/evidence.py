"""What explanations look at: what a scenario alone says, worked out once for it, and the newest samples of a run."""

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
