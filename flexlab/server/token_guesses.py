"""Slows down who tries tokens: each address gets few wrong ones at once, then one a while; the right one always passes."""

import asyncio
import time

FREE = 10.0
"""Wrong tokens of one address that are answered at once: somebody who mistypes."""
SPACING = 0.5
"""s between two later answers."""
MOST_PENDING = 8
"""Answers of one address that are held back at once; whoever asks more is not even compared."""
MOST_ADDRESSES = 10_000
"""Addresses that are remembered."""


class Guesses:
    """The wrong tokens of all addresses of one server. For its event loop only."""

    def __init__(self) -> None:
        self._next: dict[str, float] = {}
        self._pending: dict[str, int] = {}

    def is_flooding(self, address: str) -> bool:
        """Whether this address has so many guesses open that no further one is looked at."""
        return self._pending.get(address, 0) >= MOST_PENDING

    async def slow_down(self, address: str) -> None:
        """Hold back the answer to a wrong token."""
        now = time.monotonic()
        if len(self._next) >= MOST_ADDRESSES:
            self._next = {known: at for known, at in self._next.items() if at > now}
        due = max(self._next.get(address, 0.0), now - FREE * SPACING) + SPACING
        self._next[address] = due
        if due <= now:
            return
        self._pending[address] = self._pending.get(address, 0) + 1
        try:
            await asyncio.sleep(due - now)
        finally:
            self._pending[address] -= 1
            if not self._pending[address]:
                del self._pending[address]
