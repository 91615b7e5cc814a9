"""What a person (or a replay) can ask of a running lab: frozen data, each carrying its whole value.

`WorldCommand`s change the simulation and are logged with their simulation time, so that a run can be replayed.
`RunnerCommand`s steer the clock only.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flexlab.scenario import Scenario
from flexlab.sim.world_state import Origin


@dataclass(frozen=True)
class ChangeScenario:
    """Set fields by dotted path, all or none: `{"payload.bending_stiffness": 50.0}`."""

    changes: Mapping[str, Any]
    keeps_target: bool = True
    """Whether the target goes on from where it is when its path is changed; in recordings before 0.2 it jumped."""


@dataclass(frozen=True)
class Pull:
    """A spring from a point of the beam, or of a link, to a point of the plane; stiffness 0 lets go.

    `link`: (arm, link), both counted from 1; None: the beam. `position`: material coordinate s of the beam, or distance
    from the link's inner joint, m. `target` (x, y), m; `stiffness` N/m.
    """

    position: float
    target: tuple[float, float]
    stiffness: float
    link: tuple[int, int] | None = None


@dataclass(frozen=True)
class Tap:
    """An impulse (x, y) in N·s on the beam's material point s, m, at once."""

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
    """While paused: advance by `ticks` samples."""

    ticks: int = 1


@dataclass(frozen=True)
class SetSpeed:
    """Target of simulated seconds per wall second, 1/256 to 4."""

    speed: float


WorldCommand = ChangeScenario | Pull | Tap
RunnerCommand = LoadScenario | Reset | Play | Pause | StepOnce | SetSpeed
Command = WorldCommand | RunnerCommand
