"""Rerun files that hold what flexlab never writes: each is read, or refused in one sentence and not imported."""

import contextlib
import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from rerun import any_batch_value

from flexlab.analysis.replay import replay
from flexlab.errors import FlexlabError, RecordingError
from flexlab.recording import codec, run_encoder, run_info
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.importing import import_into
from flexlab.recording.reader import read_recording, read_scenario
from flexlab.recording.rerun_internals.chunks import Column, new_stream, scalars, send_columns, stream_rows, time_column
from flexlab.recording.run_encoder import RunEncoder
from flexlab.recording.run_info import RunInfo, checked
from flexlab.sim.samples import Run, WorldState
from flexlab.sim.world import World

GONE = "left out"
"""Stands for a value that is left out."""
DEEP = "[" * 100_000
INFINITE = float("inf")


def changed(values: dict[str, Any], name: str, value: Any) -> dict[str, Any]:
    return {key: old for key, old in (values | {name: value}).items() if old is not GONE}


@pytest.fixture(autouse=True)
def any_type(monkeypatch: pytest.MonkeyPatch) -> None:
    """Allow values of another type: rerun remembers the first type of a value for the life of the process."""
    monkeypatch.setattr(any_batch_value, "ANY_VALUE_TYPE_REGISTRY", any_batch_value.TypeRegistry())


@pytest.fixture(scope="module")
def start(run: Run) -> WorldState:
    return World(run.scenario).state()


@pytest.fixture
def written(run: Run, start: WorldState, tmp_path: Path) -> Callable[[], Path]:
    """A function that writes a few samples and the end of a run, with what the test changed in the writer."""

    def write() -> Path:
        info = RunInfo("paper", run.scenario, 0.001, start)
        with HeadlessRecording(tmp_path / "odd.rrd", info) as recording:
            recording.write(run.slice(0, 20))
            recording.write(run.slice(20, 40))
            recording.end(run.status)
        return tmp_path / "odd.rrd"

    return write


def check(path: Path, refused: bool) -> None:
    """Check that every reader returns something, or that some refuse in one sentence and a refused import leaves nothing."""
    logs = path.parent / "logs"
    sentences: list[str] = []
    for read in (read_scenario, lambda odd: read_recording(odd).samples, lambda odd: import_into(odd, logs)):
        try:
            read(path)
        except RecordingError as error:
            sentences.append(str(error))
    assert all("\n" not in said and len(said) < 600 for said in sentences), sentences
    assert bool(sentences) == refused, sentences
    assert any(logs.glob("*")) != refused


HARMLESS = [("flexlab_version", GONE), ("oldest_reader", "x"), ("started", "0001-01-01T00:00:00"), ("preset", 5)]
"""Odd properties that need not be understood to read the run."""


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *HARMLESS,
        *((name, GONE) for name in ("format", "preset", "started", "part", "sample_period_s")),
        *(("format", value) for value in ("x", b"\xff")),
        *(("scenario", value) for value in (DEEP, "1", "null", "{", 5, '{"payload": 1}')),
        *(("started", value) for value in ("x", 5)),
        *(("part", value) for value in ("x", INFINITE)),
        *(("sample_period_s", value) for value in ("x", 0.0, -1.0, INFINITE)),
    ],
)
def test_odd_properties(monkeypatch: pytest.MonkeyPatch, written: Callable[[], Path], name: str, value: Any) -> None:
    monkeypatch.setattr(run_info, "checked", lambda values: checked(changed(values, name, value)))
    check(written(), refused=(name, value) not in HARMLESS)


def of(signal: str, shape: Any) -> Callable[[dict[str, Any]], Any]:
    def change(head: dict[str, Any]) -> None:
        for pair in head["signals"]:
            if pair[0] == signal:
                pair[1] = shape

    return change


def called(signal: str, name: Any) -> Callable[[dict[str, Any]], Any]:
    def change(head: dict[str, Any]) -> None:
        for pair in head["signals"]:
            if pair[0] == signal:
                pair[0] = name

    return change


def head(name: str, value: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda given: changed(given, name, value)


HEADS: dict[str, Callable[[dict[str, Any]], Any]] = {
    **{f"rows {value}": head("rows", value) for value in (0, -1, 7, 1e300, "x", None, GONE, 10**12)},
    **{f"format {value}": head("recording_format", value) for value in (0, -5, 1.5, "x", None)},
    **{f"derived {value}": head("derived", value) for value in (None, 5, [[1]], GONE)},
    **{f"signals {value}": head("signals", value) for value in (None, 5, [], "abc", [[1, [2]]], GONE)},
    **{f"shape {value}": of("pose", value) for value in ([-1], ["a"], [2], [], [3, 1], None, "ab", [1.5], [10**9])},
    **{f"angles {value}": of("joint_angle", value) for value in ([3, 2], [6], [1, 6], [1, 2, 3])},
    **{f"name {value}": called("pose", value) for value in (3, [1], None, "time")},
    "no head": lambda given: [],
    "no times": called("time", "zeit"),
}


def by_zstd(raw: bytes) -> bytes:
    """A block with the right checksum, whatever it holds."""
    frame = codec.PACKING.compress(raw, asbytes=True)
    return frame + codec.TRAILER.pack(len(raw), zlib.adler32(frame))


PACKINGS = {"zlib": zlib.compress, "zstd": by_zstd}


def with_heads(monkeypatch: pytest.MonkeyPatch, change: Callable[[dict[str, Any]], Any], packing: str = "zstd") -> None:
    pack = run_encoder.pack_block

    def odd(block: np.ndarray) -> bytes:
        given, planes = codec._unpack(pack(block))
        found = change(given)
        text = json.dumps(given if found is None else found).encode()
        return PACKINGS[packing](struct.pack("<I", len(text)) + text + planes)

    monkeypatch.setattr(run_encoder, "pack_block", odd)


# What is read is the same once it is unpacked.
@pytest.mark.parametrize(
    ("kind", "packing"),
    [*((kind, "zstd") for kind in HEADS), ("rows 7", "zlib"), ("format 0", "zlib"), ("no head", "zlib")],
)
def test_odd_blocks(monkeypatch: pytest.MonkeyPatch, written: Callable[[], Path], kind: str, packing: str) -> None:
    with_heads(monkeypatch, HEADS[kind], packing)
    check(written(), refused=True)


@pytest.mark.parametrize("name", ["slice", "signals", "take", "scenario", "status"])
def test_a_signal_named_like_an_attribute_of_every_run_does_not_hide_it(
    monkeypatch: pytest.MonkeyPatch, written: Callable[[], Path], name: str
) -> None:
    with_heads(monkeypatch, called("beam_rates", name))
    path = written()
    check(path, refused=False)
    assert len(read_recording(path).run.slice(0, 5).signals()["time"]) == 5


BLOCKS = {
    "nothing": b"",
    "no zlib": b"x" * 100,
    "no zstd": codec.ZSTD + b"x" * 100,
    "only a beginning": codec.ZSTD,
    "a small size": by_zstd(bytes(1000)).replace(b"\xe8\x03", b"\xe7\x03"),
    "a large size": by_zstd(bytes(1000)).replace(b"\xe8\x03\0\0\0\0", b"\xe8\x03\0\0\0\xff"),
    **{f"a bomb of {name}": pack(bytes(20_000_000)) for name, pack in PACKINGS.items()},
    **{f"a deep head in {name}": pack(struct.pack("<I", len(DEEP)) + DEEP.encode()) for name, pack in PACKINGS.items()},
    **{f"a long head in {name}": pack(b"\xff\xff\xff\xff{}") for name, pack in PACKINGS.items()},
    **{f"{name}, cut": pack(bytes(range(256)))[:50] for name, pack in PACKINGS.items()},
}


@pytest.mark.parametrize("kind", BLOCKS)
def test_bytes_that_are_no_block(monkeypatch: pytest.MonkeyPatch, written: Callable[[], Path], kind: str) -> None:
    monkeypatch.setattr(codec, "LARGEST_BLOCK", 10_000_000)
    monkeypatch.setattr(run_encoder, "pack_block", lambda block: BLOCKS[kind])
    check(written(), refused=True)


RECORDS: dict[str, Any] = {
    **{f"time {value}": ("time", value) for value in ("x", None, [], INFINITE)},
    **{f"number {value}": ("number", value) for value in ("x", None, GONE)},
    **{f"level {value}": ("level", value) for value in (3, [], GONE)},
    **{f"command {value}": ("command", value) for value in ("x", [], {}, {"kind": []}, {"kind": "Pull"}, GONE)},
    "no change": ("command", {"kind": "ChangeScenario", "changes": 5}),
    "odd changes": ("command", {"kind": "ChangeScenario", "changes": [["x", 1]]}),
    "odd source": ("command", {"kind": "ChangeScenario", "changes": {"controller.source": 5}}),
    "odd origin": ("command", {"kind": "LoadScenario", "scenario": {}, "name": 5, "origin": {"run": 1, "time": 1, "state": []}}),
}  # fmt: skip


@pytest.mark.parametrize("kind", [*RECORDS, "[]", "null", "5", "", DEEP])
def test_odd_events(monkeypatch: pytest.MonkeyPatch, written: Callable[[], Path], kind: str) -> None:
    record: Any = RunEncoder._record

    def odd(self: RunEncoder, number: int, event: Any) -> str:
        if kind not in RECORDS:
            return kind
        return json.dumps(changed(json.loads(record(self, number, event)), *RECORDS[kind]))

    monkeypatch.setattr(RunEncoder, "_record", odd)
    path = written()
    is_read = kind in ("number x", "number None", "odd changes", "odd source")
    check(path, refused=not is_read)
    if is_read:
        with contextlib.suppress(FlexlabError):  # Anything else would be a traceback of `flexlab replay`.
            replay(read_recording(path))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("y", value) for value in ("x", None, [[1]], {"a": 1}, [1, "a"], GONE)),
        *(("tick", value) for value in ("x", None, [], INFINITE, GONE)),
        *(("layout", value) for value in ("x", None, [])),
    ],
)
def test_odd_start_states(monkeypatch: pytest.MonkeyPatch, written: Callable[[], Path], name: str, value: Any) -> None:
    state_json = run_encoder.state_json
    monkeypatch.setattr(
        run_encoder, "state_json", lambda state: json.dumps(changed(json.loads(state_json(state)), name, value))
    )
    check(written(), refused=(name, value) not in [("y", None), ("y", [[1]])])


@pytest.mark.parametrize("text", ["[]", "null", "5", DEEP])
def test_texts_that_are_no_start_state(monkeypatch: pytest.MonkeyPatch, written: Callable[[], Path], text: str) -> None:
    monkeypatch.setattr(run_encoder, "state_json", lambda state: text)
    check(written(), refused=True)


@pytest.mark.parametrize(
    ("name", "value"),
    [("status", 5), ("text", 5), ("text", b"\xff"), *(("time_s", value) for value in ("x", [], INFINITE))],
)
def test_odd_end_records(monkeypatch: pytest.MonkeyPatch, written: Callable[[], Path], name: str, value: Any) -> None:
    def odd(values: dict[str, Any]) -> dict[str, Any]:
        return checked(changed(values, name, value) if "rows" in values else values)

    monkeypatch.setattr(run_encoder, "checked", odd)
    check(written(), refused=name == "time_s")


def test_a_column_packed_as_a_dictionary_is_not_unpacked(tmp_path: Path) -> None:
    """Its rows share one text: a file of 30 kB filled the memory."""
    shared = pa.DictionaryArray.from_arrays(pa.array([0, 0, 0], pa.int32()), pa.array(["x" * 100_000]))
    ends = pa.array([0, 1, 2, 3], pa.int32())
    column = Column("Events", "text", None, pa.ListArray.from_arrays(ends, shared))
    stream = new_stream("flexlab", "odd")
    stream.save(tmp_path / "odd.rrd")
    send_columns(stream, "/exact/events", time_column(np.array([0.0, 0.1, 0.2])), [column, scalars(np.zeros((3, 1)))])
    stream.disconnect()
    rows = [row for _, row in stream_rows(tmp_path / "odd.rrd", ["/exact/events"])]
    assert rows == [(nanoseconds, {"scalars": 0.0}) for nanoseconds in (0, 100_000_000, 200_000_000)]
