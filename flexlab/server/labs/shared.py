"""One lab for all visitors, in the server's own process."""

import asyncio
from pathlib import Path

from flexlab.lab.class_rules import ClassRules
from flexlab.recording.live import LiveHub
from flexlab.server.labs.lab_provider import Choice, Hold, Lab
from flexlab.server.labs.recorded_lab import LabStatus, RecordedLab


class SharedLab:
    """The lab at `/lab`."""

    def __init__(self, laboratory: RecordedLab, live: LiveHub | None):
        self._laboratory = laboratory
        self.live = live
        self.path = "/lab"
        self.visitors = 0
        self.name = ""
        self.number = 1

    @property
    def port(self) -> int:
        """Of its own server on loopback."""
        return self._laboratory.port

    @property
    def secret(self) -> str:
        """The word without which that server answers nobody."""
        return self._laboratory.secret

    def status(self) -> LabStatus:
        """How it stands."""
        return self._laboratory.status()


class SharedLabProvider:
    """All visitors look at, and move, the same arms."""

    is_private = False

    def __init__(self, laboratory: RecordedLab, live: LiveHub | None = None):
        self._laboratory = laboratory
        self.rules = ClassRules()
        self._place = SharedLab(laboratory, live)

    async def enter(self, visitor: str, choice: Choice | None, address: str = "", name: str = "") -> Lab:
        """The one lab, with what this visitor chose."""
        if choice is not None:
            self._laboratory.load(choice)
        return self._place

    def of_visitor(self, visitor: str) -> Lab | None:
        """The one lab."""
        return self._place

    def ended(self, visitor: str, lab: str) -> str:
        """It runs as long as the server does."""
        return ""

    async def ask(self, place: Lab, what: Choice | Hold) -> None:
        """The one lab follows."""
        self._laboratory.ask(what)

    async def rule(self, rules: ClassRules) -> None:
        """The one lab follows."""
        self.rules = rules
        self._laboratory.ask(rules)

    def call(self, visitor: str, name: str) -> None:
        """Nothing: the lab is everybody's."""

    def left(self, place: Lab) -> None:
        """Nothing: it waits for the next visitor."""

    def running(self) -> list[Lab]:
        """The one lab."""
        return [self._place]

    async def close(self) -> Path | None:
        """End it; returns its last recording."""
        if self._place.live is not None:
            self._place.live.close()
        return await asyncio.to_thread(self._laboratory.close)
