"""What somebody higher up wants noted of a run while it is written: this room does not know what."""

from collections.abc import Callable
from typing import Any, Protocol

from flexlab.recording.run_info import RunInfo
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event


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
