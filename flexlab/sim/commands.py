"""The commands of a person (or a replay) to a running lab, as frozen data with complete values, and as text for logs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexlab.scenario import Scenario
from flexlab.scenario.field_text import FOLLOW, TITLES, value_text
from flexlab.sim.samples import Origin
from flexlab.text import fixed_text, number_text

RESTART_FIELDS = ("payload.length", "left_arm", "right_arm", "initial")
"""Fields whose change cannot be made in motion: the run begins anew."""
MESH_FIELDS = ("payload.element_count", "payload.boundary")
"""Fields on which the meaning of the beam's coordinates depends: their change begins a new run, in which time goes on."""


@dataclass(frozen=True)
class ChangeScenario:
    """Set fields by dotted path, all or none: `{"payload.bending_stiffness": 50.0}`."""

    changes: Mapping[str, Any]
    keeps_target: bool = True
    """Whether the target goes on from where it is when its path changes; in recordings before 0.2 it jumped."""


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's, which recordings hold; anything else as it is."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    return tuple(map(_plain, value)) if isinstance(value, (tuple, list)) else value


class _OfPlainNumbers:
    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            object.__setattr__(self, name, _plain(value))


@dataclass(frozen=True)
class Pull(_OfPlainNumbers):
    """A spring from a point of the beam, or of a link, to a point of the plane; stiffness 0 releases it.

    `link`: (arm, link), both counted from 1; None for the beam. `position`: material coordinate s of the beam, or distance
    from the link's inner joint, m. `target` (x, y), m; `stiffness` N/m.
    """

    position: float
    target: tuple[float, float]
    stiffness: float
    link: tuple[int, int] | None = None


@dataclass(frozen=True)
class Tap(_OfPlainNumbers):
    """An impulse (x, y), N·s, on the beam's material point s, m."""

    beam_position: float
    impulse: tuple[float, float]


@dataclass(frozen=True)
class LoadScenario:
    """Start a new run from a scenario; `name` is the preset it came from (for the recording's file name).

    With an `origin` it goes on from there, in state and in time; without one it begins at the scenario's own start.
    """

    scenario: Scenario
    name: str
    origin: Origin | None = None


@dataclass(frozen=True)
class Reset:
    """Start a new run from the present scenario."""


@dataclass(frozen=True)
class Play:
    """Let simulation time run."""


@dataclass(frozen=True)
class Pause:
    """Hold simulation time."""


@dataclass(frozen=True)
class StepOnce:
    """Pause and advance by `ticks` samples."""

    ticks: int = 1


@dataclass(frozen=True)
class SetSpeed:
    """Set the target of simulated seconds per wall second, 1/256 to 4."""

    speed: float


WorldCommand = ChangeScenario | Pull | Tap
RunnerCommand = LoadScenario | Reset | Play | Pause | StepOnce | SetSpeed
Command = WorldCommand | RunnerCommand
TEXTS = {"controller.source": "Text of the control law", "trajectory.source": "Text of the path"}
"""Fields that hold a person's own code."""
OF_A_TABLE = ("trajectory.source", *FOLLOW)
"""Fields that come with every change of an option of a path in Python."""


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
        where = f" at s = {fixed_text(along, 3)} m" if command.link is None else f", {along:.3f} m along it,"
        return f"Pull {_held(command)}{where} to ({fixed_text(x, 3)}, {fixed_text(y, 3)}) m, {number_text(command.stiffness)} N/m"
    if isinstance(command, Tap):
        x, y = command.impulse
        return f"Tap the beam at s = {fixed_text(command.beam_position, 3)} m with ({number_text(x, 3)}, {number_text(y, 3)}) N·s"
    if isinstance(command, LoadScenario):
        origin = command.origin
        return f"Load {command.name}" if origin is None else f"Go on from {origin.run} at t = {origin.time:.3f} s"
    if isinstance(command, SetSpeed):
        return f"Speed {number_text(command.speed)} × real time"
    if isinstance(command, StepOnce):
        return f"Step {command.ticks} ms"
    return type(command).__name__  # Play, Pause, Reset


def _held(command: Pull) -> str:
    if command.link is None:
        return "the beam"
    arm, link = command.link
    return f"link {link} of the {'left' if arm == 1 else 'right'} arm"


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
