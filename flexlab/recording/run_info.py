"""What is known of a run when its recording is opened."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Protocol
from uuid import uuid4

from flexlab.recording.scene_log import exaggeration
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import TICK, Event
from flexlab.sim.world_state import WorldState


@dataclass(frozen=True)
class RunInfo:
    """Name, scenario and circumstances of one run."""

    name: str
    """The preset (or file) that the scenario came from."""
    scenario: Scenario
    sample_period: float = TICK
    """s."""
    start: WorldState | None = None
    """The world's state at the first sample; None: the scenario's own start."""
    started: datetime = field(default_factory=lambda: datetime.now().astimezone())
    run_id: str = field(default_factory=lambda: str(uuid4()))
    """The same for all parts of a run and for file and live view."""
    part: int = 1
    """Which file of the run: a full disk ends one part and the next begins when there is room."""

    begin_notes: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """What stands beside the file from its beginning, so that it stands there too if its writer dies."""

    measured: str = ""
    """Which data these are, for a run that was measured: nothing of it can be drawn in space. Empty for a simulated one."""

    recorded_by: Mapping[str, str] | None = None
    """Versions and machine that computed the samples, by the names of the recording's properties; None: these here."""

    @property
    def exaggeration(self) -> float:
        """The factor on the drawn deflection: of the scenario that the run starts from, so that it never jumps."""
        return exaggeration(self.scenario)

    @property
    def title(self) -> str:
        """The run's name in the viewer."""
        part = f", part {self.part}" if self.part > 1 else ""
        return f"{self.name} {self.started:%Y-%m-%d %H:%M:%S}{part}"


class RunNotes(Protocol):
    """Looks at all samples and events of one run; what it makes of them goes into the notes beside the recording."""

    def add(self, samples: Samples) -> None:
        """Take in a block (N >= 1)."""
        ...

    def add_event(self, event: Event) -> None:
        """Take in an event."""
        ...

    def result(self, status: Status) -> dict[str, Any]:
        """Notes by name, plain enough for JSON; `status`: how the run ended."""
        ...


StartNotes = Callable[[RunInfo], RunNotes]
"""Begins the notes of a run."""
