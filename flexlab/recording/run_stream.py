"""One run's recording on its way to one place: a file, or the hub for live viewers."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, cast

import numpy as np
import rerun as rr

from flexlab.errors import RecordingError
from flexlab.recording.blueprint import run_blueprint
from flexlab.recording.chunks import Column, time_column
from flexlab.recording.documents import parameters_text, run_properties, signals_text, state_json
from flexlab.recording.drawing import fixed_shapes
from flexlab.recording.run_info import RunInfo
from flexlab.recording.signals import REAL_TIME_FACTOR, plot_signals

APPLICATION = "flexlab"
"""Rerun keeps one layout per application: a person's own changes to it hold for the next run too."""

FLUSH_TIMEOUT = 5.0
"""s: a file system that does not answer for so long counts as failed."""


class RunStream:
    """A rerun stream that has already said what the run is. Not for use by two threads at once."""

    def __init__(self, sink: Any, info: RunInfo, exact: bool):
        """Open `sink` and send what does not change. `exact`: whether blocks of exact samples belong here.

        Raises `RecordingError` if the sink cannot be opened.
        """
        self.exact = exact
        self._stream = rr.RecordingStream(APPLICATION, recording_id=info.run_id, send_properties=False)
        # Wall-clock axes would only be a second, jumpy time beside the simulation's own.
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        try:
            blueprint = run_blueprint(info.scenario, info.exaggeration, info.name)
            self._stream.set_sinks(sink, default_blueprint=blueprint)
        except (RuntimeError, OSError) as error:
            raise RecordingError(f"The recording cannot be opened: {_one_line(error)}") from None
        try:
            self._introduce(info)
        except RecordingError:
            self.close()
            raise

    def _introduce(self, info: RunInfo) -> None:
        stream, scenario = self._stream, info.scenario
        stream.send_recording_name(info.title)
        started = info.started.isoformat(timespec="seconds")
        stream.send_property("run", run_properties(scenario, info.name, started, info.sample_period, info.part))
        text = parameters_text(scenario, info.name, info.exaggeration)
        self._log("parameters", rr.TextDocument(text, media_type="text/markdown"))
        self._log("signals", rr.TextDocument(signals_text(len(scenario.arms)), media_type="text/markdown"))
        for signal in (*plot_signals(len(scenario.arms)), REAL_TIME_FACTOR):
            curves = rr.SeriesLines(
                names=list(signal.names),
                colors=list(signal.colors),
                widths=[1.5] * len(signal.names),
                # The default policy averages: a 44 Hz ring would shrink as one zooms out.
                aggregation_policy=rr.components.AggregationPolicy.MinMax,
            )
            self._log(signal.entity, curves)
        for entity, shape in fixed_shapes(scenario):
            self._log(entity, shape)
        if info.start is not None:
            self._log("exact/start", rr.AnyValues(state=state_json(info.start)))
        # `log` goes through a batcher that `send_columns` overtakes.
        self.flush()

    def _log(self, entity: str, archetype: rr.AsComponents) -> None:
        self._stream.log(entity, archetype, static=True)

    def send(self, entity: str, time: np.ndarray, columns: Iterable[Column]) -> None:
        """Send columns for the instants `time` (N,), s. Returns at once; what fails is told by `flush`."""
        # A `Column` is all that rerun asks of one, though not one by name.
        self._stream.send_columns(entity, [time_column(time)], cast(Iterable[rr.ComponentColumn], columns))

    def send_property(self, name: str, values: rr.AsComponents) -> None:
        """Add a property, as seen in listings."""
        self._stream.send_property(name, values)

    def flush(self) -> None:
        """Wait until all is written. Raises `RecordingError` if something was not (a full disk, say)."""
        try:
            self._stream.flush(timeout_sec=FLUSH_TIMEOUT)
        except (RuntimeError, ValueError, OSError) as error:
            raise RecordingError(f"The recording cannot be written: {_one_line(error)}") from None

    def close(self) -> None:
        """Write what is left and let go of the sink."""
        self._stream.disconnect()


def open_file_stream(path: Path, info: RunInfo) -> RunStream:
    """A stream into the file `path`, overwriting it. Raises `RecordingError` if it cannot be written."""
    # A footer's index would grow in memory by 100 MB an hour; `finish` adds it afterwards.
    try:
        return RunStream(rr.FileSink(str(path), write_footer=False), info, exact=True)
    except RecordingError as error:
        raise RecordingError(f"{path.name}: {error}") from None


def _one_line(error: BaseException) -> str:
    return str(error).strip().split("\n")[0].rstrip(".") + "."
