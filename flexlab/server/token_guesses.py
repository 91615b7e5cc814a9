"""Slows down who tries tokens: each address gets few wrong ones at once, then one a while; the right one soon passes."""

import asyncio
import time
from collections import OrderedDict

FREE = 10.0
"""Wrong tokens of one address that are answered at once: somebody who mistypes."""
SPACING = 0.5
"""s between two later answers."""
MOST_PENDING, MOST_HELD = 8, 64
"""Answers that are held back at once, of one address and of all. An address that asks more is not even compared; where all
together do, answers come at once, so that nobody is locked out by others."""
MOST_ADDRESSES = 10_000
"""Addresses that are remembered: the one that guessed longest ago is forgotten first."""


class Guesses:
    """The wrong tokens of all addresses of one server. For its event loop only."""

    def __init__(self) -> None:
        self._due: OrderedDict[str, float] = OrderedDict()
        """Address → when the answer to its last wrong token is due."""
        self._held = 0

    def is_flooding(self, address: str) -> bool:
        """Whether so many guesses of this address are open that no further one is looked at."""
        return self._due.get(address, 0.0) - time.monotonic() > (MOST_PENDING - 1) * SPACING

    async def slow_down(self, address: str) -> None:
        """Hold back the answer to a wrong token: for `SPACING` times `MOST_PENDING` s at most."""
        now = time.monotonic()
        due = max(self._due.get(address, 0.0), now - FREE * SPACING) + SPACING
        self._due[address] = due
        self._due.move_to_end(address)
        while len(self._due) > MOST_ADDRESSES:
            self._due.popitem(last=False)
        if due <= now or self._held >= MOST_HELD:
            return
        self._held += 1
        try:
            await asyncio.sleep(due - now)
        finally:
            self._held -= 1
