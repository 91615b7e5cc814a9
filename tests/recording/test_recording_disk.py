"""Folders and disks that cannot be written: the lab runs on, the person is told, and recording resumes when it can."""

import contextlib
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from recording_helpers import assert_same_bits, start_script, wait_until

import flexlab
from flexlab.analysis.replay import replay
from flexlab.errors import RecordingError, StudyError
from flexlab.files import make_folder
from flexlab.presets import load_preset
from flexlab.recording.file_sink import FileSink
from flexlab.recording.headless import HeadlessRecording, write_run
from flexlab.recording.importing import import_into
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.repair import Mending, finish
from flexlab.recording.rerun_internals.rrd_file import has_footer
from flexlab.recording.run_encoder import RunEncoder
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store.run_files import (
    check_folder,
    claim_named_file,
    claim_run_file,
    find_run,
    list_runs,
    newest_run,
    run_state,
)
from flexlab.recording.store.run_index import read_row
from flexlab.sim.commands import Reset
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Run
from flexlab.sim.world import World

TOLD_WITHIN = 2.0
"""Longest time until the person is told, s of simulation at real time."""


@pytest.fixture
def blocked(tmp_path: Path) -> Path:
    """A folder that nobody can make, not even root, because its parent is a file."""
    (tmp_path / "file").write_text("in the way")
    return tmp_path / "file" / "logs"


def test_a_folder_that_cannot_be_written_is_refused_before_the_lab_starts(blocked: Path) -> None:
    with pytest.raises(RecordingError, match=r"The logs folder .*logs cannot be written .*choose another with --logs"):
        check_folder(blocked)


def test_a_file_in_place_of_a_folder_is_not_said_to_exist(tmp_path: Path) -> None:
    """`File exists` was the reason, and permissions to be corrected the advice."""
    file = tmp_path / "file"
    file.write_text("in the way")
    with pytest.raises(RecordingError, match=r"The logs folder .*file cannot be written \(it is not a folder\)"):
        check_folder(file)
    with pytest.raises(StudyError, match=r"file cannot be written \(it is not a folder\): choose another folder"):
        make_folder(file)
    with pytest.raises(StudyError, match=r"file cannot be written \(it is not a folder\)"):
        flexlab.sweep("paper", {"gravity": [0.0, 1.0]}, 0.02, folder=file)


def test_a_missing_folder_is_made(tmp_path: Path) -> None:
    check_folder(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_a_finished_run_cannot_be_written_into_a_blocked_folder(blocked: Path, run: Run) -> None:
    with pytest.raises(RecordingError, match="cannot be written"):
        write_run(run, blocked, "paper")


def test_a_file_in_place_of_the_folder_is_named_as_the_reason(tmp_path: Path) -> None:
    (tmp_path / "logs").write_text("in the way")
    for place in (tmp_path / "logs", tmp_path / "logs" / "deeper"):
        with pytest.raises(RecordingError, match=r"cannot be written \(it is not a folder\): the run is not recorded"):
            claim_run_file(place, "paper", datetime.now().astimezone())
        with pytest.raises(RecordingError, match=r"cannot be written \(it is not a folder\)"):
            claim_named_file(place / "run.rrd")


def test_a_folder_without_recordings_has_no_newest_run(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="There is no recording in"):
        newest_run(tmp_path / "nowhere")
    with pytest.raises(RecordingError, match="There is no recording lqr"):
        find_run("lqr", tmp_path / "nowhere")


@pytest.mark.parametrize(("name", "why"), [("file", "Not a directory"), ("x" * 300, "File name too long")])
def test_a_folder_that_cannot_be_read_is_not_called_empty(name: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for find in (lambda: newest_run(tmp_path / name), lambda: find_run("lqr", tmp_path / name)):
        with pytest.raises(RecordingError, match=rf"cannot be read \({why}\): choose a folder with --logs\."):
            find()


def test_a_lab_runs_on_without_a_folder_and_records_once_it_is_there(tmp_path: Path, blocked: Path) -> None:
    told: list[str] = []
    recorder = Recorder(blocked, on_problem=told.append)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    wait_until(lambda: recorder.problem, "the person is told")
    wait_until(lambda: runner.snapshot.latest.time[0] > 0.5, "the lab runs on")
    assert recorder.path is None
    assert runner.snapshot.dropped_samples == 0
    (tmp_path / "file").unlink()
    wait_until(lambda: recorder.path, "recording begins")
    assert recorder.problem is None
    wait_until(lambda: runner.snapshot.latest.time[0] > 2.0, "some time is recorded")
    runner.stop()
    recorder.close()
    (path,) = list_runs(blocked)
    found = read_recording(path)
    assert found.part == 1
    assert len(found.samples) > 0
    assert [("not being recorded" in text, "goes on in" in text) for text in told] == [(True, False), (False, True)]


def test_a_file_that_is_deleted_is_reported_and_replaced(tmp_path: Path) -> None:
    told: list[str] = []
    recorder = Recorder(tmp_path, on_problem=told.append)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    wait_until(lambda: recorder.path, "there is a file")
    first = recorder.path
    assert first is not None
    first.unlink()
    wait_until(lambda: recorder.path not in (None, first), "there is another file")
    runner.stop()
    recorder.close()
    assert "was taken away while it was being written" in told[0]
    (path,) = list_runs(tmp_path)
    assert path.stem.endswith("-part2")
    assert read_recording(path).part == 2


def cut_off(path: Path) -> None:
    """Do what `truncate` does, or an editor that saves something else."""
    os.truncate(path, path.stat().st_size // 2)


def replace_by_copy(path: Path) -> None:
    """Do what `mv other.rrd path` does."""
    copy = path.with_suffix(".copy")
    copy.write_bytes(path.read_bytes())
    copy.replace(path)


def write_over(path: Path) -> None:
    """Do what `cp other.rrd path` does."""
    path.write_bytes(b"something else")


def write_over_the_same_size(path: Path) -> None:
    """Do what an editor does that keeps the length, or a program that writes into the middle."""
    for _ in range(3):  # File times are as fine as the system's clock tick, which the lab's own write may share.
        with path.open("rb+") as file:
            file.seek(path.stat().st_size // 2)
            file.write(b"something else")
        time.sleep(0.03)


@pytest.mark.parametrize("harm", [cut_off, replace_by_copy, write_over, write_over_the_same_size])
def test_a_file_that_others_change_is_reported_and_the_run_continues_in_another(
    tmp_path: Path, harm: Callable[[Path], None]
) -> None:
    told: list[str] = []
    recorder = Recorder(tmp_path, on_problem=told.append)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    wait_until(lambda: recorder.path and recorder.path.stat().st_size > 400_000, "something is recorded")
    first = recorder.path
    assert first is not None
    harm(first)
    harmed = float(runner.snapshot.latest.time[0])
    size = first.stat().st_size
    wait_until(lambda: told, "the person is told")
    assert runner.snapshot.latest.time[0] - harmed < TOLD_WITHIN
    assert told[0].startswith(f"{first} was {'replaced' if harm is replace_by_copy else 'changed by another program'}")
    wait_until(lambda: recorder.path not in (None, first), "there is another file")
    second = recorder.path
    assert second is not None
    wait_until(lambda: runner.snapshot.latest.time[0] > harmed + 2, "the lab runs on")
    assert first.stat().st_size == size, "what others put there is left alone"
    runner.stop()
    recorder.close(60)
    assert "goes on in" in told[1]
    found = read_recording(second)
    assert (found.part, found.state) == (2, "complete")
    assert found.samples.time[-1] > harmed + 1


def test_touching_the_file_does_not_interrupt_the_recording(tmp_path: Path) -> None:
    told: list[str] = []
    recorder = Recorder(tmp_path, on_problem=told.append)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    wait_until(lambda: recorder.path and recorder.path.stat().st_size > 400_000, "something is recorded")
    assert recorder.path is not None
    for _ in range(20):
        os.utime(recorder.path)
        time.sleep(0.02)
    runner.stop()
    recorder.close(60)
    assert told == []
    (path,) = list_runs(tmp_path)
    assert read_recording(path).state == "complete"


def test_a_headless_recording_reports_that_its_file_was_changed(tmp_path: Path, run: Run) -> None:
    with HeadlessRecording(tmp_path, RunInfo("paper", run.scenario)) as recording:
        recording.write(run.slice(0, 500))
        cut_off(recording.path)
        with pytest.raises(RecordingError, match="was changed by another program while it was being written"):
            recording.write(run.slice(500, 1000))


KILLED_AT_ONCE = """
import os, signal, sys
from datetime import datetime
from pathlib import Path
from flexlab.recording.store.run_files import claim_run_file
file = claim_run_file(Path(sys.argv[1]), "paper", datetime.now())
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_run_that_is_lost_leaves_no_pipe_behind(tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))

    def lose(in_its_file: bool) -> None:
        with HeadlessRecording(tmp_path, RunInfo("paper", run.scenario), in_one_piece=True) as recording:
            recording.write(run.slice(0, 100))
            if not in_its_file:
                raise RecordingError("The run cannot be written.")
            recording.path.unlink()
            recording.write(run.slice(100, 200))

    for in_its_file, told in ((True, "was taken away"), (False, "cannot be written")):
        with pytest.raises(RecordingError, match=told):
            lose(in_its_file)
        assert list(place.iterdir()) == []
    write_run(run, tmp_path / "logs", "paper")
    assert list(place.iterdir()) == []


def test_a_run_is_saved_where_no_temporary_files_can_be_made(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "full"))
    recording = read_recording(write_run(run, tmp_path, "paper"))
    assert recording.state == "complete"
    assert_same_bits(recording.samples, run)


def test_the_empty_file_of_a_killed_lab_is_removed_by_the_next_recorder(tmp_path: Path) -> None:
    assert start_script(KILLED_AT_ONCE, tmp_path).wait() < 0
    (path,) = list_runs(tmp_path)
    assert path.stat().st_size == 0
    busy = claim_run_file(tmp_path, "busy", datetime.now())
    Recorder(tmp_path).close()
    assert list_runs(tmp_path) == [busy.path], "what somebody has just begun stays"
    busy.release()


FULL_DISK = """
import resource, sys, time
from pathlib import Path
from flexlab.presets import load_preset
from flexlab.recording.run_info import RunInfo
from flexlab.recording.recorder import Recorder
from flexlab.sim.commands import Tap
from flexlab.sim.runner import Runner
from flexlab.sim.world import World

World(load_preset("paper")).advance(2)
told = []
recorder = Recorder(Path(sys.argv[1]), on_problem=told.append)
runner = Runner(load_preset("paper"), "paper", [recorder])
_, most = resource.getrlimit(resource.RLIMIT_FSIZE)
runner.start()

def wait_for(seconds):
    end = runner.snapshot.latest.time[0] + seconds
    while runner.snapshot.latest.time[0] < end:
        time.sleep(0.01)

if sys.argv[2] == "later":
    wait_for(1)
    while recorder.path is None or recorder.path.stat().st_size < 100_000:
        time.sleep(0.01)
sys.dont_write_bytecode = True  # It would be cut off, too.
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, most))
full = runner.snapshot.latest.time[0]
while not told:
    time.sleep(0.01)
print(f"{full:.3f}", f"{runner.snapshot.latest.time[0]:.3f}", told[0], sep="|", flush=True)
wait_for(1.5)
runner.submit(Tap(0.0, (0.0, 0.1)))
resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
while recorder.problem:
    time.sleep(0.01)
wait_for(0.5)
print(runner.snapshot.dropped_samples, runner.snapshot.status, told[1], sep="|", flush=True)
runner.stop()
recorder.close(60)
"""
"""A lab whose files may not grow for a while, which is like a full disk to the writer and works on any machine."""


@pytest.mark.parametrize("when", ["later", "from the start"])
def test_a_file_that_cannot_grow_for_a_while_is_reported_and_loses_nothing(when: str, tmp_path: Path) -> None:
    lab = start_script(FULL_DISK, tmp_path, when)
    assert lab.stdout is not None
    full, said, sentence = lab.stdout.readline().strip().split("|")
    dropped, status, resumed = lab.stdout.readline().strip().split("|")
    assert lab.wait(60) == 0
    if when == "later":  # At the start the compiled encoder is still being loaded.
        assert float(said) - float(full) < TOLD_WITHIN
    assert "not being recorded until that is mended" in sentence
    assert (dropped, status) == ("0", "running")
    (path,) = list_runs(tmp_path)
    found = read_recording(path)
    assert resumed == f"Recording goes on in {path.name}."
    assert (found.part, found.state, found.status) == (1, "complete", "finished")
    assert replay(found).identical
    if when == "later":
        np.testing.assert_array_equal(found.samples.time, np.arange(len(found.samples)) * 0.001)


def test_a_run_for_which_there_is_room_again_as_it_ends_does_not_break_off(run: Run, tmp_path: Path) -> None:
    info, told, refusals = RunInfo("paper", run.scenario), list[str](), ["", "The space is full."]
    file = FileSink(tmp_path, info, told.append, lambda size: refusals[0])
    encoder = RunEncoder(info, [file])
    encoder.write_samples(run.slice(0, 500))
    file.keep_up(0.0)
    refusals.reverse()
    encoder.write_samples(run.slice(500, len(run)))
    file.keep_up(0.1)
    assert told == ["The space is full. This run is not being recorded until that is mended."]
    refusals.reverse()
    encoder.end(run.status)
    path = file.close(encoder.summary(run.status, 0))
    assert path is not None
    assert_same_bits(read_recording(path).samples, run)
    row = read_row(path)
    assert (row.breaks_off, row.status, row.duration) == ("", "finished", 1.0)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A separate disk of 48 MB; needs root, which the CI machines have."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=48m", "tmpfs", disk], capture_output=True, text=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip(f"no small disk to be had ({mounted.stderr.strip()}): the limit on file size above stands for it")
    yield disk
    subprocess.run(["umount", "-l", disk], check=True)


def fill(disk: Path) -> Path:
    """Fill a disk to the last byte; return the file that fills it."""
    filler = disk / "filler"
    with filler.open("wb") as file:
        while (place := os.statvfs(disk)).f_bavail > 0:
            # Another writer may take some of the space at this moment: then try again with what is left.
            with contextlib.suppress(OSError):
                os.posix_fallocate(file.fileno(), os.fstat(file.fileno()).st_size, place.f_bavail * place.f_frsize)
    return filler


def leave(disk: Path, room: int) -> Path:
    """Fill a disk except for about `room` bytes; return the file that fills it."""
    filler = fill(disk)
    os.truncate(filler, filler.stat().st_size - room)
    return filler


def test_mending_without_room_changes_nothing_and_works_once_there_is_some(small_disk: Path, run: Run) -> None:
    path = write_run(run, small_disk, "paper")
    path.write_bytes(path.read_bytes()[:-200])
    torn = path.read_bytes()
    filler = leave(small_disk, 300_000)
    with pytest.raises(RecordingError, match=r"cannot be mended \(No space left on device\): make room") as caught:
        finish(path)
    assert "Nothing of it is lost" in str(caught.value)
    assert path.read_bytes() == torn
    assert run_state(path) == "unfinished"
    filler.unlink()
    finish(path)
    assert run_state(path) == "complete"
    assert_same_bits(read_recording(path).samples, run.slice(0, len(run)))


def test_a_recording_is_imported_onto_a_disk_without_room_to_mend_it(
    small_disk: Path, run: Run, tmp_path: Path
) -> None:
    torn = write_run(run, tmp_path, "paper")
    torn.write_bytes(torn.read_bytes()[:-200])
    filler = leave(small_disk, torn.stat().st_size + 300_000)
    path = import_into(torn, small_disk)
    assert list_runs(small_disk) == [path]
    assert_same_bits(read_recording(path).samples, run.slice(0, len(run)))
    filler.unlink()
    finish(path)
    assert run_state(path) in ("complete", "recovered")


def test_a_finished_run_is_on_a_disk_whole_or_not_at_all(small_disk: Path, run: Run) -> None:
    """It is written in one piece with its index, so that nothing needs mending later."""
    filler = leave(small_disk, 300_000)
    with pytest.raises(RecordingError, match=r"No space left on device.*nothing of the run is recorded"):
        write_run(run, small_disk, "paper")
    assert list_runs(small_disk) == []
    filler.unlink()
    path = write_run(run, small_disk, "paper")
    assert has_footer(path)
    assert_same_bits(read_recording(path).samples, run.slice(0, len(run)))


def test_a_mended_copy_that_does_not_fit_is_an_error(small_disk: Path, run: Run, tmp_path: Path) -> None:
    path = write_run(run, tmp_path, "paper")
    leave(small_disk, 300_000)
    with pytest.raises(OSError, match="No space left on device"):
        Mending().rewrite(path, small_disk / "copy.rrd")


def test_a_headless_recording_on_a_full_disk_says_how_far_it_got(small_disk: Path) -> None:
    world = World(load_preset("paper"))
    leave(small_disk, 1_000_000)

    def record() -> None:
        with HeadlessRecording(small_disk, RunInfo("paper", world.scenario)) as recording:
            recording.write(world.run(1000))
            for _ in range(5):
                recording.write(world.advance(1000))

    with pytest.raises(
        RecordingError, match=r"rrd cannot be written \(No space left on device\)\. Make room"
    ) as caught:
        record()
    (path,) = list_runs(small_disk)
    saved = read_recording(path).samples.time[-1]
    assert str(caught.value).endswith(f"the run is recorded up to t = {saved:g} s.")


def test_a_lasting_problem_is_told_throughout_a_new_run(tmp_path: Path) -> None:
    """The teacher's page showed no problem for an instant at each new run."""
    told: list[str | None] = []

    def refuse(_: int = 0) -> str:
        told.append(recorder.problem)
        return "There is no room."

    recorder = Recorder(tmp_path, refusal=refuse)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    wait_until(lambda: recorder.problem, "the first run is refused")
    first = len(told)
    runner.submit(Reset())
    wait_until(lambda: len(told) > first, "the second run is refused")
    runner.stop()
    recorder.close()
    assert all(told[1:]), told


def test_a_full_disk_is_called_full_and_nothing_is_lost_once_there_is_room(small_disk: Path) -> None:
    told: list[str] = []
    logs = small_disk / "logs"
    recorder = Recorder(logs, on_problem=told.append)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    wait_until(lambda: recorder.path and recorder.path.stat().st_size > 400_000, "something is recorded")
    filler = fill(small_disk)
    full = float(runner.snapshot.latest.time[0])
    wait_until(lambda: told, "the person is told")
    assert runner.snapshot.latest.time[0] - full < TOLD_WITHIN
    assert told[0].startswith(f"The disk of {logs} is full (0.0 MB free).")
    wait_until(lambda: runner.snapshot.latest.time[0] > full + 1, "the lab runs on")
    filler.unlink()
    wait_until(lambda: recorder.problem is None, "recording resumes")
    resumed = float(runner.snapshot.latest.time[0])
    wait_until(lambda: runner.snapshot.latest.time[0] > resumed + 0.5, "something more is recorded")
    assert runner.snapshot.dropped_samples == 0
    runner.stop()
    recorder.close(60)
    (path,) = list_runs(logs)
    found = read_recording(path)
    np.testing.assert_array_equal(found.samples.time, np.arange(len(found.samples)) * 0.001)
    assert found.samples.time[-1] > resumed
    assert told[1] == f"Recording goes on in {path.name}."


def test_a_lab_that_ends_on_a_full_disk_keeps_what_fitted(small_disk: Path, tmp_path: Path) -> None:
    logs = small_disk / "logs"
    recorder = Recorder(logs)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    wait_until(lambda: recorder.path and recorder.path.stat().st_size > 400_000, "something is recorded")
    assert recorder.path is not None
    before = Path(shutil.copy(recorder.path, tmp_path / "before.rrd"))
    filler = fill(small_disk)
    wait_until(lambda: recorder.problem, "the disk is full")
    runner.stop()
    recorder.close()
    (path,) = list_runs(logs)
    assert run_state(path) == "unfinished"
    filler.unlink()
    finish(path)
    assert run_state(path) == "recovered"
    kept = read_recording(path).samples.time
    assert kept[-1] >= read_recording(before).samples.time[-1] > 0.1
    np.testing.assert_array_equal(kept, np.arange(len(kept)) * 0.001)
