"""`flexlab` in a process of its own, as a person starts it."""

import http.client
import os
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

Command = Callable[..., subprocess.CompletedProcess[str]]
"""Does what `flexlab` and these words do: `flexlab_command`, `flexlab_process`."""
PATIENCE = 300.0
"""s: generous, since a machine may be busy and a cache cold; no test passes or fails by speed."""


def refused(done: subprocess.CompletedProcess[str], lines: int = 1) -> str:
    """The sentence, of so many lines at most, with which a command refused its input; it did nothing else."""
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert 1 <= done.stderr.count("\n") <= lines, done.stderr
    assert done.stderr.endswith((".\n", "?\n")), done.stderr
    return done.stderr


class Lab:
    """A lab in a process of its own."""

    def __init__(self, folder: Path, *words: str, port: int = 0, handles: int | None = None, **environment: str):
        """`handles`: files and connections that it may have at once, by the shell's `ulimit`."""
        plain = {"NO_COLOR": "1", "PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8"}
        limit = [] if handles is None else ["sh", "-c", f'ulimit -n {handles}; exec "$@"', "sh"]
        self.folder = folder
        self.process = subprocess.Popen(
            [*limit, sys.executable, "-m", "flexlab", "--port", str(port), "--no-browser", *words],
            cwd=folder,
            env=os.environ | plain | environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        self.said: list[str] = []
        self.complained: list[str] = []
        self._readers = [
            threading.Thread(target=self._read, args=(self.process.stdout, self.said)),
            threading.Thread(target=self._read, args=(self.process.stderr, self.complained)),
        ]
        for reader in self._readers:
            reader.start()

    @staticmethod
    def _read(stream, lines: list[str]) -> None:
        lines.extend(iter(stream.readline, ""))

    def url(self) -> str:
        """The lab's address, once it says it."""
        return self.wait(lambda: re.search(r"open at (http://\S+)", "".join(self.said)))[1]

    def port(self) -> int:
        """The port of that address."""
        return int(self.url().split(":")[2].split("/")[0])

    def wait(self, found: Callable[[], object]):
        """What `found` gives as soon as it gives something."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            result = found()
            if result:
                return result
            assert self.process.poll() is None, "".join(self.said + self.complained)
            time.sleep(0.05)
        raise AssertionError(f"waited in vain: {self.said} {self.complained}")

    def end(self, how: signal.Signals = signal.SIGINT) -> int:
        """Ask it to end and wait for that; returns the exit code."""
        self.process.send_signal(how)
        return self.wait_for_end()

    def wait_for_end(self) -> int:
        """The exit code, once it has ended."""
        code = self.process.wait(PATIENCE)
        for reader in self._readers:
            reader.join()
        return code

    def recordings(self, logs: str = "logs") -> list[Path]:
        """Files that hold something."""
        return [file for file in (self.folder / logs).glob("*.rrd") if file.stat().st_size > 0]


def answer(url: str) -> int | None:
    """The page's status for a visitor who keeps cookies, None while nobody listens."""
    visitor = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    try:
        with visitor.open(url) as page:
            return page.status
    except urllib.error.HTTPError as error:
        return error.code
    except (OSError, http.client.HTTPException):
        return None
