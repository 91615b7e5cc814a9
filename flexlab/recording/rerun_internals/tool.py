"""Rerun's own program, which comes with its Python package: what makes recordings whole."""

import contextlib
import os
import re
import subprocess
import threading
from pathlib import Path

import rerun_cli

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.message_layout import has_footer

LARGE_FILE = 500_000_000
"""Bytes: above that the pieces are indexed but not joined, which would take the whole recording into memory."""

LOW_PRIORITY = 19
"""Unix niceness: a lab that runs on must not notice."""

LONGEST = 600.0
"""s that mending one file may take."""

OS_ERROR = re.compile(r"([^:\n]*) \(os error (\d+)\)")
"""How the tool says what the operating system refused."""


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
