"""How much one visitor's runs may take on the disk."""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import list_runs

LOOK = 5.0
"""s between two looks at the folder."""
MEGABYTE = 1e6


class Quota:
    """Says, in a sentence, when a visitor's runs take more than they may; one recorder's thread asks it."""

    def __init__(self, logs: Path, owner: str, most: float | None, clock: Callable[[], float] = time.monotonic):
        """`most`: bytes; None or no owner: any number. `owner`: by which the runs are known."""
        self._logs, self._owner, self._most, self._clock = logs, owner, most, clock
        self._owners: dict[Path, str] = {}
        self._looked_at = float("-inf")
        self._sentence = ""

    def __call__(self) -> str:
        """Why nothing more is recorded; empty as long as it is."""
        if self._most is None or not self._owner:
            return ""
        if self._clock() - self._looked_at >= LOOK:
            self._looked_at = self._clock()
            taken = self._taken()
            self._sentence = (
                f"Your runs take {taken / MEGABYTE:.0f} MB of the {self._most / MEGABYTE:.0f} MB that each visitor has: "
                "delete some of them on the page Runs."
                if taken > self._most
                else ""
            )
        return self._sentence

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
