"""What the server's pages ask of labs, whether all visitors share one or each has their own."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from flexlab.errors import LabError
from flexlab.recording.live import LiveHub
from flexlab.scenario import Scenario
from flexlab.sim.world_state import Origin


@dataclass(frozen=True)
class Choice:
    """A scenario that a visitor wants to see."""

    scenario: Scenario
    name: str
    origin: Origin | None = None
    """Where in an earlier run it goes on; None: at the scenario's own start."""
    stands: bool = False
    """Whether the run stands until the visitor lets it play; else it begins when their page is drawn."""


@dataclass(frozen=True)
class Hold:
    """What the teacher asks of a lab: to pause, or to go on."""

    playing: bool


@dataclass(frozen=True)
class LabStatus:
    """What others may know of a running lab."""

    name: str
    """The preset, or file, that its scenario came from."""
    title: str
    time: float
    """Simulated, s."""
    state: str
    """In a word or two: running, paused, stopped."""
    link: str
    """The scenario as a word for a link."""
    recording: Path | None
    """The file being written."""
    problem: str
    """Why nothing is being recorded, as a sentence; empty while all is well."""
    error: float = 0.0
    """Distance of the payload from where it should be, m."""
    lesson: str = ""
    """The lesson that is open, and how far it is; empty: none."""


class FullError(LabError):
    """All private labs that this machine may have are taken."""

    def __init__(self, sentence: str, place: int = 0):
        """`place`: of the visitor among those who wait, from 1; 0: they do not wait, and need not."""
        super().__init__(sentence)
        self.place = place


class Lab(Protocol):
    """One running lab behind the server."""

    path: str
    """Where visitors find it: `/lab` or `/s/<id>`."""
    visitors: int
    """Open pages; whoever relays a page counts."""
    name: str
    """What its visitor is called; empty: not said."""

    @property
    def port(self) -> int:
        """Of its own server on loopback."""
        ...

    @property
    def secret(self) -> str:
        """The word without which that server answers nobody."""
        ...

    @property
    def live(self) -> LiveHub | None:
        """Its live data, if they are served."""
        ...

    def status(self) -> LabStatus:
        """How it stands."""
        ...


def state_of(place: Lab) -> str:
    """How a lab stands, in a word: one that begins when somebody looks is waiting for them."""
    status = place.status()
    waits = status.state == "running" and not status.time and not place.visitors
    return "waiting" if waits else status.state


class LabProvider(Protocol):
    """All labs of one server. Everything but `close` is called on the server's event loop."""

    is_private: bool

    async def enter(self, visitor: str, choice: Choice | None, address: str = "", name: str = "") -> Lab:
        """The lab of a visitor, made if need be, with what they chose. Raises `FullError` or another `LabError`.

        `address`: where the visitor comes from; `name`: what they are called.
        """
        ...

    def of_visitor(self, visitor: str) -> Lab | None:
        """The running lab of a visitor, if there is one."""
        ...

    def ended(self, visitor: str, lab: str) -> str:
        """Why a visitor's lab is no more, as a sentence; empty if it never was."""
        ...

    async def ask(self, place: Lab, what: Choice | Hold) -> None:
        """Have a lab show a scenario, pause or go on, as the teacher wishes."""
        ...

    def call(self, visitor: str, name: str) -> None:
        """A visitor is called so from now on."""
        ...

    def left(self, place: Lab) -> None:
        """A page of this place was closed."""

    def running(self) -> list[Lab]:
        """All of them."""
        ...

    async def close(self) -> Path | None:
        """End all; returns the newest recording."""
        ...


Complain = Callable[[str], None]
"""Tells the person at the terminal a sentence."""
