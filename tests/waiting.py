"""How tests wait: for what is to come true, never for a time."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE = 180.0
"""Wall seconds that anything may take on a busy machine; no test passes or fails by speed."""
ARTIFACTS = Path(__file__).parents[1] / ".artifacts"
"""Screenshots for people to look at."""
SHORTEST, LONGEST, SHARE = 0.02, 0.2, 0.1
"""s between two looks, of which many cost more than what is waited for: that share of the time waited so far, within limits."""


def wait_until(look: Callable[[], Any], what: str, patience: float = PATIENCE, pause: float = 0.0) -> Any:
    """Look until there is something true and return it; fails naming `what` and what was there last. `pause`: s between looks."""
    begun = time.monotonic()
    while True:
        found = look()
        if found:
            return found
        waited = time.monotonic() - begun
        assert waited < patience, f"waited {patience:g} s in vain for: {what} (last: {found!r})"
        time.sleep(pause or min(max(SHARE * waited, SHORTEST), LONGEST))
