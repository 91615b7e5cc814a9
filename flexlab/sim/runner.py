"""The simulation thread: paces a `World` by an injected clock, drains commands, publishes snapshots, feeds consumers.

CONTRACT (implementation under way).
"""

from collections.abc import Callable, Sequence
from typing import Protocol

from flexlab.scenario import Scenario
from flexlab.sim.commands import Command
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event, Snapshot


class Consumer(Protocol):
    """Who gets every sample and event. Called on the simulation thread: must return at once (enqueue, never block)."""

    def begin_run(self, run_number: int, name: str, scenario: Scenario) -> None:
        """A new run starts (reset, preset, structural restart)."""

    def take_samples(self, run_number: int, samples: Samples, actual_speed: float) -> int:
        """The next block (N >= 1 rows, contiguous with the block before); returns how many rows it had to drop."""
        ...

    def take_event(self, run_number: int, event: Event) -> None:
        """A command took effect, a status changed."""

    def end_run(self, run_number: int, status: Status) -> None:
        """The run is over; no more samples of this number follow."""


class Runner:
    """Owns the world and its thread. `submit` may be called from any thread; nobody else touches the world."""

    def __init__(
        self,
        scenario: Scenario,
        name: str = "scenario",
        consumers: Sequence[Consumer] = (),
        playing: bool = True,
        clock: Callable[[], float] | None = None,
        sleep: Callable[[float], None] | None = None,
    ): ...

    def start(self) -> None:
        """Start the thread."""

    def stop(self) -> None:
        """Stop the thread, end the run, return when both are done. May be called twice."""

    def submit(self, command: Command) -> None:
        """Queue a command; it takes effect at the head of the runner's next frame. Invalid ones become error events."""

    @property
    def snapshot(self) -> Snapshot:
        """The newest published snapshot (never None after construction)."""
        ...

    def recent(self, seconds: float) -> Samples:
        """The last `seconds` of the current run at full rate (at most 30 s), for plots. A copy, any thread."""
        ...
