"""Runs of presets for the tests in several files, each simulated once."""

from functools import cache

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate


@cache
def run(preset: str, *changes: tuple[float, str, float], duration: float = 3.0) -> Run:
    """Simulate a preset with live changes (time in s, path of a field, value)."""
    commands = [(time, ChangeScenario({path: value})) for time, path, value in changes]
    return simulate(load_preset(preset), duration, 0.001, commands)
