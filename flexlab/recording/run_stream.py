"""One run's recording, encoded by rerun on its way to one target: a file, or live viewers.

Rerun can write files itself, but when a disk is full its writer dies silently, all later data is lost, and letting go of it
may wait forever, even when the program ends. So rerun only encodes, into memory, and the bytes are written here: an error
is known at once, a half-written message is cut off again, and what could not be written waits until there is room.
"""

import os
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import IO, Protocol

import numpy as np
import rerun as rr

from flexlab.errors import RecordingError
from flexlab.recording.blueprint import measurement_blueprint, run_blueprint
from flexlab.recording.codec import state_json
from flexlab.recording.rerun_internals.chunks import Column, send_columns
from flexlab.recording.rerun_internals.message_layout import messages
from flexlab.recording.rerun_internals.streams import new_stream, send_layout
from flexlab.recording.run_encoder import Kept
from flexlab.recording.run_info import RunInfo, parameters_text, run_properties, signals_text
from flexlab.recording.scene_log import fixed_shapes
from flexlab.recording.store.run_files import RunFile
from flexlab.views import REAL_TIME_FACTOR, View, views

READING_SHARE = 0.05
"""Of the time that may go into reading a file again whose date somebody changed, or a network's clock."""
READ_BYTES = 1 << 20
"""Read at once."""
HELD_BYTES = 48_000_000
"""What waits for a full disk at most: one and a half minutes of the paper's run. Then the oldest is given up."""

Refusal = Callable[[int], str]
"""Says why so many more bytes may not be written; nothing if they may."""


def allow(size: int) -> str:
    """Any number of bytes."""
    return ""


class RrdFile:
    """A file that grows by whole messages. Not for use by two threads at once."""

    exact = True
    """Exact samples belong here."""

    def __init__(self, handle: IO[bytes], held_bytes: int = HELD_BYTES):
        """`handle`: a file open for writing, unbuffered, empty."""
        self._handle = handle
        self._held_bytes = held_bytes
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._size = self._checksum = 0
        self._date = os.fstat(handle.fileno()).st_mtime_ns
        self._next_reading = 0.0
        self._begun = False
        self.given_up = 0
        """Pieces that were given up because a disk stayed full for too long."""

    def hold(self, piece: bytes) -> None:
        """Take one piece as rerun encodes it, to be written by `write`. Raises `RecordingError` for what is none."""
        data = messages(piece, with_head=not self._begun)
        self._begun = True
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        # The first piece has the head and says what the run is: without it the rest is worth nothing.
        oldest = 0 if self._size else 1
        while self._waiting_bytes > self._held_bytes and len(self._waiting) > oldest + 1:
            self._waiting_bytes -= len(self._waiting[oldest])
            del self._waiting[oldest]
            self.given_up += 1

    @property
    def is_whole(self) -> bool:
        """Whether the file still has exactly the bytes that were written: nobody cut it off or wrote over it."""
        found = os.fstat(self._handle.fileno())
        if found.st_size != self._size:
            return False
        if found.st_mtime_ns == self._date or time.monotonic() < self._next_reading:
            return True
        # Somebody wrote into it, or only touched it: its bytes tell.
        begun = time.monotonic()
        is_same = self._read_checksum() == self._checksum
        now = time.monotonic()
        self._next_reading = now + (now - begun) / READING_SHARE
        self._date = found.st_mtime_ns
        return is_same

    def _read_checksum(self) -> int:
        checksum = 0
        with open(self._handle.name, "rb", buffering=0) as file:
            while piece := file.read(READ_BYTES):
                checksum = zlib.crc32(piece, checksum)
        return checksum

    def write(self, refusal: Refusal = allow) -> None:
        """Write all that waits. Raises `RecordingError` if the disk or `refusal` does not take it; what is left waits on."""
        try:
            while self._waiting:
                if refused := refusal(len(self._waiting[0])):
                    raise RecordingError(refused)
                self._write(self._waiting[0])
                self._waiting_bytes -= len(self._waiting.popleft())
        except OSError as error:
            raise RecordingError(f"{self._handle.name} cannot be written ({error.strerror}).") from None

    def _write(self, data: bytes) -> None:
        """All or nothing: what was half written is cut off again."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._handle.fileno(), rest) :]
        except OSError:
            os.ftruncate(self._handle.fileno(), self._size)
            os.lseek(self._handle.fileno(), self._size, os.SEEK_SET)
            self._note_date()
            raise
        self._size += len(data)
        self._checksum = zlib.crc32(data, self._checksum)
        self._note_date()

    def _note_date(self) -> None:
        self._date = os.fstat(self._handle.fileno()).st_mtime_ns


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
        self.name_curves((*views(scenario), REAL_TIME_FACTOR))
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

    def name_curves(self, signals: Iterable[View]) -> None:
        """Say what the curves are called that will be sent, and how they look."""
        for signal in signals:
            self._log(signal.entity, curves(signal.names, signal.colors))

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
    stream = new_stream(APPLICATION, info.run_id)
    encoded = stream.binary_stream()
    stream.set_sinks(encoded)
    # Active, not only the default: for the first pieces of a file without an index the viewer makes a layout of its own, and
    # would keep that.
    layout = measurement_blueprint(info.scenario)
    if not info.measured:
        layout = run_blueprint(info.scenario, info.exaggeration, info.name, follow)
    send_layout(stream, layout)
    try:
        return RunStream(stream, info, encoded, target)
    except RecordingError:
        stream.disconnect()
        raise


def curves(names: Sequence[str], colors: Sequence[tuple[int, int, int]]) -> rr.SeriesLines:
    """How the curves of one entity look."""
    # The default policy averages: a 44 Hz ring would shrink as one zooms out.
    policy = rr.components.AggregationPolicy.MinMax
    return rr.SeriesLines(names=list(names), colors=list(colors), widths=[1.5] * len(names), aggregation_policy=policy)


def _one_line(error: BaseException) -> str:
    return str(error).strip().split("\n")[0].rstrip(".") + "."
