"""How tests wait: for what is to come true, never for a time."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE = 60.0
"""Wall seconds that anything may take on a busy machine; no test passes or fails by speed."""
ARTIFACTS = Path(__file__).parents[1] / ".artifacts"
"""Screenshots for people to look at."""


def wait_until(look: Callable[[], Any], what: str, patience: float = PATIENCE) -> Any:
    """Look until there is something true and return it; fails naming `what` and what was there last."""
    deadline = time.monotonic() + patience
    while True:
        found = look()
        if found:
            return found
        assert time.monotonic() < deadline, f"waited {patience:g} s in vain for: {what} (last: {found!r})"
        time.sleep(0.02)
