"""Whether the samples of a run are close enough for metrics of its vibration."""

import math
from collections.abc import Sequence
from types import SimpleNamespace

from flexlab.physics.mass_change import FACTOR, find_mass
from flexlab.recording.course import scenarios
from flexlab.scenario import Payload, Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.snapshot import SHORTEST_PERIOD, Event
from flexlab.text import number_text


def first_frequency(payload: Payload) -> float:
    """f1 of the payload with its grips held, Hz."""
    return float(min(build_beam(payload).modes.omega)) / math.tau


FEWEST = 8
"""Fewest samples per period of the beam's first mode: with fewer, a peak may be 8 % higher than the highest sample."""


def _lightest(payload: Payload, until: float) -> float:
    """Least mass of a payload up to an instant, s, over its mass at the start."""
    now = SimpleNamespace(mass_factor=[1.0, 0.0])
    find_mass(payload.mass_change, until, now)
    return min(1.0, now.mass_factor[FACTOR])


def coarse_note(scenario: Scenario, period: float, until: float, events: Sequence[Event] = ()) -> str:
    """A sentence if samples `period` s apart are too few for metrics of a vibration in the beam's first mode, grips held.

    Otherwise "". Metrics of too few samples may differ much from those of the motion. `scenario`: at the run's start; `until`:
    its last instant, s, up to which `events` may have made the beam stiffer or the payload may have been emptied.
    """
    payloads = [each.payload for each in scenarios(scenario, events, until)]
    # f1 is proportional to the root of this: a change of length, boundary or mesh begins a new run.
    payload = max(payloads, key=lambda one: one.bending_stiffness / (one.linear_density * _lightest(one, until)))
    frequency = first_frequency(payload) / math.sqrt(_lightest(payload, until))
    if not period * frequency * FEWEST > 1:
        return ""
    digits = 10.0 ** math.floor(math.log10(1 / (FEWEST * frequency)))
    enough = digits * math.floor(1 / (FEWEST * frequency) / digits)
    advice = f"Take samples every {number_text(1e3 * enough)} ms or more often."
    if enough < SHORTEST_PERIOD:
        advice = f"Even the shortest sample period, {number_text(1e3 * SHORTEST_PERIOD)} ms, is too long for that."
    return (
        f"Samples are {number_text(1e3 * period)} ms apart, and the beam's first mode has a period of "
        f"{number_text(1e3 / frequency, 3)} ms: peaks, settling time and RMS of the vibration may be far off. {advice}"
    )
