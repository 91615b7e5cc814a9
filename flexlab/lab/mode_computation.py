"""Computes modes, stability conditions and the background of explanations on a separate thread.

A fine mesh then delays neither picture nor controls.
"""

import threading
import time
from collections.abc import Callable

import numpy as np

from flexlab.analysis.explanations.explanation import Background
from flexlab.analysis.modes import Modes
from flexlab.control.conditions import Condition
from flexlab.errors import telling
from flexlab.scenario import Payload, Scenario
from flexlab.scenario.scenario import SAID
from flexlab.sim.geometry import deflection_at

REST = 0.3
"""Time without a change of the scenario after which its modes are computed at once, s."""

PAUSE_SHARE = 9
"""Pause after a computation while changes go on (a dragged slider), as a multiple of its duration: the picture comes first."""

PEAK_POINTS = 101
"""Points along the beam among which the largest deflection is found."""

NOT_IN_THE_LOOP = (*SAID, "initial", "simulation")
"""Fields of a scenario on which neither its modes nor its law's conditions depend."""


def peak_deflection(payload: Payload, shape: np.ndarray) -> float:
    """The largest |w| along the beam, m, for free coordinates `shape` (n_q,), or several (N, n_q)."""
    along = np.linspace(-0.5, 0.5, PEAK_POINTS) * payload.length
    return float(np.abs(deflection_at(payload, np.atleast_2d(shape), along)).max())


class ModeStudy:
    """Holds the newest finished result. One computation runs at a time, and few while changes go on.

    One thread calls `ask` repeatedly; any thread may read.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._thread: threading.Thread | None = None
        self._asked: tuple | None = None
        self._wanted: tuple | None = None
        self._wanted_since = self._not_before = float("-inf")
        self.result: Modes | None = None
        """Modes of the scenario last computed; None before the first, and if there are none."""
        self.problem = ""
        """Why there is no result, as a sentence."""
        self.conditions: tuple[Condition, ...] = ()
        """The stability conditions of the control law, met or not."""
        self._background: Background | None = None

    def ask(self, scenario: Scenario) -> None:
        """Compute the modes of `scenario`, unless they are known, a computation runs, or one ended just now."""
        now, key = self._clock(), _key(scenario)
        if self._wanted != key:
            self._wanted, self._wanted_since = key, now
        busy = self._thread is not None and self._thread.is_alive()
        if busy or self._asked == key or (now < self._not_before and now - self._wanted_since < REST):
            return
        self._asked = key
        self._thread = threading.Thread(target=self._compute, args=(scenario,), name="flexlab-modes", daemon=True)
        self._thread.start()

    def background(self, scenario: Scenario) -> Background | None:
        """What explanations need to know about `scenario`; None until it is computed."""
        found = self._background
        return found if found is not None and _key(found.scenario) == _key(scenario) else None

    def modes_of(self, payload: Payload) -> Modes | None:
        """The newest modes if they belong to this payload."""
        found = self._background
        return found.modes if found is not None and found.scenario.payload == payload else None

    def stop(self) -> None:
        """Wait for a computation in progress."""
        if self._thread is not None:
            self._thread.join()

    def _compute(self, scenario: Scenario) -> None:
        begun = self._clock()
        with telling(self._give_up, "The modes could not be computed ({})."):
            self._background = found = Background.of(scenario)
            self.conditions, self.result, self.problem = found.conditions, found.modes, ""
        now = self._clock()
        self._not_before = now + PAUSE_SHARE * (now - begun)

    def _give_up(self, problem: str) -> None:
        self.conditions, self.result, self.problem = (), None, problem


def _key(scenario: Scenario) -> tuple:
    """Everything that the modes and the law's conditions depend on."""
    return tuple(part for name, part in vars(scenario).items() if name not in NOT_IN_THE_LOOP)
