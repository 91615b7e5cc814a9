"""Whose runs are whose, by a word that the visitor keeps, and how much one visitor's runs may take on the disk."""

import contextlib
import hashlib
import time
from collections.abc import Callable
from pathlib import Path

from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import list_runs


def owner_word(visitor: str) -> str:
    """What stands in the notes of a visitor's runs: it tells nothing of the secret it is made from. Empty for nobody."""
    return hashlib.sha256(f"flexlab run of {visitor}".encode("utf-8", "replace")).hexdigest()[:32] if visitor else ""


LOOK = 5.0
"""s between two looks at the folder."""
MEGABYTE = 1e6
PER_SECOND = 0.5 * MEGABYTE
"""Bytes that a simulated second of the paper's run takes, about."""


class Quota:
    """Says, in a sentence, when a visitor's runs would take more than they may; one recorder's thread asks it."""

    def __init__(self, logs: Path, owner: str, most: float | None, clock: Callable[[], float] = time.monotonic):
        """`most`: bytes; None or no owner: any number. `owner`: by which the runs are known."""
        self._logs, self._owner, self._most, self._clock = logs, owner, most, clock
        self._owners: dict[Path, str] = {}
        self._looked_at = float("-inf")
        self._known = self._granted = 0.0
        """Bytes at the last look, and those that were asked for since then."""

    def __call__(self, size: int = 0) -> str:
        """Why no `size` more bytes may be written; empty if they may, and then they count."""
        if self._most is None or not self._owner:
            return ""
        if self._clock() - self._looked_at >= LOOK:
            self._looked_at = self._clock()
            self._known, self._granted = self._taken(), 0.0
        taken = self._known + self._granted
        if taken + size <= self._most:
            self._granted += size
            return ""
        return (
            f"Your runs take {taken / MEGABYTE:.0f} MB of the {self._most / MEGABYTE:.0f} MB that each visitor has"
            f"{f', and this needs {size / MEGABYTE:.1f} MB' if taken <= self._most else ''}: "
            "delete some of them on the page Runs. A simulated second takes about "
            f"{PER_SECOND / MEGABYTE:g} MB, so that {self._most / PER_SECOND:.0f} s fit in all."
        )

    def _taken(self) -> float:
        """Bytes of the visitor's runs."""
        runs = list_runs(self._logs)
        # Whose a run is does not change, but a run that is just being opened does not say it yet.
        known = {path: self._owners.get(path) or str(read_notes(path).get("owner", "")) for path in runs}
        self._owners = {path: owner or ("-" if path in self._owners else "") for path, owner in known.items()}
        total = 0
        for path, owner in known.items():
            with contextlib.suppress(OSError):
                total += path.stat().st_size if owner == self._owner else 0
        return total
