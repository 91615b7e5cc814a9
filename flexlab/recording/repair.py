"""Makes recordings whole after their writer is done with them, or died: footer, index, torn tail.

Rerun's own tool does the work in a process of its own: a finished file opens faster, and one whose last message is torn,
which every reader refuses, becomes readable up to the tear.
"""

import contextlib
import errno
import os
import re
import shutil
import subprocess
import threading
from pathlib import Path

import rerun_cli
from rerun.chunk import RrdReader

from flexlab.errors import RecordingError
from flexlab.recording.store.run_files import (
    claim,
    has_footer,
    list_runs,
    read_notes,
    replacing,
    run_state,
    write_notes,
)

LARGE_FILE = 500_000_000
"""Bytes: above that the pieces are indexed but not joined, which would take the whole recording into memory."""

LOW_PRIORITY = 19
"""Unix niceness: a lab that runs on must not notice."""

LONGEST = 600.0
"""s that mending one file may take."""

OS_ERROR = re.compile(r"([^:\n]*) \(os error (\d+)\)")
"""How the tool says what the operating system refused."""

GROWTH = 1.3
"""Room that the finished file may take, in sizes of the unfinished one."""


def rerun_tool() -> str:
    """The path of rerun's own program, which comes with its Python package. Raises `RecordingError`."""
    folder = Path(rerun_cli.__path__[0])
    for name in ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun"):
        if (folder / name).is_file():
            return str(folder / name)
    raise RecordingError(f"Rerun's program is not in {folder}: install rerun-sdk again.")


class Mending:
    """One run of rerun's tool on one file, which another thread may stop."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = threading.Event()

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stopped.is_set()

    def stop(self) -> None:
        """End it now; the file stays as it was."""
        self._stopped.set()
        process = self._process
        if process is not None:
            with contextlib.suppress(OSError):
                process.terminate()

    def rewrite(self, source: Path, target: Path) -> bool:
        """Write what can be read of `source` to `target`, with a footer; whether anything could be.

        Raises OSError if the disk refuses; `target` is then worth nothing, even if it can be read.
        """
        ways = ("filter",) if source.stat().st_size > LARGE_FILE else ("optimize", "filter")
        return any(not self._stopped.is_set() and self._run(way, source, target) for way in ways)

    def _run(self, way: str, source: Path, target: Path) -> bool:
        command = [rerun_tool(), "rrd", way, "--continue-on-error", str(source), "-o", str(target)]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env=os.environ | {"RUST_LOG": "warn"},
            # A session of its own: Ctrl-C is for the lab, which then waits for this or stops it.
            start_new_session=True,
        )
        with contextlib.suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, LOW_PRIORITY)
        if self._stopped.is_set():
            self._process.terminate()
        try:
            _, said = self._process.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
            return False
        # On a full disk the tool leaves a piece of the run and reports success; only its warnings tell.
        refused = OS_ERROR.search(said.decode(errors="replace"))
        if refused:
            raise OSError(int(refused[2]), refused[1])
        return self._process.returncode == 0 and target.exists() and has_footer(target)


def finish(path: Path, mending: Mending | None = None) -> None:
    """Give a recording its footer and index, in its place. Its date stays.

    Does nothing if it has one, or if somebody is writing it. Raises `RecordingError` if it cannot be read at all.
    """
    mending = mending or Mending()
    try:
        if has_footer(path):
            return
        if path.stat().st_size == 0:
            raise RecordingError(f"{path} is empty: its run was lost before anything was written.")
        own = claim(path, "rb+")
    except BlockingIOError:
        return
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror}): check the name and its rights.") from None
    try:
        _finish_claimed(path, mending)
    finally:
        own.release()


def _finish_claimed(path: Path, mending: Mending) -> None:
    before = path.stat()
    if shutil.disk_usage(path.parent).free < GROWTH * before.st_size:
        # A lab that is recording there must not be driven into a full disk.
        raise _not_now(path, os.strerror(errno.ENOSPC))
    ended = read_notes(path).get("ended", False)
    try:
        with replacing(path) as draft:
            if not mending.rewrite(path, draft) or not _has_recording(draft):
                raise RecordingError(f"{path.name} is damaged beyond repair: nothing of its run can be read.")
            os.utime(draft, ns=(before.st_atime_ns, before.st_mtime_ns))
        if not ended:
            write_notes(path, recovered=True)
    except RecordingError:
        if not mending.stopped:
            with contextlib.suppress(OSError):
                write_notes(path, damaged_size=before.st_size)
        raise
    except OSError as error:
        raise _not_now(path, error.strerror) from None


def _not_now(path: Path, reason: str) -> RecordingError:
    return RecordingError(f"{path} cannot be mended ({reason}): make room or mend the rights. Nothing of it is lost.")


def _has_recording(path: Path) -> bool:
    """Whether rerun finds a recording in the file, not only a frame around nothing."""
    try:
        return bool(RrdReader(path).recordings())
    except (ValueError, RuntimeError, OSError):
        return False


def sweep_empty(logs: Path) -> int:
    """Remove the empty files of labs that died as they made them; returns how many. Those in use stay."""
    count = 0
    for path in list_runs(logs):
        with contextlib.suppress(OSError):
            if path.stat().st_size or read_notes(path):
                continue
            file = claim(path, "rb+")
            try:
                # Looked at again under the claim: its writer may just have begun.
                if file.in_place and path.stat().st_size == 0:
                    path.unlink()
                    count += 1
            finally:
                file.release()
    return count


def unfinished_runs(logs: Path) -> list[Path]:
    """Recordings that their writer left without a footer, newest first, those in use and those known as lost left out."""
    return [path for path in list_runs(logs) if run_state(path) == "unfinished"]
