"""Runs of presets that tests of several files look at, each simulated once."""

from functools import cache

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate


@cache
def run(preset: str, *changes: tuple[float, str, float], duration: float = 3.0) -> Run:
    """A preset with live changes (time in s, path, value)."""
    commands = [(time, ChangeScenario({path: value})) for time, path, value in changes]
    return simulate(load_preset(preset), duration, 0.001, commands)
