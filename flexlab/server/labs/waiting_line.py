"""Visitors who wait for a lab: first come, first served, as long as their page looks again."""

import time
from collections.abc import Callable

from flexlab.server.labs.lab_provider import FullError

LOOK_AGAIN = 5
"""s between two looks of a page that waits."""
PATIENCE = 6.0 * LOOK_AGAIN
"""s without a look after which a visitor has left."""
MOST_WAITING = 200
"""Visitors who wait at once: more than a room holds."""


class WaitingLine:
    """Who waits, in order. For the server's event loop only."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._seen: dict[str, float] = {}

    def __len__(self) -> int:
        self._forget_who_left()
        return len(self._seen)

    def place(self, visitor: str, free: int) -> int:
        """0 if it is the visitor's turn, with `free` labs to be had; else their place in the line, from 1.

        Raises `FullError` if the line takes no more.
        """
        self._forget_who_left()
        order = list(self._seen)
        ahead = order.index(visitor) if visitor in self._seen else len(order)
        if ahead < free:
            self.leave(visitor)
            return 0
        if visitor not in self._seen and len(order) >= MOST_WAITING:
            raise FullError(f"No lab is free, and {MOST_WAITING} others wait for one. Come back later.")
        self._seen[visitor] = self._clock()
        return ahead + 1

    def leave(self, visitor: str) -> None:
        """A visitor waits no longer."""
        self._seen.pop(visitor, None)

    def _forget_who_left(self) -> None:
        now = self._clock()
        self._seen = {visitor: at for visitor, at in self._seen.items() if now - at <= PATIENCE}
