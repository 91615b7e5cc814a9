"""Waiting in tests: for a condition, never for a fixed time."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE = 180.0
"""Timeout for anything, s of wall time: generous, as the machine may be busy; it is no measure of speed."""
ARTIFACTS = Path(__file__).parents[1] / ".artifacts"
"""Screenshots for people to look at."""
SHORTEST, LONGEST, SHARE = 0.02, 0.2, 0.1
"""Pause between two looks, s: SHARE of the time waited so far, from SHORTEST to LONGEST, as many looks would cost too much."""


def wait_until(look: Callable[[], Any], what: str, patience: float = PATIENCE, pause: float = 0.0) -> Any:
    """Call `look` until it returns something true, and return that; else fail with `what`. `pause`: time between calls, s."""
    begun = time.monotonic()
    while True:
        found = look()
        if found:
            return found
        waited = time.monotonic() - begun
        assert waited < patience, f"waited {patience:g} s in vain for: {what} (last: {found!r})"
        time.sleep(pause or min(max(SHARE * waited, SHORTEST), LONGEST))
