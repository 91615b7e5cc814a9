"""`flexlab` in a process of its own, as a user starts it."""

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
from typing import Any

Command = Callable[..., subprocess.CompletedProcess[str]]
"""Type of the fixtures `flexlab_command` and `flexlab_process`, which run `flexlab` with the given words."""
PATIENCE = 300.0
"""Timeout, s: generous, as the machine may be busy and the cache cold; it is no measure of speed."""


def refused(done: subprocess.CompletedProcess[str], lines: int = 1) -> str:
    """Return the sentence, of at most `lines` lines, with which a command refused its input; assert that it printed only this."""
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert 1 <= done.stderr.count("\n") <= lines, done.stderr
    assert done.stderr.endswith((".\n", "?\n")), done.stderr
    return done.stderr


class Lab:
    """A lab in a process of its own."""

    def __init__(self, folder: Path, *words: str, port: int = 0, handles: int | None = None, **environment: str):
        """`handles`: how many files and connections it may have open at once, set by the shell's `ulimit`."""
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
        """Wait until the lab prints its address, and return it."""
        return self.wait(lambda: re.search(r"open at (http://\S+)", "".join(self.said)))[1]

    def port(self) -> int:
        """The port of that address."""
        return int(self.url().split(":")[2].split("/")[0])

    def wait(self, found: Callable[[], Any]) -> Any:
        """Wait until `found` returns something true, and return that."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            result = found()
            if result:
                return result
            assert self.process.poll() is None, "".join(self.said + self.complained)
            time.sleep(0.05)
        raise AssertionError(f"waited in vain: {self.said} {self.complained}")

    def end(self, how: signal.Signals = signal.SIGINT) -> int:
        """Send a signal that ends the lab, wait for the end, and return the exit code."""
        self.process.send_signal(how)
        return self.wait_for_end()

    def wait_for_end(self) -> int:
        """Wait until the lab has ended, and return the exit code."""
        code = self.process.wait(PATIENCE)
        for reader in self._readers:
            reader.join()
        return code

    def recordings(self, logs: str = "logs") -> list[Path]:
        """Recordings that are not empty."""
        return [file for file in (self.folder / logs).glob("*.rrd") if file.stat().st_size > 0]


def answer(url: str) -> int | None:
    """Return the HTTP status of a page for a visitor who keeps cookies, None while nobody listens."""
    visitor = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    try:
        with visitor.open(url) as page:
            return page.status
    except urllib.error.HTTPError as error:
        return error.code
    except (OSError, http.client.HTTPException):
        return None
