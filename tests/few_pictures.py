"""Labs that send only as many pictures as a page of the tests draws."""

from typing import Any

import pytest
from browser_window import PAUSE

from flexlab.lab import session


def send_few(patch: pytest.MonkeyPatch) -> None:
    """Let the labs of this process do so."""
    patch.setattr(session, "FRAME_TIME", PAUSE / 1000)
    patch.setattr(session, "READOUT_EVERY", 1)
    patch.setattr(session, "SELDOM", 4)  # Once a second, as usual.


def work(*what: Any) -> None:
    """What the process of a private lab runs, with few pictures."""
    from flexlab.server.labs import worker  # In the lab's own process, where nothing is replaced.

    send_few(pytest.MonkeyPatch())
    worker.work(*what)
