"""Headless simulation: one scenario, one duration, all samples."""

import math
from collections.abc import Sequence
from typing import get_args

from flexlab.arguments import finite_number
from flexlab.errors import StudyError
from flexlab.scenario import Scenario
from flexlab.sim.bumpless_transfer import same_motion
from flexlab.sim.commands import WorldCommand
from flexlab.sim.samples import Run, Status, join_blocks
from flexlab.sim.snapshot import LONGEST_PERIOD, SHORTEST_PERIOD
from flexlab.sim.world import World
from flexlab.text import number_text, range_text

LONGEST_RUN = 50_000_000
"""Largest number of samples of one run: more would fill the memory of an ordinary machine."""
RELATIVE_ROUNDING, LEAST_ROUNDING = 1e-12, 1e-9
"""What rounding adds to a time over the sample period at most, as a share of it and in sample periods."""


def simulate(
    scenario: Scenario,
    duration: float = 3.0,
    sample_period: float = 0.001,
    commands: Sequence[tuple[float, WorldCommand]] = (),
) -> Run:
    """Simulate `scenario` for `duration` s with a sample exactly at every k · `sample_period` s, t = 0 included.

    `commands`: (time in s, command) pairs, as a person in the live lab would give them; each takes effect on the first
    sample instant that is not before its time. A run that cannot start or go on ends early: `run.status` says why, and
    the good samples are kept. Signals of a law are NaN while it is not in force. Raises `ScenarioError` for an invalid
    scenario or command, and `StudyError` for an invalid duration or period, or a command that changes the beam's mesh or
    starts the run anew.
    """
    count, sample_period = sample_count(duration, sample_period), finite_number("sample_period", sample_period, "s")
    world = World(scenario.anew(), sample_period)
    rows, parts = world.new_rows(count + 1), []
    rows[:1] = world.observe_rows()
    begun, done = 0, 1
    _check_commands(commands)
    for time, command in sorted(commands, key=lambda item: item[0]):
        stop = max(done, min(count, tick_at(time, sample_period)) + 1)
        done += world.fill(rows[done - begun : stop - begun])
        if world.status.failed or done > count:
            break
        before, part = world.scenario, world.to_samples(rows[: done - begun])
        if world.apply(command):
            if not same_motion(before, world.scenario):
                raise StudyError(
                    f"The command at t = {number_text(time)} s changes the beam's mesh or restarts: simulate it on its own."
                )
            parts.append(part)
            rows, begun = world.new_rows(count + 1 - done), done
    done += world.fill(rows[done - begun :])
    status = end_status(world)
    samples = world.to_samples(rows[: done - begun])
    return Run(**(join_blocks([*parts, samples]) if parts else samples).signals(), scenario=scenario, status=status)


def end_status(world: World, finished: str = "") -> Status:
    """The status of a run that has ended, with its warnings: why it failed, or the sentence `finished`, or the usual one."""
    if world.status.failed:
        return Status(str(world.status), f"{world.status.text} {world.model_warning.text}".rstrip(), world.status.time)
    finished = finished or f"Finished at t = {number_text(world.time)} s."
    return Status("finished", f"{finished} {world.warnings}".rstrip(), world.time)


def _check_commands(commands: Sequence[tuple[float, WorldCommand]]) -> None:
    """Raise `StudyError` for anything but a list of commands with their times."""
    kinds = ", ".join(kind.__name__ for kind in get_args(WorldCommand))
    example = 'as in [(1.0, ChangeScenario({"gravity": 9.81}))]'
    if not isinstance(commands, Sequence) or isinstance(commands, str):
        raise StudyError(
            f"commands = {commands!r:.60} is not a list: give pairs of a time in s and a command, {example}."
        )
    for item in commands:
        if not isinstance(item, Sequence) or isinstance(item, str) or len(item) != 2:
            raise StudyError(f"commands has {item!r:.60}: give pairs of a time in s and a command, {example}.")
        time, command = item
        finite_number("commands: time", time, "s")
        if not isinstance(command, get_args(WorldCommand)):
            raise StudyError(f"commands: {command!r:.60} is not a command of a world: give one of {kinds}, {example}.")


def tick_at(time: float, sample_period: float) -> int:
    """The first sample instant, counted from 0, that is not before a time, s."""
    return max(0, math.ceil(time / sample_period * (1 - RELATIVE_ROUNDING) - LEAST_ROUNDING))


def sample_count(duration: float, sample_period: float) -> int:
    """Number of samples after t = 0; raises `StudyError` for times that are not usable or too many samples."""
    span, period = finite_number("duration", duration, "s"), finite_number("sample_period", sample_period, "s")
    for name, value, number, low, high in (
        ("duration", duration, span, 0.0, math.inf),
        ("sample_period", sample_period, period, SHORTEST_PERIOD, LONGEST_PERIOD),
    ):
        if not low <= number <= high:
            limit = f"from {range_text(low, high)}" if math.isfinite(high) else f"of at least {number_text(low)}"
            raise StudyError(f"{name} = {value!r:.60} s is not usable: give a number of seconds {limit}.")
    count = span / period * (1 + RELATIVE_ROUNDING) + LEAST_ROUNDING
    if count > LONGEST_RUN:
        raise StudyError(
            f"duration = {number_text(span)} s at sample_period = {number_text(period)} s makes "
            f"{number_text(count)} samples, over {number_text(LONGEST_RUN)}: "
            "choose a shorter duration or a longer sample period."
        )
    return math.floor(count)
