"""Records a run that waits for its recorder: nothing is dropped, however fast the simulation."""

from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from flexlab.recording.finishing import finish
from flexlab.recording.run_files import claim_run_file, write_notes
from flexlab.recording.run_info import RunInfo
from flexlab.recording.run_stream import open_file_stream
from flexlab.recording.run_writer import RunWriter
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event

if TYPE_CHECKING:
    from flexlab.sim.world import World


class HeadlessRecording:
    """The recording of one run, written on the caller's own thread. Raises `RecordingError` if it cannot be."""

    def __init__(self, logs: Path, name: str, world: "World"):
        info = RunInfo(name, world.scenario, world.tick_period)
        self._file = claim_run_file(logs, name, info.started)
        self._run = RunWriter(info)
        self._stream = open_file_stream(self._file.path, info)
        self._run.add_stream(self._stream)
        self._run.write_event(Event(0.0, "Simulated without a screen."))
        self._status: Status | None = None

    @property
    def path(self) -> Path:
        """The file."""
        return self._file.path

    def write(self, samples: Samples) -> None:
        """Write the next block (N >= 1); a disk that is full is told here."""
        self._run.write_samples(samples)
        self._stream.flush()

    def end(self, status: Status) -> None:
        """Say how the run ended."""
        self._status = status

    def __enter__(self) -> "HeadlessRecording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file; of an interrupted run, what there is of it."""
        status = self._status or Status("finished", f"Stopped at t = {self._run.last_time:g} s.", self._run.last_time)
        self._run.end(status)
        write_notes(
            self.path,
            ended=True,
            preset=self._run.info.name,
            started=self._run.info.started.isoformat(timespec="seconds"),
            status=str(status),
            duration=self._run.last_time,
            rows=self._run.rows,
            dropped=0,
        )
        self._file.release()
        finish(self.path)
