"""What the pages of one server share."""

from dataclasses import dataclass, field
from pathlib import Path

import aiohttp
from aiohttp import web

from flexlab.server.comparison_jobs import Comparisons
from flexlab.server.jobs import Jobs
from flexlab.server.labs.lab_provider import LabProvider
from flexlab.server.leaderboard_jobs import Boards
from flexlab.server.metric_jobs import Measuring
from flexlab.server.preset_cards import PresetCards
from flexlab.server.replay_jobs import Replays
from flexlab.server.settings import Settings
from flexlab.server.studies import Studies
from flexlab.server.token_guesses import Guesses


@dataclass(frozen=True)
class Context:
    """One server."""

    settings: Settings
    port: int
    """The public one, really taken."""
    token: str | None
    places: LabProvider
    inside: aiohttp.ClientSession
    """Calls to the labs on loopback."""
    measuring: Measuring
    jobs: Jobs
    comparisons: Comparisons
    replays: Replays
    studies: Studies
    workshop: Path
    """A folder for files that nobody keeps; gone when the server closes."""
    preset_cards: PresetCards
    boards: Boards
    guesses: Guesses = field(default_factory=Guesses)
    """Wrong tokens of late."""
    watchers: list[web.Request] = field(default_factory=list[web.Request])
    """Requests for live data that are being answered."""

    @property
    def token_cookie(self) -> str:
        """Browsers keep cookies by host, not by port: two server of one machine must not sign each other out."""
        return f"flexlab-token-{self.port}"

    @property
    def visitor_cookie(self) -> str:
        """Who comes back to which private lab."""
        return f"flexlab-visitor-{self.port}"


CONTEXT = web.AppKey("context", Context)


def context_of(request: web.Request) -> Context:
    """The server that a request came to."""
    return request.app[CONTEXT]
