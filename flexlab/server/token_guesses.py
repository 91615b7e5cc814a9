"""Slows down who tries tokens: each address gets few wrong ones at once, then one a while; the right one soon passes."""

import asyncio
import time
from collections import Counter, OrderedDict

FREE = 10.0
"""Wrong tokens of one address that are answered at once: somebody who mistypes."""
SPACING = 0.5
"""s between two later answers."""
MOST_PENDING, MOST_HELD = 8, 64
"""Answers that are held back at once, of one address and of all; whoever asks more is not even compared."""
MOST_ADDRESSES = 10_000
"""Addresses that are remembered: the one that guessed longest ago is forgotten first."""


class Guesses:
    """The wrong tokens of all addresses of one server. For its event loop only."""

    def __init__(self) -> None:
        self._next: OrderedDict[str, float] = OrderedDict()
        self._pending: Counter[str] = Counter()

    def is_flooding(self, address: str) -> bool:
        """Whether this address, or all of them, have so many guesses open that no further one is looked at."""
        return self._pending[address] >= MOST_PENDING or self._pending.total() >= MOST_HELD

    async def slow_down(self, address: str) -> None:
        """Hold back the answer to a wrong token: for `SPACING` times `MOST_PENDING` s at most."""
        now = time.monotonic()
        due = max(self._next.get(address, 0.0), now - FREE * SPACING) + SPACING
        self._next[address] = due
        self._next.move_to_end(address)
        while len(self._next) > MOST_ADDRESSES:
            self._next.popitem(last=False)
        if due <= now:
            return
        self._pending[address] += 1
        try:
            await asyncio.sleep(due - now)
        finally:
            self._pending[address] -= 1
            if not self._pending[address]:
                del self._pending[address]
