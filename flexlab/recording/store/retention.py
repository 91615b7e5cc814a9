"""Which old recordings may go, by total size or by age. Off unless asked for; runs marked to be kept are never touched."""

import contextlib
import time
from collections.abc import Sequence
from pathlib import Path

from flexlab.errors import RecordingError
from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import list_runs, remove_run, run_state

DAY = 86400.0
"""s."""


def removable_runs(
    logs: Path, most_bytes: float | None = None, most_days: float | None = None, now: float | None = None
) -> list[Path]:
    """Recordings over the limits, oldest first: those older than `most_days`, and as many as bring all under `most_bytes`.

    None is no limit. Kept runs and runs being written count towards the size, but are never among the answers. `now`: wall
    time, s. Raises `RecordingError` for a limit that is no positive number.
    """
    for name, limit in (("most_bytes", most_bytes), ("most_days", most_days)):
        if limit is not None and not limit > 0:
            raise RecordingError(f"{name} = {limit:g} is no limit: give a number above 0, or leave it out.")
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


def remove_runs(paths: Sequence[Path]) -> None:
    """Delete recordings and their notes. Raises `RecordingError` for the first that cannot be deleted."""
    for path in paths:
        remove_run(path)
