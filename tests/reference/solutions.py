"""Stored solutions of an independent solver with all finite-element coordinates, arms in joint space, tolerance 1e-11.

`paper.json` is the paper's run at nine instants; `cases.json` holds other scenarios at five instants each.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.samples import Samples

_FOLDER = Path(__file__).parent
SAMPLE_PERIOD = 0.001
"""s; every stored instant is a multiple of it."""


class Solution(NamedTuple):
    """One scenario and its signals at a few instants."""

    name: str
    scenario: Scenario
    time: np.ndarray
    signals: dict[str, np.ndarray]
    """Signals by their names in `Samples`; first axis: instants."""

    @property
    def rows(self) -> np.ndarray:
        """Indices of the instants in a run sampled at `SAMPLE_PERIOD`."""
        return np.rint(self.time / SAMPLE_PERIOD).astype(int)

    def difference(self, run: Samples, signal: str) -> float:
        """Largest difference of a signal between a run and this solution; angles are compared modulo a turn."""
        given, expected = getattr(run, signal)[self.rows], self.signals[signal]
        difference = given - expected
        if signal == "joint_angle":
            difference = np.remainder(difference + np.pi, 2 * np.pi) - np.pi
        return float(np.abs(difference).max())


def _solution(data: dict[str, Any]) -> Solution:
    data = dict(data)
    name, scenario, time = data.pop("name"), parse_scenario(data.pop("scenario")), np.array(data.pop("time"))
    return Solution(name, scenario, time, {signal: np.array(values) for signal, values in data.items()})


PAPER = _solution(json.loads((_FOLDER / "paper.json").read_text(encoding="utf-8")))
CASES = [_solution(data) for data in json.loads((_FOLDER / "cases.json").read_text(encoding="utf-8"))]
