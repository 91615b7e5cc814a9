"""The parts of rerun that flexlab uses although rerun does not promise them; a failure says what a new version changed."""

import ast
import re
from pathlib import Path

import numpy as np
import psutil
import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.catalog import DatasetEntry
from rerun_bindings import CatalogClientInternal

from flexlab.recording.rerun_internals import chunks, rrd_file, tool
from flexlab.recording.rerun_internals.chunks import TIMELINE, scalars, send_columns, single, time_column

INTERNALS = Path("flexlab/recording/rerun_internals")
UNPROMISED = ("rerun.chunk", "rerun.catalog", "rerun.experimental", "rerun_bindings", "rerun_cli")
"""Modules of rerun that its documentation does not describe or calls experimental."""

TIMES = np.array([0.001, 0.002, 0.003])


@pytest.fixture
def pieces() -> list[bytes]:
    """Two pieces of one stream as rerun encodes them."""
    stream = rr.RecordingStream("contract", send_properties=False)
    encoded = stream.binary_stream()
    stream.set_sinks(encoded)
    chunks.send_layout(stream, rrb.Blueprint(rrb.TimeSeriesView(origin="/curve")))
    stream.send_recording_name("contract")
    send_columns(stream, "curve", time_column(TIMES), [scalars(np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]))])
    first = encoded.read(flush_timeout_sec=5.0)
    send_columns(stream, "exact", time_column(TIMES[-1:]), [single("flexlab.Block", "data", None, b"\x00\xff")])
    second = encoded.read(flush_timeout_sec=5.0)
    stream.disconnect()
    assert first, "BinaryStream.read gives no bytes of what was sent"
    assert second, "BinaryStream.read gives no bytes of what was sent"
    return [first, second]


@pytest.fixture
def joined(pieces: list[bytes], tmp_path: Path) -> Path:
    """The messages of both pieces after one head: a file without an end, as the recorder writes it."""
    path = tmp_path / "joined.rrd"
    path.write_bytes(b"".join(rrd_file.messages(piece, with_head=not n) for n, piece in enumerate(pieces)))
    return path


def test_only_rerun_internals_imports_modules_that_rerun_does_not_promise(root: Path):
    for file in (root / "flexlab").rglob("*.py"):
        if file.is_relative_to(root / INTERNALS):
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert not name.startswith(UNPROMISED), f"{file} uses {name}: that belongs into {INTERNALS}"


def test_a_piece_is_a_head_messages_and_an_end(pieces: list[bytes]):
    for piece in pieces:
        assert piece.startswith(rrd_file.MAGIC), f"a piece begins with {piece[:4]!r}, no longer with RRF2"
        place, kinds = rrd_file.HEAD, []
        while place < len(piece) and rrd_file.END not in kinds:
            kind, length = rrd_file.MESSAGE.unpack_from(piece, place)
            kinds.append(kind)
            place += rrd_file.MESSAGE.size + length
            assert place <= len(piece), "a message is longer than its piece: kind and length stand otherwise"
        assert len(kinds) > 1, "a piece has no message before its end"
        assert kinds[-1] == rrd_file.END, "a piece has no end message"


def test_joined_pieces_are_one_file(joined: Path):
    rows = list(chunks.stream_rows(joined, ["/curve", "/exact"]))
    assert {entity for entity, _ in rows} == {"/curve", "/exact"}, "joined pieces are not read as one recording"
    assert not rrd_file.has_footer(joined)


def test_columns_arrive_as_they_were_sent(joined: Path):
    rows = [row for entity, row in chunks.stream_rows(joined, ["/curve"]) if entity == "/curve"]
    assert [time for time, _ in rows] == [1_000_000, 2_000_000, 3_000_000], "times are no longer whole nanoseconds"
    assert {name for _, row in rows for name in row} == {"scalars"}, "a batch names its components otherwise"
    (exact,) = [row for entity, (_, row) in chunks.stream_rows(joined, ["/exact"]) if entity == "/exact"]
    assert bytes(exact["data"]) == b"\x00\xff", "bytes do not come back as they were sent"


def test_the_reader_filters_and_counts(joined: Path):
    with chunks.quiet_reader(joined) as reader:
        assert len(reader.recordings()) == 1, "RrdReader.recordings does not list the recording"
        entities = {chunk.entity_path for chunk in reader.stream().filter(content=["/exact"])}
    assert entities == {"/exact"}, "a filtered stream has other entities too"
    batch = next(batch for _, batch in chunks._batches(joined, ["/curve"]))
    assert TIMELINE in batch.schema.names, "a batch has no column of the timeline's name"


def test_the_tool_completes_unfinished_and_torn_files(joined: Path, tmp_path: Path):
    whole = tmp_path / "whole.rrd"
    assert tool.Mending().rewrite(joined, whole), "`rerun rrd optimize` does not mend a file without an end"
    assert rrd_file.has_footer(whole), "a finished file does not end with RRF2FOOT"
    assert list(chunks.stream_rows(whole, ["/exact"])), "a finished file cannot be read"
    torn = tmp_path / "torn.rrd"
    torn.write_bytes(joined.read_bytes()[:-7])
    assert tool.Mending().rewrite(torn, whole), "`--continue-on-error` does not read a torn file up to its tear"


def test_the_tool_reports_the_error_of_the_system(joined: Path, tmp_path: Path):
    # Rerun's program tells it only in its warnings; without them a full disk would look like success.
    with pytest.raises(OSError, match="No such file"):
        tool.Mending().rewrite(joined, tmp_path / "no" / "folder.rrd")


def test_the_server_gives_an_address_and_uses_the_layout_in_the_file(joined: Path, tmp_path: Path):
    whole = tmp_path / "whole.rrd"
    tool.Mending().rewrite(joined, whole)
    with chunks.quiet_reader(whole) as reader:
        (layout,) = reader.blueprints()
    with tool.serving(whole) as address:
        (core,) = CatalogClientInternal(address.partition("/dataset")[0]).datasets(False)
        given = DatasetEntry(core).default_blueprint()
    assert given == layout.recording_id, "the server does not find a layout inside a recording"
    assert re.match(r"rerun\+http://127\.\d+\.\d+\.\d+:\d+/", address), (
        "a segment's address is no longer one that the viewer opens"
    )


def test_the_viewer_is_three_files():
    folder = tool.viewer_folder()
    for name in tool.VIEWER_FILES:
        assert (folder / name).stat().st_size > 0, f"rerun's program does not serve {name} of its viewer"
    page = (folder / "index.html").read_bytes()
    assert b"re_viewer" in page, "the viewer's page loads another script"


def test_the_viewers_page_has_the_option_that_reports_its_time_cursor() -> None:
    page = (tool.viewer_folder() / "index.html").read_bytes()
    assert tool.TELLING in page
    assert b"on_viewer_event" in (tool.viewer_folder() / "re_viewer_bg.wasm").read_bytes()


def test_streams_that_ended_leave_no_thread_behind() -> None:
    """Rerun leaves two threads for each stream and two for its layout, unless it is asked to release them."""
    threads = []
    for number in range(8):
        stream = chunks.new_stream("contract", str(number))
        encoded = stream.binary_stream()
        stream.set_sinks(encoded)
        chunks.send_layout(stream, rrb.Blueprint(rrb.TimeSeriesView(origin="/curve")))
        send_columns(stream, "curve", time_column(TIMES), [scalars(np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]))])
        assert encoded.read(flush_timeout_sec=5.0)
        stream.disconnect()
        del stream, encoded
        threads.append(psutil.Process().num_threads())
    assert max(threads[4:]) <= threads[3]
