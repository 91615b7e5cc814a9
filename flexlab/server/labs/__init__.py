"""What the server's pages need of labs, whether all visitors share one or each has their own.

Visitors who wait for a lab stand in a line: addresses take turns, and each address is served in order of arrival.
"""

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from flexlab.errors import LabError
from flexlab.guide import ClassRules, LessonProgress
from flexlab.recording.live import LiveHub
from flexlab.scenario import Scenario
from flexlab.server.limits import Visitor
from flexlab.sim.commands import Pause, Play
from flexlab.sim.samples import Origin

LOOK_AGAIN = 5
"""Seconds between two requests of a waiting page."""
PATIENCE = 6.0 * LOOK_AGAIN
"""Seconds without a request after which a visitor counts as having left the line."""
MOST_WAITING, MOST_OF_ADDRESS = 200, 50
"""Most visitors who wait at once, in all and of one address: more than a room holds."""


@dataclass(frozen=True)
class Choice:
    """A scenario that a visitor wants to see."""

    scenario: Scenario
    name: str
    origin: Origin | None = None
    """The instant of an earlier run from which it continues; None for the scenario's own start."""
    stands: bool = False
    """Whether the run waits until the visitor presses Play; else it begins when their page is drawn."""


Request = Choice | Play | Pause | ClassRules
"""What the teacher may ask of a lab: to show a scenario, to resume or pause, or to follow rules."""


@dataclass(frozen=True)
class LabStatus:
    """The state of a running lab, as other people may see it."""

    name: str
    """The preset, or file, that its scenario came from."""
    title: str
    time: float
    """Simulated time, s."""
    state: str
    """One word: starting, running, paused, stopped."""
    link: str
    """The scenario as a word for a link."""
    recording: Path | None
    """The recording being written."""
    problem: str
    """Why nothing is being recorded, as a sentence; empty while all is well."""
    error: float = 0.0
    """Distance of the payload from its desired position, m."""
    lesson: str = ""
    """The open lesson and its progress; empty if there is none."""
    lessons: tuple[LessonProgress, ...] = ()
    """Progress in each lesson that was opened."""


class FullError(LabError):
    """All private labs that this machine may have are taken."""

    def __init__(self, sentence: str, place: int = 0):
        """`place`: the visitor's place in the line, from 1; 0 if they are not in it."""
        super().__init__(sentence)
        self.place = place


@dataclass(frozen=True)
class Order:
    """The settings with which a lab is opened."""

    choice: Choice
    logs: Path
    address: str
    """The server's address, for links that open a scenario."""
    shadows: bool = True
    live: bool = False
    """Whether the lab's data are served live."""
    secret: str = ""
    """The secret that every request to the lab's own port must carry."""
    owner: str = ""
    """The mark of the visitor's runs; empty if they belong to nobody."""
    visitor: str = ""
    """The visitor's name."""
    quota: float | None = None
    """Most bytes of the owner's runs; None for no bound."""
    own_files: dict[str, str] = field(default_factory=dict[str, str])
    """Laws and paths in Python that may run, as `hosts.allowed` returns them."""
    lesson: str = ""
    """The lesson that was open in the visitor's lab before, as in `LabStatus`."""
    lessons: tuple[LessonProgress, ...] = ()
    """Progress in that lab."""


class Lab:
    """One running lab behind the server."""

    number = 1
    """Its number among all labs of this server, from 1; it never changes."""
    path = "/lab"
    """Its address for visitors: `/lab` or `/s/<id>`."""
    name = ""
    """Its visitor's name; empty if unknown."""
    owner = ""
    """The mark of its visitor's runs; empty if they belong to nobody."""
    visitors = 0
    """The number of its open pages."""
    secret = ""
    """The secret that every request to its own server must carry."""
    live: LiveHub | None = None
    """Its live data, if they are served."""
    port: int = 0
    """Port of its own server on loopback; 0 until it listens."""

    _status: LabStatus
    """The last report of a lab in another process; before the first one, what it is about to show."""

    def status(self) -> LabStatus:
        """Its present state, as far as is known."""
        return self._status

    async def ask(self, what: Request) -> None:
        """Carry out the teacher's request."""
        raise NotImplementedError


def state_of(place: Lab) -> str:
    """The state of a lab in a word: "waiting" if its run begins only when somebody opens it."""
    status = place.status()
    waits = status.state == "running" and not status.time and not place.visitors
    return "waiting" if waits else status.state


class LabProvider:
    """All labs of one server. All methods but `close` are called on the server's event loop."""

    is_private = False
    """Whether each visitor has a private lab."""

    def __init__(self) -> None:
        self.rules = ClassRules()
        """The teacher's rules for all labs."""

    async def enter(self, visitor: Visitor, choice: Choice | None) -> Lab:
        """Return the visitor's lab, opened if need be, with their choice. Raises `FullError` or another `LabError`."""
        raise NotImplementedError

    def of_visitor(self, visitor: str) -> Lab | None:
        """The running lab of a visitor, if there is one."""
        return None

    def has_room_for(self, visitor: Visitor) -> bool:
        """Whether the visitor's address may have a lab for them."""
        return True

    def ended(self, visitor: str, lab: str) -> str:
        """Return why a visitor's lab ended, as a sentence; empty if there never was one."""
        return ""

    async def rule(self, rules: ClassRules) -> None:
        """Apply rules to all labs, including those opened later."""
        self.rules = rules
        await asyncio.gather(*(lab.ask(rules) for lab in self.running()))

    def call(self, visitor: Visitor) -> None:
        """Take a visitor's new name."""

    def left(self, place: Lab) -> None:
        """Note that a page of this lab was closed."""

    def running(self) -> Sequence[Lab]:
        """All running labs."""
        raise NotImplementedError

    async def close(self) -> Path | None:
        """End all labs; returns the newest recording."""
        return None


class WaitingLine:
    """The waiting visitors, in order. For the server's event loop only."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._seen: dict[str, tuple[float, str]] = {}
        """Visitor → time and address of their page's last request."""

    def __len__(self) -> int:
        self._forget_who_left()
        return len(self._seen)

    def place(self, visitor: str, free: int, address: str = "") -> int:
        """Return 0 if it is the visitor's turn for one of `free` labs, else their place in the line, from 1.

        Raises `FullError` if the line is full.
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
        """The first visitor of each address, then the second of each, so that inventing many visitors gains nothing."""
        turns: Counter[str] = Counter()
        ranks: dict[str, int] = {}
        for visitor, (_, address) in self._seen.items():
            ranks[visitor] = turns[address]
            turns[address] += 1
        return sorted(ranks, key=lambda visitor: ranks[visitor])

    def leave(self, visitor: str) -> None:
        """Take a visitor out of the line."""
        self._seen.pop(visitor, None)

    def _forget_who_left(self) -> None:
        now = self._clock()
        self._seen = {visitor: seen for visitor, seen in self._seen.items() if now - seen[0] <= PATIENCE}
