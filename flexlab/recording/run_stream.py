"""One run's recording, encoded by rerun on its way to one target: a file, or live viewers."""

from collections.abc import Iterable
from typing import Protocol

import numpy as np
import rerun as rr

from flexlab.errors import RecordingError
from flexlab.recording.blueprint import measurement_blueprint, run_blueprint
from flexlab.recording.documents import parameters_text, run_properties, signals_text
from flexlab.recording.recorded_plots import REAL_TIME_FACTOR, PlotSignal, plot_signals
from flexlab.recording.rerun_internals.columns import Column, send_columns
from flexlab.recording.rrd_file import Refusal, RrdFile, allow
from flexlab.recording.run_encoder import Kept
from flexlab.recording.run_info import RunInfo
from flexlab.recording.run_json import state_json
from flexlab.recording.scene_log import fixed_shapes
from flexlab.recording.store.run_files import RunFile

APPLICATION = "flexlab"
"""Rerun keeps one layout per application: while runs are watched live, a person's own changes hold for the next one."""

FLUSH_TIMEOUT = 5.0
"""s: rerun's encoder, if silent for so long, counts as failed."""


class Target(Protocol):
    """Where the encoded messages of a run go."""

    @property
    def exact(self) -> bool:
        """Whether blocks of exact samples belong here: in files they do, viewers have no use for them."""
        ...

    @property
    def given_up(self) -> int:
        """Pieces that were lost on the way."""
        ...

    @property
    def is_whole(self) -> bool:
        """Whether what was brought here is still there."""
        ...

    def hold(self, piece: bytes) -> None:
        """Take one piece as rerun encodes it, to be written by `write`. Raises `RecordingError` for what is none."""

    def write(self, refusal: Refusal = allow) -> None:
        """Write all that waits. Raises `RecordingError` if that is not possible now."""


class RunStream:
    """A rerun stream that has already said what the run is. Not for use by two threads at once."""

    def __init__(self, stream: rr.RecordingStream, info: RunInfo, encoded: rr.BinaryStream, target: Target):
        """`stream` encodes into `encoded` already, whose bytes go to `target`.

        Raises `RecordingError` if what does not change cannot be brought to its place.
        """
        self._stream, self._encoded, self._target = stream, encoded, target
        self._introduce(info)
        self.push()

    def _introduce(self, info: RunInfo) -> None:
        stream, scenario = self._stream, info.scenario
        stream.send_recording_name(info.title)
        stream.send_property("run", run_properties(info))
        text = parameters_text(info)
        self._log("parameters", rr.TextDocument(text, media_type="text/markdown"))
        self._log("signals", rr.TextDocument(signals_text(scenario), media_type="text/markdown"))
        self.name_curves((*plot_signals(scenario), REAL_TIME_FACTOR))
        if not info.measured:
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

    def send(
        self, entity: str, time: np.ndarray, columns: Iterable[Column], *, exact: bool = False, kept: Kept = "no"
    ) -> None:
        """Send columns for the instants `time` (N,), s. Returns at once; `push` brings them to their place."""
        if self._target.exact or not exact:
            send_columns(self._stream, entity, time, columns)

    def send_property(self, name: str, values: rr.AsComponents) -> None:
        """Add a property, as seen in listings."""
        self._stream.send_property(name, values)

    def push(self, refusal: Refusal = allow) -> None:
        """Bring what was sent to its place, as far as `refusal` lets it.

        Raises `RecordingError` if a file takes no more; what is left then waits for the next call.
        """
        self.hold()
        self._target.write(refusal)

    def hold(self) -> None:
        """Keep what was sent for the next `push`: for a disk that is known to be full."""
        try:
            piece = self._encoded.read(flush_timeout_sec=FLUSH_TIMEOUT)
        except (RuntimeError, ValueError) as error:
            raise RecordingError(f"Rerun does not encode: {_one_line(error)}") from None
        if piece:
            self._target.hold(piece)

    @property
    def given_up(self) -> int:
        """Pieces of the recording that a full disk has cost."""
        return self._target.given_up

    @property
    def is_whole(self) -> bool:
        """Whether what was brought to its place is still there."""
        return self._target.is_whole

    def abandon(self) -> None:
        """Let go of it without another byte: its file is no longer what was written."""
        self._stream.disconnect()

    def close(self, refusal: Refusal = allow) -> None:
        """Bring what is left to its place and let go of it. Raises `RecordingError` if a file takes no more."""
        try:
            self.push(refusal)
        finally:
            self._stream.disconnect()


def open_live_stream(target: Target, info: RunInfo) -> RunStream:
    """A stream to viewers that watch live. Raises `RecordingError`."""
    return _open(target, info, follow=True)


def open_file_stream(file: RunFile, info: RunInfo) -> RunStream:
    """A stream into a claimed, empty file. Raises `RecordingError` if it cannot be written."""
    try:
        return _open(RrdFile(file.handle), info)
    except RecordingError as error:
        raise RecordingError(f"{file.path.name}: {error}") from None


def _open(target: Target, info: RunInfo, follow: bool = False) -> RunStream:
    stream = _new_stream(info)
    encoded = stream.binary_stream()
    stream.set_sinks(encoded)
    # Active, not only the default: for the first pieces of a file without an index the viewer makes a layout of its own, and
    # would keep that.
    layout = measurement_blueprint(info.scenario)
    if not info.measured:
        layout = run_blueprint(info.scenario, info.exaggeration, info.name, follow)
    stream.send_blueprint(layout, make_active=True, make_default=True)
    try:
        return RunStream(stream, info, encoded, target)
    except RecordingError:
        stream.disconnect()
        raise


def _new_stream(info: RunInfo) -> rr.RecordingStream:
    stream = rr.RecordingStream(APPLICATION, recording_id=info.run_id, send_properties=False)
    # Wall-clock axes would only be a second, jumpy time beside the simulation's own.
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


def _one_line(error: BaseException) -> str:
    return str(error).strip().split("\n")[0].rstrip(".") + "."
