"""Export a run by way of its recording; make recordings with other samples."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from flexlab.recording.export import export_recording
from flexlab.recording.headless import write_run
from flexlab.recording.reader import Recording, read_recording
from flexlab.sim.samples import Run, Samples


def export_run(run: Run, path: Path, start: float | None = None, end: float | None = None) -> Path:
    """Record a run and export the recording to `path`, from `start` to `end`, s."""
    with TemporaryDirectory() as folder:
        return export_recording(read_recording(write_run(run, Path(folder), "run")), path, start, end)


def having(recording: Recording, samples: Samples) -> Recording:
    """Return a copy of a recording with samples other than those in its file."""
    other = replace(recording)
    vars(other)["samples"] = samples
    return other
