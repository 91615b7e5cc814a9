"""Whether samples are too far apart for metrics of a vibration, which are those of the samples and not of what moves."""

import math

from flexlab.analysis.lesson_measures import first_frequency
from flexlab.scenario import Scenario
from flexlab.text import number_text

FEWEST = 8
"""Least samples per period of the beam's first mode: with fewer, a peak may be 8 % higher than the highest sample."""


def coarse_note(scenario: Scenario, period: float) -> str:
    """A sentence if samples `period` s apart are too few for the beam's first mode, with its grips held; empty: they are not."""
    frequency = first_frequency(scenario.payload)
    if not period * frequency * FEWEST > 1:
        return ""
    digits = 10.0 ** math.floor(math.log10(1 / (FEWEST * frequency)))
    enough = digits * math.floor(1 / (FEWEST * frequency) / digits)
    return (
        f"Samples are {number_text(1e3 * period)} ms apart, and the beam's first mode has a period of "
        f"{number_text(1e3 / frequency, 3)} ms: peaks, settling time and RMS of what vibrates may be far from the motion's. Take "
        f"samples every {number_text(1e3 * enough)} ms or oftener."
    )
