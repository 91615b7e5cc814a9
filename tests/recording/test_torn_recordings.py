"""Files that are cut off, empty or no recordings: what can be read is read, else one sentence says why it cannot."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import Any

import numpy as np
import pytest
from recording_helpers import assert_same_bits
from rerun.chunk import RrdReader

from flexlab.analysis.run_summary import note_missing_metrics
from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.export import export_recording
from flexlab.recording.file_sink import RunWriter
from flexlab.recording.headless import HeadlessRecording, write_run
from flexlab.recording.importing import import_into
from flexlab.recording.reader import read_recording
from flexlab.recording.repair import finish
from flexlab.recording.rerun_internals import tool
from flexlab.recording.run_encoder import RunEncoder
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store import run_files
from flexlab.recording.store.notes import notes_path, read_notes
from flexlab.recording.store.run_files import claim_run_file, has_footer, is_in_use, run_state
from flexlab.recording.store.run_index import read_row, state_word
from flexlab.sim.samples import Run, Status, join_blocks
from flexlab.sim.snapshot import Event

BLOCK = 100


@pytest.fixture
def unfinished(run: Run, tmp_path: Path) -> Path:
    """A recording as a killed lab leaves it: ten blocks, no end, no footer."""
    info = RunInfo("paper", load_preset("paper"))
    file = claim_run_file(tmp_path, "paper", info.started)
    recording = RunWriter(file, info)
    writer = RunEncoder(info, [recording.stream])
    for first in range(0, 1000, BLOCK):
        writer.write_samples(run.slice(first, first + BLOCK))
    recording.push()
    lost = tmp_path / "lost.rrd"
    shutil.copy(file.path, lost)
    recording.close()
    file.release()
    file.path.unlink()
    return lost


def test_a_recording_without_an_end_is_read_and_mended(unfinished: Path, run: Run) -> None:
    assert run_state(unfinished) == "unfinished"
    date = unfinished.stat().st_mtime_ns
    before = read_recording(unfinished)
    assert_same_bits(before.samples, run.slice(0, 1000))
    assert before.status == "running"
    finish(unfinished)
    assert has_footer(unfinished)
    assert run_state(unfinished) == "recovered"
    assert unfinished.stat().st_mtime_ns == date
    assert_same_bits(read_recording(unfinished).samples, run.slice(0, 1000))
    assert note_missing_metrics(unfinished.parent) == 1


def test_a_mended_recording_without_its_notes_still_breaks_off(unfinished: Path, tmp_path: Path) -> None:
    """Its copies were listed as complete, with the status "running"."""
    finish(unfinished)
    notes_path(unfinished).unlink()
    recording = read_recording(unfinished)
    assert recording.state == "recovered"
    export_recording(recording, tmp_path / "exported.npz")
    for source in (unfinished, tmp_path / "exported.npz"):
        row = read_row(import_into(source, tmp_path / "logs"))
        assert (row.state, row.status) == ("recovered", "")
    assert note_missing_metrics(unfinished.parent) == 1
    assert run_state(unfinished) == "recovered"


def test_how_a_run_ended_is_known_without_its_notes(run: Run, tmp_path: Path) -> None:
    """Metrics of a run that had diverged passed for results once they were computed anew."""
    with HeadlessRecording(tmp_path, RunInfo("paper", run.scenario)) as recording:
        recording.write(run.slice(0, 300))
        recording.end(Status("diverged", "The run diverged.", 0.3))
    notes_path(recording.path).unlink()
    assert note_missing_metrics(tmp_path) == 1
    assert read_row(recording.path).is_stopped


def test_a_recording_is_mended_where_the_home_folder_cannot_be_written(
    unfinished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rerun's tool reports that it cannot keep its settings there, which was taken for an error of the disk."""
    (tmp_path / "home").write_text("")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    finish(unfinished)
    assert run_state(unfinished) == "recovered"


def test_a_torn_recording_says_that_its_mended_copy_needs_room(
    unfinished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.truncate(unfinished, unfinished.stat().st_size - 5)
    assert len(read_recording(unfinished).samples) == 1000
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "full"))
    with pytest.raises(RecordingError, match=r"is torn, and a mended copy .* \(No such file or directory\): make room"):
        read_recording(unfinished)


def test_a_reader_of_a_file_is_not_taken_for_its_writer_and_does_not_prevent_mending(
    unfinished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl", reason="Windows has no such locks")
    with unfinished.open("rb") as looker:
        fcntl.flock(looker, fcntl.LOCK_SH)
        assert not is_in_use(unfinished)
        assert run_state(unfinished) == "unfinished"
        # The reader keeps its lock until `finish` waits for it.
        monkeypatch.setattr(run_files.time, "sleep", lambda seconds: looker.close())
        finish(unfinished)
    assert run_state(unfinished) == "recovered"


def test_a_run_that_is_being_recorded_is_read_up_to_where_it_was_when_reading_began(run: Run, tmp_path: Path) -> None:
    info = RunInfo("paper", load_preset("paper"))
    file = claim_run_file(tmp_path, "paper", info.started)
    recording = RunWriter(file, info)
    writer = RunEncoder(info, [recording.stream])
    for first in (0, 100, 200):
        writer.write_samples(run.slice(first, first + 100))
    recording.push()
    blocks = read_recording(file.path).blocks()
    first = next(blocks)
    writer.write_samples(run.slice(300, 400))
    recording.push()
    assert_same_bits(join_blocks([first, *blocks]), run.slice(0, 300))
    recording.close()
    file.release()


def test_a_run_is_read_while_it_is_written(run: Run, tmp_path: Path) -> None:
    info = RunInfo("paper", load_preset("paper"))
    file = claim_run_file(tmp_path, "paper", info.started)
    recording = RunWriter(file, info)
    writer = RunEncoder(info, [recording.stream])

    def write() -> None:
        for first in range(0, 1000, 5):
            writer.write_samples(run.slice(first, first + 5))
            recording.push()

    recording.push()
    writing = Thread(target=write)
    writing.start()
    lengths = [0]
    while writing.is_alive():
        samples = join_blocks(list(read_recording(file.path).blocks()) or [run.slice(0, 0)])
        assert_same_bits(samples, run.slice(0, len(samples)))
        lengths.append(len(samples))
    recording.close()
    file.release()
    assert lengths == sorted(lengths)
    assert_same_bits(join_blocks(list(read_recording(file.path).blocks())), run.slice(0, 1000))


@contextlib.contextmanager
def pressing_at(line: int, after: Callable[[], object] = lambda: True) -> Iterator[list[int]]:
    """Press Ctrl-C at this line that flexlab's recording executes in the block; yields a list of the lines so far.

    `after`: whether the count has begun.
    """
    lines: list[int] = []

    def look(frame: FrameType, what: str, _: Any) -> Any:
        if what == "line" and "recording" in frame.f_code.co_filename and (lines or after()):
            lines.append(frame.f_lineno)
            if len(lines) == line:
                signal.raise_signal(signal.SIGINT)
        return look

    sys.settrace(look)
    try:
        yield lines
    finally:
        sys.settrace(None)


def test_ctrl_c_anywhere_in_the_writing_of_a_block_leaves_a_whole_recording(run: Run, tmp_path: Path) -> None:
    """Samples were written and not counted, or the other way round: the recording was called damaged."""

    def interrupted(line: int) -> tuple[Path, int]:
        with (
            contextlib.suppress(KeyboardInterrupt),
            HeadlessRecording(tmp_path, RunInfo("paper", run.scenario)) as recording,
        ):
            recording.write(run.slice(0, BLOCK))
            with pressing_at(line) as lines:
                recording.write(run.slice(BLOCK, 2 * BLOCK))
        return recording.path, len(lines)

    _, count = interrupted(0)
    assert count > 100
    for line in range(1, count + 1, count // 15):
        found = read_recording(interrupted(line)[0])
        assert_same_bits(found.samples, run.slice(0, len(found.samples)))
        assert len(found.samples) in (BLOCK, 2 * BLOCK)
        assert (found.state, found.status) == ("complete", "finished")


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_a_run_whose_saving_was_interrupted_is_not_taken_for_a_finished_one(
    error: type[BaseException], run: Run, tmp_path: Path
) -> None:
    def interrupted(*events: Event) -> Path:
        def raising() -> Iterator[Event]:
            yield from events
            raise error

        with pytest.raises(error), HeadlessRecording(tmp_path, RunInfo("paper", run.scenario), None, True) as recording:
            recording.write_whole(run, raising())
        return recording.path

    assert not interrupted().exists()
    path = interrupted(Event(0.3, "a change"))
    said = "Saving was interrupted: the run goes on to t = 1 s, but is recorded up to t = 0.3 s only."
    found, row = read_recording(path), read_row(path)
    assert_same_bits(found.samples, run.slice(0, 301))
    assert (found.state, found.status, found.status.text) == ("recovered", "running", said)
    assert (row.state, state_word(row), row.status, row.breaks_off) == ("recovered", "breaks off", "", said)
    assert not row.is_stopped


def test_ctrl_c_while_a_run_begins_to_be_saved_ends_it(run: Run, tmp_path: Path) -> None:
    """`run.save()` waited for ever for the end of a pipe into which nothing wrote."""

    def interrupted(line: int) -> int:
        info = RunInfo("paper", run.scenario)
        file = claim_run_file(tmp_path, "paper", info.started)
        writer = None
        with contextlib.suppress(KeyboardInterrupt), pressing_at(line) as lines:
            writer = RunWriter(file, info, in_one_piece=True)
        if writer:
            writer.let_go()
        file.release()
        return len(lines)

    count = interrupted(0)
    for line in range(1, count + 1, count // 30):
        interrupted(line)
        assert "flexlab-pipe" not in [thread.name for thread in threading.enumerate()]


def test_ctrl_c_while_a_recording_is_imported_leaves_nothing_of_it(run: Run, tmp_path: Path) -> None:
    """A piece of it stayed in the library."""
    path, logs = write_run(run, tmp_path / "made", "paper"), tmp_path / "logs"
    with pytest.raises(KeyboardInterrupt), pressing_at(40, after=lambda: [*logs.glob("*.rrd")]):
        import_into(path, logs)
    assert list(logs.iterdir()) == []


@pytest.mark.parametrize("share", [0.999, 0.9, 0.6, 0.35])
def test_a_cut_off_file_loses_only_what_follows_the_cut(unfinished: Path, run: Run, share: float) -> None:
    data = unfinished.read_bytes()
    unfinished.write_bytes(data[: int(share * len(data))])
    found = read_recording(unfinished)
    rows = len(found.samples)
    assert rows % BLOCK == 0
    assert rows >= (share - 0.2) * 1000
    assert_same_bits(found.samples, run.slice(0, rows))
    finish(unfinished)
    assert run_state(unfinished) == "recovered"
    assert len(read_recording(unfinished).samples) == rows


def test_a_file_too_large_to_be_joined_is_mended_piece_by_piece(
    unfinished: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tool, "LARGE_FILE", 0)
    data = unfinished.read_bytes()
    unfinished.write_bytes(data[: int(0.8 * len(data))])
    found = read_recording(unfinished)
    assert_same_bits(found.samples, run.slice(0, len(found.samples)))
    assert len(found.samples) >= 600
    finish(unfinished)
    assert run_state(unfinished) == "recovered"
    assert RrdReader(unfinished).store()
    assert len(read_recording(unfinished).samples) == len(found.samples)


def test_finishing_twice_changes_nothing(recording_file: Path) -> None:
    before = recording_file.read_bytes()
    finish(recording_file)
    assert recording_file.read_bytes() == before
    assert run_state(recording_file) == "complete"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is empty: its run was lost"),
        (b"hello, I am a text file", "is not a rerun recording: choose a file that ends in .rrd"),
        (np.random.default_rng(1).bytes(5000), "is not a rerun recording"),
        (b"RRF2" + np.random.default_rng(2).bytes(5000), "damaged beyond repair"),
        (b"RRF2", "damaged beyond repair"),
    ],
)
def test_a_file_that_is_no_recording_is_refused_in_one_sentence(content: bytes, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "x.rrd"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=sentence) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_cut_to_its_head_is_noted_as_damaged_and_left_as_it_is(unfinished: Path) -> None:
    unfinished.write_bytes(unfinished.read_bytes()[:40])
    with pytest.raises(RecordingError, match="damaged beyond repair"):
        finish(unfinished)
    assert run_state(unfinished) == "damaged"
    assert read_notes(unfinished)["damaged_size"] == 40
    assert unfinished.stat().st_size == 40


@pytest.mark.parametrize("with_notes", [True, False])
@pytest.mark.parametrize("whole", [True, False])
def test_a_recording_cut_before_its_first_sample_is_damaged_for_all(
    recording_file: Path, unfinished: Path, whole: bool, with_notes: bool
) -> None:
    """It was mended and listed as recovered, or as complete, with nothing in it."""
    cut = unfinished.with_name("cut.rrd")
    cut.write_bytes((recording_file if whole else unfinished).read_bytes()[:90_000])
    if with_notes:
        shutil.copy(notes_path(recording_file), notes_path(cut))
    for _ in range(2):
        for read in (lambda path: read_recording(path).samples, lambda path: read_recording(path).span, finish):
            with pytest.raises(RecordingError, match="damaged"):
                read(cut)
        assert (run_state(cut), cut.stat().st_size) == ("damaged", 90_000)


@pytest.mark.parametrize("share", [0.5, 0.7])
def test_a_whole_recording_that_is_cut_later_breaks_off(recording_file: Path, tmp_path: Path, share: float) -> None:
    """Its notes told of the whole run: it was listed as complete, with the metrics of samples that it has not."""
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(recording_file.read_bytes()[: int(share * recording_file.stat().st_size)])
    notes_path(recording_file).rename(notes_path(cut))
    recording_file.unlink()
    finish(cut)
    row, found = read_row(cut), read_recording(cut)
    assert (row.state, row.status, row.duration, row.metrics) == ("recovered", "", None, {})
    assert found.state == "recovered"
    assert note_missing_metrics(tmp_path) == 1
    assert read_row(cut).duration == pytest.approx(found.span[1])


def test_a_missing_file_and_a_folder_are_refused_with_a_reason(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"There is no recording .*no\.rrd: check the name"):
        read_recording(tmp_path / "no.rrd")
    with pytest.raises(RecordingError, match="cannot be read"):
        read_recording(tmp_path)


def test_a_recording_of_another_program_is_refused_as_such(tmp_path: Path) -> None:
    import rerun as rr

    stream = rr.RecordingStream("other")
    stream.save(tmp_path / "other.rrd")
    stream.log("a", rr.TextLog("hello"))
    stream.flush()
    stream.disconnect()
    with pytest.raises(RecordingError, match="a rerun recording, but not one of flexlab's"):
        read_recording(tmp_path / "other.rrd")


@pytest.mark.parametrize("merged", [True, False], ids=["by rerun", "end to end"])
def test_a_file_of_two_runs_is_not_taken_for_one_of_them(run: Run, tmp_path: Path, merged: bool) -> None:
    """`rerun rrd merge` makes such files: the second run was lost without a word when they were exported or imported."""
    both, parts = tmp_path / "both.rrd", [write_run(run, tmp_path, name) for name in ("one", "other")]
    if merged:
        subprocess.run([tool.rerun_tool(), "rrd", "merge", *parts, "-o", both], check=True, capture_output=True)
    else:
        both.write_bytes(b"".join(part.read_bytes() for part in parts))
    for read in (read_recording, lambda path: import_into(path, tmp_path / "logs")):
        with pytest.raises(RecordingError, match="holds 2 recordings"):
            read(both)
    assert not list((tmp_path / "logs").glob("*"))


def test_a_name_that_rerun_cannot_open_is_not_taken_for_damage(run: Run, tmp_path: Path) -> None:
    """Such a run was recorded, and then said to be damaged beyond repair."""
    path = write_run(run, tmp_path, "paper")
    odd = path.rename(path.with_name(os.fsdecode(b"odd-\xff.rrd")))
    for read in (read_recording, finish, lambda odd: import_into(odd, tmp_path / "logs")):
        with pytest.raises(RecordingError, match="bytes in its name that are not UTF-8"):
            read(odd)
    folder = tmp_path / os.fsdecode(b"\xff")
    with pytest.raises(RecordingError, match="bytes in its name that are not UTF-8"):
        write_run(run, folder, "paper")
    assert not folder.exists()


def test_a_folder_named_like_an_option_holds_recordings(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with HeadlessRecording(Path("-x"), RunInfo("paper", run.scenario)) as recording:
        recording.write(run.slice(0, 20))
    assert run_state(recording.path) == "complete"
    assert len(read_recording(recording.path).samples) == 20
