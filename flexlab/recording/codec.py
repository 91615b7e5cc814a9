"""Samples as compact bytes and back, bit for bit.

A recording keeps every signal of `Samples` in double precision, besides the curves that it shows: the paper's run has 69 numbers,
552 bytes, per millisecond, of which this form makes 210 bytes in blocks of ten seconds and 276 in blocks of a tenth. The bit
pattern of a smooth signal, read as an integer, is nearly a cubic in time, so its third difference is small; small integers have
empty upper bytes, which pack well. All of it is exact arithmetic on bit patterns: infinities and NaN come back too.

A block is [length of header, 4 bytes little-endian][header, JSON][byte planes], packed as a zstd frame, then its size
before packing, 8 bytes, and the frame's Adler-32, 4 bytes, both little-endian; formats 1 and 2 of recordings packed it as zlib.
The header lists rows and (name, shape of one row) of each signal in the order of their columns.
"""

import json
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from math import prod
from typing import Any, get_args

import numpy as np
import pyarrow as pa
from pydantic import BaseModel

from flexlab.compiled import compiled, entry_point
from flexlab.errors import FlexlabError, RecordingError
from flexlab.own.declaration import signal_name
from flexlab.physics.plant import AXIAL_WORK, NO_HAND
from flexlab.recording.store import formats
from flexlab.scenario import parse_scenario
from flexlab.sim.commands import ChangeScenario, Command, LoadScenario, Pull
from flexlab.sim.samples import TAKEN, Origin, Samples, WorldState, join_blocks
from flexlab.sim.signals import TABLE
from flexlab.sim.snapshot import Event
from flexlab.text import visible

FORMAT = 1
"""Number of this layout of bytes; each block also names the recording's format, on which the meaning of signals depends."""
PACKING = pa.Codec("zstd", compression_level=1)
"""Level 3 takes three times as long, and makes blocks 3 % smaller."""
ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a zstd frame."""
TRAILER = struct.Struct("<QI")
"""Size before packing and checksum, at the end of a block."""
LARGEST = 2**63 - 1
"""Largest integer of 64 bits."""
INSTANTS_AT_ONCE = 512
"""Instants that are encoded at once, at least three: a signal's lines of memory then stay in the processor's first cache."""
UNREADABLE = (zlib.error, struct.error, ArithmeticError, LookupError, OSError, RecursionError, TypeError, ValueError)
"""Errors that may arise from bytes that are not a block."""
LONGEST_REASON = 100
"""Largest length of the reason why a block cannot be read, characters."""
LARGEST_BLOCK = 1_000_000_000
"""Largest unpacked size of a block, bytes: flexlab's have a tenth of it at most, a hostile one could have any size."""


def _tracking_error(signals: dict[str, np.ndarray]) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):  # A run may end with infinite values.
        return signals["pose"] - signals["desired_pose"]


DERIVED: dict[str, Callable[[dict[str, np.ndarray]], np.ndarray]] = {"tracking_error": _tracking_error}
"""Signals that are left out of a block if this computes them again bit for bit, which is checked each time."""


@compiled
def byte_planes(signal, planes, first, folded):
    """Fill rows of `planes` (8, k, N), uint8, from `first` on with the bytes of `signal` (N, a, b), int64, the lowest first.

    Each of its columns is differenced three times, as if zeros stood before it, and its sign moved to the lowest bit, so that
    small numbers of either sign have empty upper bytes. Arithmetic is modulo 2⁶⁴: nothing is lost. `folded`: room for numbers.
    """
    instants, _, width = signal.shape
    # Columns stand side by side in memory: all of them are read before the processor's cache has lost these instants.
    for start in range(0, instants, len(folded)):
        count = min(len(folded), instants - start)
        for c in range(signal.shape[1] * width):
            a, b = c // width, c % width
            x1 = signal[start - 1, a, b] if start else 0
            x2 = signal[start - 2, a, b] if start else 0
            x3 = signal[start - 3, a, b] if start else 0
            column = signal[start : start + count, a, b]
            for i in range(count):
                x = column[i]
                # Order 1 packs ten seconds of the paper's run to 272 kB/s, 2 to 235, 3 to 205, 4 to 179; but each further order
                # costs a noisy signal one bit per number.
                difference = x - 3 * x1 + 3 * x2 - x3
                x1, x2, x3 = x, x1, x2
                folded[i] = (difference << 1) ^ (difference >> 63)
            for k in range(8):
                plane = planes[k, first + c, start : start + count]
                for i in range(count):
                    plane[i] = (folded[i] >> (8 * k)) & 255


@compiled
def from_byte_planes(signal, planes, first, folded):
    """Fill `signal` (N, a, b), int64, from the `planes` that `byte_planes` filled."""
    instants, _, width = signal.shape
    for start in range(0, instants, len(folded)):
        count = min(len(folded), instants - start)
        for c in range(signal.shape[1] * width):
            a, b = c // width, c % width
            folded[:count] = 0
            for k in range(8):
                plane = planes[k, first + c, start : start + count]
                for i in range(count):
                    folded[i] |= np.int64(plane[i]) << (8 * k)
            x1 = signal[start - 1, a, b] if start else 0
            x2 = signal[start - 2, a, b] if start else 0
            x3 = signal[start - 3, a, b] if start else 0
            column = signal[start : start + count, a, b]
            for i in range(count):
                difference = ((folded[i] >> 1) & LARGEST) ^ -(folded[i] & 1)
                x = difference + 3 * x1 - 3 * x2 + x3
                x1, x2, x3 = x, x1, x2
                column[i] = x


def encode_block(samples: Samples) -> bytes:
    """All signals of a block of samples (N >= 1) as bytes."""
    return pack_block(block_bytes(samples))


def block_bytes(samples: Samples) -> np.ndarray:
    """The bytes of a block of samples (N >= 1), uint8, before packing."""
    signals = {name: np.asarray(signal, np.float64) for name, signal in samples.signals().items()}
    derived = [name for name in signals if name in DERIVED and _follows(name, signals)]
    kept = {name: signal for name, signal in signals.items() if name not in derived}
    header = {
        "format": FORMAT,
        "recording_format": formats.FORMAT,
        "rows": len(samples),
        "signals": [[name, list(signal.shape[1:])] for name, signal in kept.items()],
        "derived": derived,
    }
    text = json.dumps(header).encode()
    head = struct.pack("<I", len(text)) + text
    widths = [prod(signal.shape[1:]) for signal in kept.values()]
    raw = np.empty(len(head) + 8 * sum(widths) * len(samples), np.uint8)
    raw[: len(head)] = np.frombuffer(head, np.uint8)
    _each_signal(byte_planes, kept.values(), raw[len(head) :].reshape(8, sum(widths), len(samples)))
    return raw


def pack_block(raw: np.ndarray) -> bytes:
    """A block, packed. Nearly all of it runs without Python's lock."""
    frame = PACKING.compress(raw, asbytes=True)
    return frame + TRAILER.pack(len(raw), zlib.adler32(frame))


def _each_signal(kernel: Callable[..., Any], signals: Iterable[np.ndarray], planes: np.ndarray) -> None:
    """Call `byte_planes` or its inverse for each of the signals, which share the rows of `planes` in this order."""
    folded = np.empty(INSTANTS_AT_ONCE, np.int64)
    # One machine code for any memory order: the kernel would be compiled for each of them.
    call = entry_point(kernel, np.empty((2, 1, 2), np.int64)[:, :, ::2], np.empty((8, 1, 1), np.uint8), 0, folded)
    first = 0
    with np.errstate(over="ignore"):  # Without compiled code, NumPy would warn.
        for signal in signals:
            width = prod(signal.shape[1:])
            axes = signal.shape[1:] if signal.ndim == 3 else (1, width)
            call(signal.view(np.int64).reshape(len(signal), *axes), planes, first, folded)
            first += width


def decode_block(data: bytes) -> tuple[Samples, int]:
    """The samples given to `encode_block`, read-only, and their recording's format, on which their meaning depends.

    A signal that the block lacks is absent; a signal that this version does not know is kept. Raises `RecordingError` for other
    bytes.
    """
    try:
        return _decode(data)
    except UNREADABLE as error:
        reason = visible(error, LONGEST_REASON)
        raise RecordingError(f"A block of exact samples cannot be read ({reason}): the recording is damaged.") from None


def _decode(data: bytes) -> tuple[Samples, int]:
    header, planes = _unpack(data)
    rows, signals, written_in = header["rows"], header["signals"], header.get("recording_format", 1)
    if not isinstance(written_in, int) or written_in < 1:
        raise ValueError(f"recording format {written_in!r:.40}")
    widths = [prod(shape) for _, shape in signals]
    if rows < 1 or min(widths, default=0) < 0:
        raise ValueError("it has no rows, or a signal of negative width")
    patterns = np.frombuffer(planes, np.uint8).reshape(8, sum(widths), rows)
    found = {name: np.empty((rows, *shape)) for name, shape in signals}
    _each_signal(from_byte_planes, found.values(), patterns)
    for name in header["derived"]:
        # A newer version may leave out more than this one can restore: that is then absent.
        if name in DERIVED:
            found[name] = DERIVED[name](found)
    if "time" not in found:
        raise ValueError("it has no times")
    # A signal with the name of an attribute of every run would hide that attribute.
    return Samples(**{n if n in TABLE or n not in TAKEN else signal_name(n): a for n, a in found.items()}), written_in


def _follows(name: str, signals: dict[str, np.ndarray]) -> bool:
    try:
        return np.array_equal(signals[name].view(np.int64), DERIVED[name](signals).view(np.int64))
    except KeyError:  # A signal that it follows from was not recorded.
        return False


def _unpack(data: bytes) -> tuple[dict, memoryview]:
    """(header, byte planes) of a block."""
    raw = _unpack_zstd(data) if data.startswith(ZSTD) else _unpack_zlib(data)
    (length,) = struct.unpack_from("<I", raw)
    header = json.loads(bytes(raw[4 : 4 + length]))
    if header["format"] != FORMAT:
        raise ValueError(f"format {header['format']}, this version of flexlab reads {FORMAT}")
    return header, raw[4 + length :]


def _unpack_zstd(data: bytes) -> memoryview:
    frame = memoryview(data)[: -TRAILER.size]
    size, checksum = TRAILER.unpack(data[-TRAILER.size :])
    if zlib.adler32(frame) != checksum:
        raise ValueError("its checksum is wrong")
    if size > LARGEST_BLOCK:
        raise ValueError(f"it has over {LARGEST_BLOCK} bytes")
    return memoryview(PACKING.decompress(frame, size))


def _unpack_zlib(data: bytes) -> memoryview:
    unpacking = zlib.decompressobj()
    raw = unpacking.decompress(data, LARGEST_BLOCK)
    if not unpacking.eof:
        raise ValueError("it breaks off" if len(raw) < LARGEST_BLOCK else f"it has over {LARGEST_BLOCK} bytes")
    return memoryview(raw)


def larger_blocks(blocks: Iterable[Samples], rows: int) -> Iterator[Samples]:
    """The same samples in fewer blocks, of `rows` or a little more each."""
    waiting: list[Samples] = []
    for block in blocks:
        if len(block):
            waiting.append(block)
        if sum(map(len, waiting)) >= rows:
            yield join_blocks(waiting)
            waiting = []
    if waiting:
        yield join_blocks(waiting)


LAYOUT, PRESENT_LAYOUT = "layout", 3
"""Order of the numbers of y; states of layout 1 do not name it."""
OF_BEAM = 4
"""Numbers of a `Hand` in the first recordings, in which it could hold nothing but the beam."""


def state_json(state: WorldState) -> str:
    """A world's state as JSON."""
    return json.dumps(state_values(state))


def state_values(state: WorldState) -> dict[str, Any]:
    """A world's state in JSON's types."""
    values = {field.name: getattr(state, field.name) for field in fields(WorldState)}
    numbers = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}
    return {LAYOUT: PRESENT_LAYOUT, **numbers}


def state_from_values(values: Mapping[str, Any]) -> WorldState:
    """The state given to `state_values`. Raises ValueError, KeyError or TypeError for anything else."""
    # Fields that only a newer version has are left out; fields that an older one lacks have a default.
    known = {field.name for field in fields(WorldState)} - {"tick"}
    arrays = {name: np.array(value, float) for name, value in values.items() if name in known}
    layout = values.get(LAYOUT, 1)
    if layout == 1:
        y = arrays["y"]  # b̂ stood before the energies, and was every law's memory.
        arrays["y"] = np.concatenate([y[:6], y[9:], y[6:9]])
    if layout <= 2:
        arrays["y"] = np.insert(arrays["y"], AXIAL_WORK, 0.0)  # The axial load did no work.
    if len(arrays["pull"]) == OF_BEAM:
        arrays["pull"] = np.append(arrays["pull"], NO_HAND[OF_BEAM:])
    return WorldState(tick=int(values["tick"]), **arrays)


KINDS: dict[str, type] = {kind.__name__: kind for kind in get_args(Command)}
"""Every command by its class name, which is its `kind` in JSON."""


def event_values(event: Event) -> dict[str, Any]:
    """An event in JSON's types."""
    command = None if event.command is None else command_values(event.command)
    return {"time": event.time, "text": event.text, "level": event.level, "command": command}


def event_from_values(values: Mapping[str, Any]) -> Event:
    """The event given to `event_values`. Raises `RecordingError`, ValueError, KeyError or TypeError for anything else."""
    command = values["command"]
    known = None if command is None else command_from_values(command)
    return Event(float(values["time"]), str(values["text"]), known, str(values["level"]))


def command_values(command: Any) -> dict[str, Any]:
    """{"kind": class name, field: value, …} in JSON's types. Numbers keep every bit."""
    known = fields(command) if is_dataclass(command) else ()
    return {"kind": type(command).__name__, **{field.name: _plain(getattr(command, field.name)) for field in known}}


def command_from_values(given: Mapping[str, Any]) -> Command:
    """The command given to `command_values`. Raises `RecordingError` for anything else."""
    try:
        values = dict(given)
        kind = KINDS[values.pop("kind")]
        if kind is Pull and "beam_position" in values:  # As a hand's position was called in the first recordings.
            values["position"] = values.pop("beam_position")
        if kind is ChangeScenario:
            values["changes"] = dict(values["changes"])
            values.setdefault("keeps_target", False)
        if kind is LoadScenario:
            values["scenario"] = parse_scenario(values["scenario"])
            if (origin := values.get("origin")) is not None:
                state = state_from_values(origin["state"])
                values["origin"] = Origin(str(origin["run"]), float(origin["time"]), state)
        return kind(**{name: _frozen(value) for name, value in values.items()})
    except (ValueError, KeyError, TypeError, AttributeError, FlexlabError) as error:
        raise RecordingError(
            f"The recording has a command that this version of flexlab cannot read ({error}): {json.dumps(given)[:80]}"
        ) from None


def _plain(value: Any) -> Any:
    """The value with JSON's types only."""
    if isinstance(value, Origin):
        return {"run": value.run, "time": value.time, "state": state_values(value.state)}
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value


def _frozen(value: Any) -> Any:
    """The value with its lists turned back into tuples."""
    if isinstance(value, dict):
        return {name: _frozen(item) for name, item in value.items()}
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
