"""One run's recording on its way to one place: a file, or the hub for live viewers."""

from collections.abc import Iterable

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from flexlab.errors import RecordingError
from flexlab.recording.blueprint import run_blueprint
from flexlab.recording.documents import parameters_text, run_properties, signals_text
from flexlab.recording.recorded_plots import REAL_TIME_FACTOR, PlotSignal, plot_signals
from flexlab.recording.rerun_internals.columns import Column, send_columns
from flexlab.recording.rrd_file import RrdFile
from flexlab.recording.run_info import RunInfo
from flexlab.recording.scene_log import fixed_shapes
from flexlab.recording.state_json import state_json
from flexlab.recording.store.run_files import RunFile

APPLICATION = "flexlab"
"""Rerun keeps one layout per application: while runs are watched live, a person's own changes hold for the next one."""

FLUSH_TIMEOUT = 5.0
"""s: rerun's encoder or the hub, if silent for so long, counts as failed."""


class RunStream:
    """A rerun stream that has already said what the run is. Not for use by two threads at once."""

    def __init__(
        self, stream: rr.RecordingStream, info: RunInfo, encoded: rr.BinaryStream | None, file: RrdFile | None
    ):
        """`stream` has its sink already; for a file, `encoded` is that sink and `file` where its bytes go.

        Raises `RecordingError` if what does not change cannot be brought to its place.
        """
        self._stream, self._encoded, self._file = stream, encoded, file
        self._introduce(info)
        self.push()

    @property
    def exact(self) -> bool:
        """Whether blocks of exact samples belong here: in files they do, viewers have no use for them."""
        return self._file is not None

    def _introduce(self, info: RunInfo) -> None:
        stream, scenario = self._stream, info.scenario
        stream.send_recording_name(info.title)
        stream.send_property("run", run_properties(info))
        text = parameters_text(scenario, info.name, info.exaggeration)
        self._log("parameters", rr.TextDocument(text, media_type="text/markdown"))
        self._log("signals", rr.TextDocument(signals_text(scenario), media_type="text/markdown"))
        self.name_curves((*plot_signals(scenario), REAL_TIME_FACTOR))
        for entity, shape in fixed_shapes(scenario):
            self._log(entity, shape)
        if info.start is not None:
            self._log("exact/start", rr.AnyValues(state=state_json(info.start)))
        # `log` goes through a batcher that `send_columns` overtakes.
        try:
            stream.flush(timeout_sec=FLUSH_TIMEOUT)
        except (RuntimeError, ValueError, OSError) as error:
            raise RecordingError(f"The recording cannot be opened: {_one_line(error)}") from None

    def name_curves(self, signals: Iterable[PlotSignal]) -> None:
        """Say what the curves are called that will be sent, and how they look."""
        for signal in signals:
            curves = rr.SeriesLines(
                names=list(signal.names),
                colors=list(signal.colors),
                widths=[1.5] * len(signal.names),
                # The default policy averages: a 44 Hz ring would shrink as one zooms out.
                aggregation_policy=rr.components.AggregationPolicy.MinMax,
            )
            self._log(signal.entity, curves)

    def _log(self, entity: str, archetype: rr.AsComponents) -> None:
        self._stream.log(entity, archetype, static=True)

    def send(self, entity: str, time: np.ndarray, columns: Iterable[Column]) -> None:
        """Send columns for the instants `time` (N,), s. Returns at once; `push` brings them to their place."""
        send_columns(self._stream, entity, time, columns)

    def send_property(self, name: str, values: rr.AsComponents) -> None:
        """Add a property, as seen in listings."""
        self._stream.send_property(name, values)

    def push(self) -> None:
        """Bring what was sent to its place (a live stream does so by itself).

        Raises `RecordingError` if a file takes no more; what is left then waits for the next call.
        """
        self.hold()
        if self._file is not None:
            self._file.write()

    def hold(self) -> None:
        """Keep what was sent for the next `push`: for a disk that is known to be full."""
        if self._file is None or self._encoded is None:
            return
        try:
            piece = self._encoded.read(flush_timeout_sec=FLUSH_TIMEOUT)
        except (RuntimeError, ValueError) as error:
            raise RecordingError(f"Rerun does not encode: {_one_line(error)}") from None
        if piece:
            self._file.hold(piece)

    @property
    def given_up(self) -> int:
        """Pieces of the recording that a full disk has cost."""
        return 0 if self._file is None else self._file.given_up

    @property
    def is_whole(self) -> bool:
        """Whether what was brought to its place is still there."""
        return self._file is None or self._file.is_whole

    def abandon(self) -> None:
        """Let go of it without another byte: its file is no longer what was written."""
        self._stream.disconnect()

    def close(self) -> None:
        """Bring what is left to its place and let go of it. Raises `RecordingError` if a file takes no more."""
        try:
            self.push()
        finally:
            self._stream.disconnect()


def open_live_stream(url: str, info: RunInfo) -> RunStream:
    """A stream into the hub that listens at `url`. Raises `RecordingError`."""
    stream = _new_stream(info)
    try:
        stream.set_sinks(rr.GrpcSink(url), default_blueprint=_layout(info))
    except (RuntimeError, ValueError, OSError) as error:
        raise RecordingError(f"The live stream cannot be opened: {_one_line(error)}") from None
    return RunStream(stream, info, None, None)


def open_file_stream(file: RunFile, info: RunInfo) -> RunStream:
    """A stream into a claimed, empty file. Raises `RecordingError` if it cannot be written."""
    stream = _new_stream(info)
    encoded = stream.binary_stream()
    stream.set_sinks(encoded)
    # Active, not only the default: for the first pieces of a file without an index the viewer makes a layout of its own, and
    # would keep that.
    stream.send_blueprint(_layout(info), make_active=True, make_default=True)
    try:
        return RunStream(stream, info, encoded, RrdFile(file.handle))
    except RecordingError as error:
        stream.disconnect()
        raise RecordingError(f"{file.path.name}: {error}") from None


def _new_stream(info: RunInfo) -> rr.RecordingStream:
    stream = rr.RecordingStream(APPLICATION, recording_id=info.run_id, send_properties=False)
    # Wall-clock axes would only be a second, jumpy time beside the simulation's own.
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


def _layout(info: RunInfo) -> rrb.Blueprint:
    return run_blueprint(info.scenario, info.exaggeration, info.name)


def _one_line(error: BaseException) -> str:
    return str(error).strip().split("\n")[0].rstrip(".") + "."
