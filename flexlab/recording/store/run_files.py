"""Names, claims and states of recordings in a logs folder.

A recording that is being written is claimed by a lock that dies with its process, so a second lab, or the next start, can
tell an abandoned file from one in use.
"""

import contextlib
import os
import re
import stat
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any, Literal

from flexlab.errors import RecordingError
from flexlab.files import HAS_LOCKS, begin_folder, is_regular, lock, writable
from flexlab.recording.rerun_internals.rrd_file import FAMILY, check_path, has_footer
from flexlab.recording.store.notes import check_notes, notes_path, read_notes
from flexlab.text import visible

SUFFIX = ".rrd"
TIME_FORMAT = "%Y-%m-%dT%H-%M-%S"
"""Format of the time in file names: it sorts by time, and every file system allows it."""
QUIET_TIME = 60.0
"""Time without a write after which a file counts as abandoned on systems without locks (Windows), s."""
MAX_SAME_NAME = 1000
"""Largest number of runs of one preset within a second."""
CLAIM_ATTEMPTS = 50
"""Attempts to claim a file before it counts as another's: a check whether it is in use locks it for a moment."""
NOT_RECORDED = "the run is not recorded"
NEWEST = "newest"
NAMES_SAID = 3
"""Largest number of names listed if several begin alike."""
State = Literal["in use", "complete", "recovered", "unfinished", "damaged"]
"""complete: ended properly. recovered: its writer died, and the file was finished. unfinished: without a footer."""
BREAKING_OFF = "running"
"""The status of a recording that does not contain how its run ended."""


@dataclass(frozen=True)
class RunFile:
    """A claimed file, which nobody else writes or repairs until `release`."""

    path: Path
    handle: IO[bytes]

    @property
    def in_place(self) -> bool:
        """Whether the path still leads to this file, which nobody moved, deleted or replaced."""
        try:
            return os.path.samestat(self.path.lstat(), os.fstat(self.handle.fileno()))
        except OSError:
            return False

    def release(self) -> None:
        """Give up the claim."""
        self.handle.close()


def check_folder(logs: Path) -> None:
    """Make the logs folder if it is not there. Raises `RecordingError` if recordings cannot be written into it."""
    check_path(logs)
    with writable(f"The logs folder {logs}", "choose another with --logs, or correct its permissions", RecordingError):
        begin_folder(logs)
        probe = logs / f".probe-{os.getpid()}"
        probe.touch()
        probe.unlink()


def _make_folder(folder: Path) -> None:
    """Make a folder for recordings if it is not there. Raises `RecordingError`."""
    check_path(folder)
    with writable(folder, NOT_RECORDED, RecordingError):
        begin_folder(folder)


def claim_named_file(path: Path) -> RunFile:
    """Create a file of this name. Raises `RecordingError`, also if the file exists."""
    _make_folder(path.parent)
    with writable(path, "give another name, or a folder", RecordingError):
        check_notes(path)
    with writable(path, NOT_RECORDED, RecordingError):
        try:
            return claim(path, "xb")
        except FileExistsError:
            raise RecordingError(f"{path} already exists: give another name, or a folder.") from None


def claim_run_file(logs: Path, name: str, started: datetime, part: int = 1) -> RunFile:
    """Create `<time>-<name>.rrd`, with a number added if that name is taken. Raises `RecordingError`."""
    stem = f"{started.strftime(TIME_FORMAT)}-{file_word(name)}" + (f"-part{part}" if part > 1 else "")
    _make_folder(logs)
    for number in range(1, MAX_SAME_NAME):
        path = logs / (f"{stem}-{number}{SUFFIX}" if number > 1 else stem + SUFFIX)
        with writable(path, NOT_RECORDED, RecordingError), contextlib.suppress(FileExistsError):
            file = claim(path, "xb")
            if not file.in_place:  # Another process removed it as an empty file.
                file.release()
                file = claim(path, "xb")
            return file
    raise RecordingError(f"{logs} has {MAX_SAME_NAME} recordings named {stem}: move some away.")


def claim(path: Path, mode: Literal["xb", "rb+"]) -> RunFile:
    """Open and lock a file. Raises OSError, `BlockingIOError` if another process has it."""
    handle = path.open(mode, buffering=0)
    try:
        lock(handle, CLAIM_ATTEMPTS)
    except OSError:
        handle.close()
        raise
    return RunFile(path, handle)


def is_in_use(path: Path) -> bool:
    """Whether somebody is writing (or mending) the file."""
    if not HAS_LOCKS:
        return not read_notes(path).get("ended") and time.time() - path.stat().st_mtime < QUIET_TIME
    try:
        with path.open("rb", buffering=0) as handle:
            # Shared, so that two processes that check at once do not take each other for a writer.
            lock(handle, shared=True)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    return False


def file_word(name: str) -> str:
    """A name as part of a file name: letters, digits, dots and dashes."""
    return re.sub(r"[^\w.-]+", "-", name).strip("-.")[:60] or "run"


def check_recording(path: Path) -> None:
    """Check that a file can be a rerun recording. Raises `RecordingError` with the reason if not."""
    name = visible(path)
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):  # Checked before it is opened: a pipe would hang.
            kind = "a pipe; name an ordinary file" if stat.S_ISFIFO(mode) else "no ordinary file; name one"
            kind = "a folder; name a recording in it" if stat.S_ISDIR(mode) else kind
            raise RecordingError(f"{name} cannot be read: it is {kind}.")
        with path.open("rb") as file:
            head = file.read(len(FAMILY))
    except (FileNotFoundError, NotADirectoryError):
        raise RecordingError(f"There is no recording {name}: check the name.") from None
    except OSError as error:
        raise RecordingError(f"{name} cannot be read ({error.strerror}): check its name and permissions.") from None
    if not head:
        raise RecordingError(f"{name} is empty: its run was lost before anything was written.")
    if head != FAMILY:
        raise RecordingError(
            f"{name} is not a rerun recording: choose a file that ends in .rrd and was made by flexlab."
        )


def check_own_recording(path: Path) -> None:
    """As `check_recording`; also raises `RecordingError` for a link, which may lead out of the logs folder."""
    if path.is_symlink():
        raise RecordingError(
            f"{visible(path)} is a link: only files that lie in the folder themselves are shown; copy what it leads to."
        )
    check_recording(path)


def run_state(path: Path, notes: Mapping[str, Any] | None = None) -> State:
    """The state of a recording, without reading it; "damaged" if it cannot be opened. `notes`: those beside it, if known."""
    with contextlib.suppress(OSError):
        if not stat.S_ISREG(path.stat().st_mode):
            return "damaged"
        if notes is None:
            notes = read_notes(path)
        if notes.get("damaged_size") == path.stat().st_size:
            return "damaged"
        with path.open("rb") as file:
            begins_well = file.read(len(FAMILY)) == FAMILY
        if begins_well and has_footer(path):
            return "recovered" if notes.get("recovered") or notes.get("status") == BREAKING_OFF else "complete"
        if is_in_use(path):
            return "in use"
        # An empty file is one that is just being made, or whose lab died at that moment: nothing to mend.
        return "unfinished" if begins_well else "damaged"
    return "damaged"


def list_runs(logs: Path) -> list[Path]:
    """All recordings in the folder, newest first. A folder that is not there has none."""
    return [path for path in list_files(logs) if is_regular(path)]


def list_files(logs: Path) -> list[Path]:
    """Everything in the folder that is named like a recording, newest first, including links, pipes and folders."""
    found = []
    with contextlib.suppress(OSError), os.scandir(logs) as entries:
        for entry in entries:
            if not entry.name.endswith(SUFFIX):
                continue
            with contextlib.suppress(OSError):  # It vanished meanwhile.
                found.append((entry.stat(follow_symlinks=False).st_mtime_ns, entry.name))
    return [logs / name for _, name in sorted(found, reverse=True)]


BREAKS_OFF = "breaks_off"
"""Key in the notes: why the end of the run is not recorded, as a sentence."""
VARIANT = "variant"
"""Key in the notes on a run that was made for a comparison: which run it is a variant of, and how."""


def newest_run(logs: Path, made: bool = True) -> Path:
    """The newest recording; `made`: whether it may be one made for a comparison. Raises `RecordingError` if there is none."""
    runs = [run for run in list_runs(logs) if made or VARIANT not in read_notes(run)]
    if not runs:
        check_readable(logs)
        raise RecordingError(f"There is no recording in {logs}: start flexlab, or say where with --logs.")
    return runs[0]


def check_readable(logs: Path) -> None:
    """Raise `RecordingError` for a folder whose recordings cannot be listed."""
    try:
        os.scandir(logs).close()
    except FileNotFoundError:
        pass
    except OSError as error:
        raise RecordingError(
            f"{visible(logs, 60)} cannot be read ({error.strerror}): choose a folder with --logs."
        ) from None


def unreadable(logs: Path) -> str:
    """Why the folder's recordings cannot be listed, as a sentence; "" if they can."""
    try:
        check_readable(logs)
    except RecordingError as error:
        return str(error)
    return ""


def find_run(run: str, logs: Path) -> Path:
    """The recording named by a person: a file, a name in `logs` or the beginning of one, or "newest".

    Raises `RecordingError` if there is none, or more than one. It does not check that the file is a recording.
    """
    if run == NEWEST:
        return newest_run(logs)
    runs = list_files(logs)
    found = [path for path in runs if run in (path.name, path.stem)]
    with contextlib.suppress(OSError, ValueError):
        found = [_named_file(Path(run))] if Path(run).exists() else found
    found = found or [path for path in runs if run and path.name.startswith(run)]
    if not found:
        check_readable(logs)
        raise RecordingError(
            f"There is no recording {run:.200}, nor one in {logs} with such a name: flexlab logs lists them."
        )
    if len(found) > 1:
        names = ", ".join(path.stem for path in found[:NAMES_SAID]) + (", …" if len(found) > NAMES_SAID else "")
        raise RecordingError(f"{len(found)} runs in {logs} begin with {run:.200} ({names}): write more of the name.")
    return found[0]


def _named_file(path: Path) -> Path:
    """A file that a person named, which may be a link. Raises `RecordingError` if it is not a file."""
    path = path.resolve() if path.is_symlink() else path
    if not is_regular(path):
        check_recording(path)
    return path


def vanished(error: Exception) -> str:
    """The sentence about a recording that was deleted while it was to be read; empty for any other error."""
    name = str(getattr(error, "filename", ""))
    if not isinstance(error, FileNotFoundError) or not name.endswith(SUFFIX):
        return ""
    return f"{visible(Path(name).stem)} is not there any more: somebody has deleted or moved it."


def remove_run(path: Path) -> None:
    """Delete a recording and its notes. Raises `RecordingError` if it cannot be deleted."""
    try:
        path.unlink(missing_ok=True)
        if os.path.lexists(notes_path(path)):  # The name of the notes may be too long for any file.
            with contextlib.suppress(FileExistsError):
                check_notes(path)
                notes_path(path).unlink(missing_ok=True)
    except OSError as error:
        raise RecordingError(
            f"{visible(path)} cannot be deleted ({error.strerror}): check the permissions of its folder."
        ) from None


DAY = 86400.0  # s


def removable_runs(
    logs: Path, most_bytes: float | None = None, most_days: float | None = None, now: float | None = None
) -> list[Path]:
    """Recordings over the limits, oldest first: those older than `most_days`, and more until the rest is under `most_bytes`.

    None means no limit. Kept runs and runs being written count towards the size but are never returned. `now`: wall time, s.
    Raises `RecordingError` for a limit that is not positive.
    """
    for name, limit in (("most_bytes", most_bytes), ("most_days", most_days)):
        if limit is not None and not limit > 0:
            raise RecordingError(f"{name} = {limit:g} is not a limit: give a number above 0, or leave it out.")
    oldest_first = []
    for path in reversed(list_runs(logs)):
        with contextlib.suppress(OSError):  # It vanished meanwhile.
            oldest_first.append((path, path.stat()))
    total = sum(about.st_size for _, about in oldest_first)
    now = time.time() if now is None else now
    found = []
    for path, about in oldest_first:
        too_old = most_days is not None and now - about.st_mtime > most_days * DAY
        too_much = most_bytes is not None and total > most_bytes
        if (too_old or too_much) and not read_notes(path).get("keep") and run_state(path) != "in use":
            found.append(path)
            total -= about.st_size
    return found
