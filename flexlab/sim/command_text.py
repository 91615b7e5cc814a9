"""Commands in words, for event lists and logs."""

from collections.abc import Mapping
from typing import Any

from flexlab.number_text import number_text
from flexlab.scenario import Scenario
from flexlab.scenario.choices import TITLES
from flexlab.scenario.field_text import value_text
from flexlab.sim.commands import (
    ChangeScenario,
    Command,
    LoadScenario,
    Pause,
    Play,
    Pull,
    Reset,
    SetSpeed,
    StepOnce,
    Tap,
)
from flexlab.sim.world_state import Origin

TEXTS = {"controller.source": "Text of the control law", "trajectory.source": "Text of the path"}
"""Fields that hold a person's own code."""
OF_A_TABLE = ("trajectory.source", "trajectory.table", "trajectory.table_of")
"""Fields that go with every change of an option of a path in Python."""


def command_text(command: Command) -> str:
    """One line that says what a command does, with values and units."""
    if isinstance(command, ChangeScenario):
        shown = {path: value for path, value in command.changes.items() if path not in OF_A_TABLE}
        shown = shown or {path: command.changes[path] for path in TEXTS if path in command.changes}
        return "; ".join(_change_text(path, value) for path, value in shown.items())
    if isinstance(command, Pull):
        if command.stiffness == 0:
            return f"Let go of {_held(command)}"
        x, y = command.target
        along = command.position
        where = f" at s = {along:.3f} m" if command.link is None else f", {along:.3f} m along it,"
        return f"Pull {_held(command)}{where} to ({x:.3f}, {y:.3f}) m, {number_text(command.stiffness)} N/m"
    if isinstance(command, Tap):
        x, y = command.impulse
        return f"Tap the beam at s = {command.beam_position:.3f} m with ({number_text(x, 3)}, {number_text(y, 3)}) N·s"
    if isinstance(command, LoadScenario):
        return f"Load {command.name}" if command.origin is None else _resume_text(command.origin)
    if isinstance(command, SetSpeed):
        return f"Speed {number_text(command.speed)} × real time"
    if isinstance(command, StepOnce):
        return f"Step {command.ticks} ms"
    names: dict[type, str] = {Play: "Play", Pause: "Pause", Reset: "Reset"}
    return names[type(command)]


def _held(command: Pull) -> str:
    if command.link is None:
        return "the beam"
    arm, link = command.link
    return f"link {link} of the {'left' if arm == 1 else 'right'} arm"


def _resume_text(origin: Origin) -> str:
    return f"Go on from {origin.run} at t = {origin.time:.3f} s"


def _change_text(path: str, value: Any) -> str:
    if path in TEXTS:
        return f"{TEXTS[path]}, {len(value.splitlines())} lines"
    if path == "trajectory" and isinstance(value, Mapping):
        return f"Path {value.get('kind', '')}"
    if path in TITLES:
        return f"{TITLES[path]} = {value_text(value)}"
    usual = Scenario()
    if not usual.has(path):
        return f"{path} = {value_text(value)}"
    about = usual.about(path)
    return f"{about.title} {about.symbol} = {value_text(value)}{about.unit_text()}".replace("  ", " ")
