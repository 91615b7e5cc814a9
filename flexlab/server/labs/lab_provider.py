"""What the server's pages need of labs, whether all visitors share one or each has their own.

Visitors who wait for a lab stand in a line: addresses take turns, and within one address the first comes first.
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
from flexlab.sim.samples import Origin

LOOK_AGAIN = 5
"""Seconds between two requests of a page that waits."""
PATIENCE = 6.0 * LOOK_AGAIN
"""Seconds without a request after which a visitor has left the line."""
MOST_WAITING, MOST_OF_ADDRESS = 200, 50
"""Visitors who wait at once, in all and of one address: more than a room holds."""


@dataclass(frozen=True)
class Choice:
    """A scenario that a visitor wants to see."""

    scenario: Scenario
    name: str
    origin: Origin | None = None
    """The instant of an earlier run from which it continues; None: the scenario's own start."""
    stands: bool = False
    """Whether the run waits for the visitor to press Play; else it begins when their page is drawn."""


@dataclass(frozen=True)
class Hold:
    """The teacher's request to pause a lab, or to resume it."""

    playing: bool


@dataclass(frozen=True)
class LabStatus:
    """The state of a running lab, as other people may see it."""

    name: str
    """The preset, or file, that its scenario came from."""
    title: str
    time: float
    """Simulated, s."""
    state: str
    """One word: starting, running, paused, stopped."""
    link: str
    """The scenario as a word for a link."""
    recording: Path | None
    """The file being written."""
    problem: str
    """Why nothing is being recorded, as a sentence; empty while all is well."""
    error: float = 0.0
    """Distance of the payload from where it should be, m."""
    lesson: str = ""
    """The open lesson and its progress; empty: none."""
    lessons: tuple[LessonProgress, ...] = ()
    """Progress in each lesson that was opened."""


class FullError(LabError):
    """All private labs that this machine may have are taken."""

    def __init__(self, sentence: str, place: int = 0):
        """`place`: of the visitor among those who wait, from 1; 0: they do not wait, and need not."""
        super().__init__(sentence)
        self.place = place


@dataclass(frozen=True)
class Order:
    """What a lab is opened with."""

    choice: Choice
    logs: Path
    address: str
    """The server's address, for links that open a scenario."""
    shadows: bool = True
    live: bool = False
    """Whether its data are served live."""
    secret: str = ""
    """The word without which the lab's own port answers nobody."""
    owner: str = ""
    """Marks its visitor's runs; empty: they belong to nobody."""
    visitor: str = ""
    """What the visitor is called."""
    quota: float | None = None
    """Bytes that the owner's runs may take; None: any number."""
    own_files: dict[str, str] = field(default_factory=dict[str, str])
    """Laws and paths in Python that may run: `hosts.allowed`."""


class Lab:
    """One running lab behind the server."""

    number = 1
    """Among all labs of this server, from 1; it never changes."""
    path = "/lab"
    """Where visitors find it: `/lab` or `/s/<id>`."""
    name = ""
    """What its visitor is called; empty: not known."""
    owner = ""
    """The mark of its visitor's runs; empty: they belong to nobody."""
    visitors = 0
    """Open pages."""
    secret = ""
    """The word without which its own server answers nobody."""
    live: LiveHub | None = None
    """Its live data, if they are served."""
    port: int = 0
    """Port of its own server on loopback; 0 until it listens."""

    def status(self) -> LabStatus:
        """Its present state."""
        raise NotImplementedError

    async def ask(self, what: Choice | Hold | ClassRules) -> None:
        """The teacher has it show a scenario, pause, resume, or follow rules."""
        raise NotImplementedError


def state_of(place: Lab) -> str:
    """The state of a lab in a word: one that begins when somebody looks is waiting for them."""
    status = place.status()
    waits = status.state == "running" and not status.time and not place.visitors
    return "waiting" if waits else status.state


class LabProvider:
    """All labs of one server. Everything but `close` is called on the server's event loop."""

    is_private = False
    """Whether each visitor has a lab of their own."""

    def __init__(self) -> None:
        self.rules = ClassRules()
        """The teacher's rules for all labs."""

    async def enter(self, visitor: str, choice: Choice | None, address: str = "", name: str = "") -> Lab:
        """The visitor's lab, opened if need be, with what they chose. Raises `FullError` or another `LabError`.

        `address`: where the visitor comes from; `name`: what they are called.
        """
        raise NotImplementedError

    def of_visitor(self, visitor: str) -> Lab | None:
        """The running lab of a visitor, if there is one."""
        return None

    def ended(self, visitor: str, lab: str) -> str:
        """Why a visitor's lab ended, as a sentence; empty if there never was one."""
        return ""

    async def rule(self, rules: ClassRules) -> None:
        """Apply rules to all labs, also to those opened later."""
        self.rules = rules
        await asyncio.gather(*(lab.ask(rules) for lab in self.running()))

    def call(self, visitor: str, name: str) -> None:
        """A visitor has a new name."""

    def left(self, place: Lab) -> None:
        """A page of this lab was closed."""

    def running(self) -> Sequence[Lab]:
        """All running labs."""
        raise NotImplementedError

    async def close(self) -> Path | None:
        """End all labs; returns the newest recording."""
        return None


class WaitingLine:
    """Who waits, in order. For the server's event loop only."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._seen: dict[str, tuple[float, str]] = {}
        """Visitor → time and address of their page's last request."""

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
