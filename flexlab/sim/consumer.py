"""What the runner tells those who record or watch a run."""

from typing import Protocol

from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event
from flexlab.sim.world_state import WorldState


class Consumer(Protocol):
    """Who gets every sample and event. Called on the simulation thread: must return at once (enqueue, never block)."""

    def begin_run(self, run_number: int, name: str, scenario: Scenario, start: WorldState) -> None:
        """A new run starts (reset, preset, or a change of structure, after which time goes on); `start`: its state."""

    def take_samples(self, run_number: int, samples: Samples, actual_speed: float) -> int:
        """The next block (N >= 1 rows, contiguous with the block before); returns how many rows it had to drop."""
        ...

    def take_event(self, run_number: int, event: Event) -> None:
        """A command took effect, a status changed."""

    def end_run(self, run_number: int, status: Status) -> None:
        """The run is over; no more samples of this number follow."""
