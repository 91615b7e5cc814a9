"""Visitors who wait for a lab: addresses take turns, and of one who came first, as long as their page looks again."""

import time
from collections import Counter
from collections.abc import Callable

from flexlab.server.labs.lab_provider import FullError

LOOK_AGAIN = 5
"""s between two looks of a page that waits."""
PATIENCE = 6.0 * LOOK_AGAIN
"""s without a look after which a visitor has left."""
MOST_WAITING, MOST_OF_ADDRESS = 200, 50
"""Visitors who wait at once, in all and of one address: more than a room holds."""


class WaitingLine:
    """Who waits, in order. For the server's event loop only."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._seen: dict[str, tuple[float, str]] = {}
        """Visitor → when their page looked last, and from which address."""

    def __len__(self) -> int:
        self._forget_who_left()
        return len(self._seen)

    def place(self, visitor: str, free: int, address: str = "") -> int:
        """0 if it is the visitor's turn, with `free` labs to be had; else their place in the line, from 1.

        Raises `FullError` if the line takes no more.
        """
        self._forget_who_left()
        if visitor not in self._seen and len(self._seen) >= free:
            same = sum(other == address for _, other in self._seen.values())
            if same >= MOST_OF_ADDRESS:
                raise FullError(f"No lab is free, and {same} others from your address wait for one. Come back later.")
            if len(self._seen) >= MOST_WAITING:
                raise FullError(f"No lab is free, and {MOST_WAITING} others wait for one. Come back later.")
        self._seen[visitor] = self._clock(), address
        ahead = self._order().index(visitor)
        if ahead < free:
            self.leave(visitor)
            return 0
        return ahead + 1

    def _order(self) -> list[str]:
        """First the first of each address, then the second of each: whoever makes up many visitors comes no sooner."""
        turns: Counter[str] = Counter()
        ranks: dict[str, int] = {}
        for visitor, (_, address) in self._seen.items():
            ranks[visitor] = turns[address]
            turns[address] += 1
        return sorted(ranks, key=lambda visitor: ranks[visitor])

    def leave(self, visitor: str) -> None:
        """A visitor waits no longer."""
        self._seen.pop(visitor, None)

    def _forget_who_left(self) -> None:
        now = self._clock()
        self._seen = {visitor: seen for visitor, seen in self._seen.items() if now - seen[0] <= PATIENCE}
