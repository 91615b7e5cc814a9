"""Measures runs that have no metrics yet, when somebody looks at the library: in a process of its own, at low priority."""

import contextlib
import multiprocessing
import os
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path

from flexlab.analysis.metrics.noted import measured
from flexlab.analysis.run_summary import note_missing_metrics
from flexlab.recording.store.run_index import RunRow
from flexlab.server.child_processes import end_with_the_server, failures_told_plainly

LOW_PRIORITY = 19
"""Unix niceness: the labs must not notice."""


@failures_told_plainly()
def measure(logs: Path) -> None:
    """The life of the measuring process."""
    end_with_the_server()
    with contextlib.suppress(AttributeError, OSError):
        os.nice(LOW_PRIORITY)
    with contextlib.suppress(KeyboardInterrupt):
        note_missing_metrics(logs)


class Measuring:
    """At most one such process of a server."""

    def __init__(self, logs: Path):
        self._logs = logs
        self._process: BaseProcess | None = None
        self._tried: set[str] = set()

    def look(self, rows: Sequence[RunRow]) -> int:
        """Start measuring if there is something new to measure; returns how many runs are still to be measured."""
        missing = {row.id for row in rows if not measured(row.metrics) and row.state in ("complete", "recovered")}
        if self._process is not None and self._process.is_alive():
            return len(missing)
        # What could not be measured once is not tried again at every look.
        if missing <= self._tried:
            return 0
        self._tried |= missing
        self._process = multiprocessing.get_context("spawn").Process(
            target=measure, args=(self._logs,), name="flexlab-measuring", daemon=True
        )
        self._process.start()
        return len(missing)

    def close(self) -> None:
        """End it; what is missing is measured another time."""
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join()
