"""What the panel says about the recording: the file, how fast it grows, and when the disk is nearly full."""

import shutil
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from flexlab.recording.recorder import Recorder

LOOK_PERIOD = 1.0
"""s between two looks at file and disk."""
MEASURED = 10
"""Looks over which the rate is measured."""
MEGABYTE, GIGABYTE = 1e6, 1e9
LITTLE_SPACE = 2 * GIGABYTE
"""Bytes free below which there is a warning: an hour of a lab that nobody stops."""


def little_space(logs: Path) -> str:
    """A warning, without a full stop, when the disk of the logs folder is nearly full; else empty."""
    try:
        free = shutil.disk_usage(logs).free
    except OSError:
        return ""
    if free >= LITTLE_SPACE:
        return ""
    return f"Only {free / GIGABYTE:.1f} GB free on this disk: delete runs that nobody needs"


class RecordingText:
    """Called ten times a second by the panel, it looks at the disk once a second."""

    def __init__(self, recorder: Recorder, logs: Path, clock: Callable[[], float] = time.monotonic):
        self._recorder, self._logs, self._clock = recorder, logs, clock
        self._looks: deque[tuple[float, int]] = deque(maxlen=MEASURED)
        self._path: Path | None = None
        self._looked_at = float("-inf")
        self._warning = ""

    def __call__(self) -> str:
        """The sentence; empty before there is a recording."""
        if self._recorder.problem is not None:
            return self._recorder.problem
        path = self._recorder.path
        if path is None:
            return ""
        if self._clock() - self._looked_at >= LOOK_PERIOD:
            self._look(path)
        return f"Recording to {path.name}{self._rate()}{self._warning}"

    def _look(self, path: Path) -> None:
        self._looked_at = self._clock()
        if path != self._path:
            self._path = path
            self._looks.clear()
        try:
            self._looks.append((self._looked_at, path.stat().st_size))
        except OSError:
            return  # The recorder says what is wrong with the disk.
        little = little_space(self._logs)
        self._warning = f". {little}" if little else ""

    def _rate(self) -> str:
        if len(self._looks) < 2:
            return ""
        (first, before), (last, now) = self._looks[0], self._looks[-1]
        return f", {60 * (now - before) / (last - first) / MEGABYTE:.0f} MB/min"
