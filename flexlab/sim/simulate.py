"""Headless simulation: one scenario, one duration, all samples."""

import math
from dataclasses import fields

from flexlab.errors import StudyError
from flexlab.scenario import Scenario
from flexlab.sim.samples import Run, Samples, Status
from flexlab.sim.world import World

LONGEST_RUN = 50_000_000
"""Most samples of one run: beyond that its arrays would fill the memory of an ordinary machine."""


def simulate(scenario: Scenario, duration: float = 3.0, sample_period: float = 0.001) -> Run:
    """Simulate `scenario` for `duration` s with a sample exactly at every k · `sample_period` s, t = 0 included.

    A run that cannot start or go on ends early: `run.status` says why, and the good samples are kept.
    Raises `ScenarioError` for a scenario that is not valid and `StudyError` for a duration or period that is not.
    """
    count = _sample_count(duration, sample_period)
    world = World(scenario, sample_period)
    samples = world.run(count)
    status = world.status
    if not status.failed:
        status = Status("finished", f"Finished at t = {world.time:g} s.", world.time)
    signals = {field.name: getattr(samples, field.name) for field in fields(Samples)}
    return Run(**signals, scenario=world.scenario, status=status)


def _sample_count(duration: float, sample_period: float) -> int:
    """Samples after t = 0; refuses what is not a positive finite number or would not fit in memory."""
    for name, value, low in (("duration", duration, 0.0), ("sample_period", sample_period, 1e-6)):
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value < low:
            raise StudyError(f"{name} = {value!r} s is not usable: give a number of seconds, at least {low:g}.")
    if sample_period > MAX_SAMPLE_PERIOD:
        raise StudyError(f"sample_period = {sample_period:g} s is above {MAX_SAMPLE_PERIOD:g} s: choose a shorter one.")
    count = math.floor(duration / sample_period * (1 + 1e-12) + 1e-9)
    if count > LONGEST_RUN:
        raise StudyError(
            f"duration = {duration:g} s at sample_period = {sample_period:g} s makes {count} samples, over {LONGEST_RUN}: "
            "choose a shorter duration or a longer sample period."
        )
    return count


MAX_SAMPLE_PERIOD = 1.0
"""s."""
