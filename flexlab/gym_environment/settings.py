"""What an environment may be told: the scenario, how it differs from episode to episode, and how long one is."""

import math
from dataclasses import dataclass
from typing import Any

from flexlab.api import AnyScenario
from flexlab.errors import StudyError
from flexlab.physics.law_input import MOST_DELAY

WRENCH, TORQUES = "wrench", "torques"
LARGEST_NOISE = 1.0
MOST_VARIANTS = 1024
MOST_THREADS = 1024
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-4, 0.02
"""s of a control period."""


@dataclass(frozen=True)
class Settings:
    """Of one environment. Raises `StudyError` for what is not usable."""

    scenario: AnyScenario = "paper"
    """Arms, beam, path; its control law is not at work."""
    action: str = WRENCH
    """"wrench" (3 numbers) or "torques" (3 per arm), see `environment`."""
    control_period: float = 1e-3
    """s between two actions."""
    duration: float = 2.0
    """s of an episode."""
    stiffness: tuple[float, float] | None = None
    """EI of an episode, N·m²: from a range, equal ratios equally likely; None: the scenario's."""
    delay: tuple[int, int] = (0, 0)
    """Control periods by which an episode's actions arrive late: from a range, both ends included."""
    noise: float = 0.0
    """Largest scale of the measuring noise, of which an episode has a random share: 1 is `environment.NOISE`."""
    start_spread: tuple[float, float, float] = (0.005, 0.005, 0.01)
    """How far from the scenario's start pose an episode may start, m, m, rad."""
    torque_limit: float = 200.0
    """N·m of each joint."""
    variants: int = 32
    """Stiffnesses that a range is drawn from: each costs some milliseconds when the environment is made."""
    threads: int | None = None
    """Threads that move the worlds, as far as there are worlds enough; None: as many as the machine has cores."""

    def __post_init__(self) -> None:
        if self.action not in (WRENCH, TORQUES):
            raise StudyError(f"action = {self.action!r:.60} is not known: choose {WRENCH} or {TORQUES}.")
        self._check("control_period", self.control_period, SHORTEST_PERIOD, LONGEST_PERIOD, "s")
        self._check("duration", self.duration, self.control_period, 1e4, "s")
        self._check("noise", self.noise, 0.0, LARGEST_NOISE * 100, "times NOISE")
        self._check("torque_limit", self.torque_limit, 1e-3, 1e6, "N·m")
        for spread in self.start_spread:
            self._check("start_spread", spread, 0.0, 1.0, "m, m, rad")
        for number in self.delay:
            self._check("delay", number, 0, MOST_DELAY, "control periods")
        self._check("variants", self.variants, 1, MOST_VARIANTS, "stiffnesses")
        if self.threads is not None:
            self._check("threads", self.threads, 1, MOST_THREADS, "threads")
        if self.stiffness is not None:
            for value in self.stiffness:
                self._check("stiffness", value, 1e-3, 1e12, "N·m²")
        for name in ("stiffness", "delay"):
            pair = getattr(self, name)
            if pair is not None and (len(pair) != 2 or pair[0] > pair[1]):
                raise StudyError(f"{name} = {pair!r:.60} is no range: write the smaller limit first, (low, high).")

    def _check(self, name: str, value: Any, low: float, high: float, unit: str) -> None:
        usable = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        if not usable or not low <= value <= high:
            raise StudyError(f"{name} = {value!r:.60} is not usable: give a number from {low:g} to {high:g} {unit}.")

    @property
    def ticks(self) -> int:
        """Control periods of an episode."""
        return max(round(self.duration / self.control_period), 1)
