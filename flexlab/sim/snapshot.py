"""The runner's immutable snapshot of the running lab, replaced by one reference assignment, and the consumers of its data."""

from dataclasses import dataclass
from typing import Protocol

from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples, Status, WorldState

TICK = 0.001
"""Sample period of the live engine, s: fine enough for the 44 Hz ring of the paper's beam and for a 1 kHz recording."""
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-6, 1.0
"""Allowed sample periods of runs and imported files, s."""


@dataclass(frozen=True)
class Event:
    """A command that took effect, a status or a problem of a run. `time`: simulation time, s."""

    time: float
    text: str
    command: object | None = None
    level: str = "info"


@dataclass(frozen=True)
class Snapshot:
    """Everything that a screen shows, at one moment.

    `run_number` counts runs (reset and preset start a new one); `latest` holds the newest sample (N = 1) as computed,
    `display` the state to draw (N = 1: interpolated between samples in slow motion, never ahead of `latest`).
    """

    run_number: int
    name: str
    scenario: Scenario
    status: Status
    playing: bool
    latest: Samples
    display: Samples
    target_speed: float
    actual_speed: float
    """Simulated seconds per wall second over the last second (0 while paused)."""
    too_slow: bool
    """Whether the machine fell behind within the last second, so that a backlog was dropped."""
    dropped_samples: int
    """Samples that did not reach a consumer since the run began."""
    first_frequency: float
    """f1 of the payload beam with its grips held, Hz."""
    events: tuple[Event, ...]
    """The newest events of this run, oldest first."""
    steps_left: int = 0
    """Single steps that were asked for and are not done yet; a paused run does them as fast as it can."""
    start_time: float = 0.0
    """Simulation time at which the run began, s: not 0 if it goes on from an earlier one."""
    waiting: bool = False
    """Whether the run waits at its first instant until somebody can see it."""
    accuracy_warning: str = ""
    """A sentence that says since when and why the run's results are no longer accurate; empty while they are."""
    model_warning: str = ""
    """As `World.model_warning`: sentences on what the beam's model neglects."""
    pace_warning: str = ""
    """As `World.pace_warning`: what makes the run slower than real time, and what to change."""
    answered: int = 0
    """All commands up to this number, as `Runner.submit` returned it, have been carried out or refused."""

    @property
    def moves(self) -> bool:
        """Whether it plays, or does single steps."""
        return self.playing or self.steps_left > 0


class Consumer(Protocol):
    """A receiver of every sample and event. Called on the simulation thread: must return at once (enqueue, never block)."""

    def begin_run(self, run_number: int, name: str, scenario: Scenario, start: WorldState) -> None:
        """A new run starts (reset, preset, or a change of structure, after which time goes on); `start`: its state."""

    def take_samples(self, run_number: int, samples: Samples, actual_speed: float) -> int:
        """The next block (N >= 1 rows, contiguous with the block before); returns how many rows it had to drop."""
        ...

    def take_event(self, run_number: int, event: Event) -> None:
        """A command took effect, a status changed."""

    def end_run(self, run_number: int, status: Status) -> None:
        """The run is over; no more samples of this number follow."""
