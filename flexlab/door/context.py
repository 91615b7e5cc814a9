"""What the pages of one door share."""

from dataclasses import dataclass
from pathlib import Path

import aiohttp
from aiohttp import web

from flexlab.door.comparisons import Comparisons
from flexlab.door.errands import Errands
from flexlab.door.measuring import Measuring
from flexlab.door.places import Places
from flexlab.door.replays import Replays
from flexlab.door.settings import Settings


@dataclass(frozen=True)
class Context:
    """One door."""

    settings: Settings
    port: int
    """The public one, really taken."""
    token: str | None
    places: Places
    inside: aiohttp.ClientSession
    """Calls to the labs on loopback."""
    measuring: Measuring
    errands: Errands
    comparisons: Comparisons
    replays: Replays
    workshop: Path
    """A folder for files that nobody keeps; gone when the door closes."""

    @property
    def token_cookie(self) -> str:
        """Browsers keep cookies by host, not by port: two doors of one machine must not sign each other out."""
        return f"flexlab-token-{self.port}"

    @property
    def visitor_cookie(self) -> str:
        """Who comes back to which private lab."""
        return f"flexlab-visitor-{self.port}"


CONTEXT = web.AppKey("context", Context)


def context_of(request: web.Request) -> Context:
    """The door that a request came to."""
    return request.app[CONTEXT]
