"""A lab for each visitor in its own process: it is closed when nobody looks, and its crash touches no other."""

import asyncio
import contextlib
import itertools
import logging
import time
from collections import OrderedDict
from collections.abc import Coroutine, Sequence
from dataclasses import replace
from operator import methodcaller
from pathlib import Path
from typing import Any

from flexlab.errors import FlexlabError, LabError
from flexlab.guide import ClassRules, LessonProgress
from flexlab.own import hosts
from flexlab.recording.repair import finish, finish_abandoned
from flexlab.recording.store.run_index import last_lessons
from flexlab.server.labs import LOOK_AGAIN, Choice, FullError, Lab, LabProvider, LabStatus, Order, WaitingLine
from flexlab.server.labs.worker import STOP_TIME, PrivateLab
from flexlab.server.limits import Visitor
from flexlab.server.settings import Settings, secret_word
from flexlab.server.tasks import prepare_lab_processes

ENDED_KEPT = 500
"""Most labs whose end is remembered for visitors who come back."""
ROUNDS_PER_IDLE_TIME = 5
"""Checks for labs that nobody watches, per idle time."""
LONGEST_ROUND = 1.0
"""Longest time between two such checks, s."""
SILENCE = 8.0
"""Seconds without a report after which a lab counts as hanging, and its visitor may open a new one."""
LAST_CHANCE = 7.0
"""Seconds that a hanging lab then gets to close its run before it is killed."""

SILENT_AT_CLOSING, GOODBYE = 3.0, 1.0
"""Seconds without a report after which a closing server waits only `GOODBYE` s for a lab."""

CRASHED = (
    "This lab ended unexpectedly ({reason}). Everybody else's lab runs on, and your run was kept up to that moment."
)
IDLE = "This lab was closed after {time} without a visitor. Its run was kept."
HANGING = "This lab stopped answering and was closed. Everybody else's lab runs on, and your run was kept."
CLOSED = "This lab was closed. Its run was kept."

log = logging.getLogger(__name__)


class PrivateLabs(LabProvider):
    """All private labs of one server."""

    is_private = True

    def __init__(self, settings: Settings, order: Order):
        """`order`: settings of the lab of a visitor who chose nothing."""
        super().__init__()
        prepare_lab_processes()
        self._settings, self._order = settings, order
        self._numbers = itertools.count(1)
        self._places: dict[str, PrivateLab] = {}
        self._opening: dict[str, asyncio.Future[PrivateLab]] = {}
        self._ended: OrderedDict[str, tuple[str, str, LabStatus]] = OrderedDict()
        self._addresses: dict[str, str] = {}
        self._line = WaitingLine()
        self._watch: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._last: Path | None = None

    async def enter(self, visitor: Visitor, choice: Choice | None) -> Lab:
        """Return the visitor's lab. Raises `FullError` when no lab is free; the visitor then waits for their turn."""
        opening = self._opening.get(visitor.id)
        place = self.of_visitor(visitor.id) if opening is None else await asyncio.shield(opening)
        if place is None:
            # Before any await, so that simultaneous visitors are counted one by one.
            self._admit(visitor)
            # Two pages that one visitor opens at once share the lab that the first one starts.
            opening = asyncio.ensure_future(self._open(visitor, choice or self._order.choice))
            self._opening[visitor.id] = opening
            opening.add_done_callback(lambda _: self._opening.pop(visitor.id, None))
            return await asyncio.shield(opening)
        if choice is not None:
            await asyncio.to_thread(place.send, methodcaller("load", choice))
        return place

    def _admit(self, visitor: Visitor) -> None:
        """Raise `FullError`, with the visitor's place in the line, while there is no lab for them."""
        most = self._settings.max_sessions
        others = self._taken() - {visitor.id}
        place = self._line.place(visitor.id, most - len(others), visitor.address)
        if place:
            taken = f"No lab is free: {len(others)} of {most} are taken." if len(others) >= most else "A lab is free."
            raise FullError(
                f"{taken} You are number {place} of {len(self._line)} in line. This page tries again every "
                f"{LOOK_AGAIN} s and goes on by itself: a lab that nobody looks at is closed.",
                place,
            )
        if not self.has_room_for(visitor):
            most = self._settings.labs_per_address
            raise FullError(
                f"Your address has {most} of {most} labs that one address may have. Come back in a few minutes, or use the "
                "browser in which you opened one: a lab that nobody looks at is closed. Whoever runs this server can allow "
                "more (--max-per-address)."
            )
        self._addresses = {other: self._addresses.get(other, "") for other in others} | {visitor.id: visitor.address}

    def has_room_for(self, visitor: Visitor) -> bool:
        """Whether the visitor's address may have a lab for them, besides those of its other visitors."""
        others = self._taken() - {visitor.id}
        near = sum(self._addresses.get(other) == visitor.address for other in others)
        return near < self._settings.labs_per_address

    async def _open(self, visitor: Visitor, choice: Choice) -> PrivateLab:
        if self._watch is None:
            self._watch = asyncio.create_task(self._close_idle_ones())
        loop = asyncio.get_running_loop()
        lab = secret_word()

        def tell() -> None:
            with contextlib.suppress(RuntimeError):  # The server itself is closed already.
                loop.call_soon_threadsafe(self._over, lab)

        lesson, lessons = await asyncio.to_thread(self._lessons_before, visitor)
        order = replace(
            self._order,
            choice=choice,
            secret=secret_word(),
            owner=visitor.owner,
            visitor=visitor.name,
            own_files=hosts.allowed(),
            lesson=lesson,
            lessons=lessons,
        )
        try:
            place = await asyncio.to_thread(PrivateLab, next(self._numbers), lab, visitor.id, order, tell)
        except OSError as error:  # There is no handle, process or memory left.
            raise LabError(
                f"The lab cannot be opened ({error.strerror}): this machine has too much to do. Try again later."
            ) from None
        self._places[lab] = place
        try:
            place.port = await asyncio.to_thread(place.wait_until_ready)
        except LabError:
            self._places.pop(lab, None)
            await asyncio.to_thread(place.stop, STOP_TIME)
            raise
        place.seen = time.monotonic()
        if self.rules != ClassRules():
            await place.ask(self.rules)
        return place

    def call(self, visitor: Visitor) -> None:
        """Keep the visitor's next runs under a new name, also if the lab is only opening."""
        opening = self._opening.get(visitor.id)
        if opening is not None:
            opening.add_done_callback(lambda _: self.call(visitor))
        place = self.of_visitor(visitor.id)
        if place is not None and place.name != visitor.name:
            place.name = visitor.name
            self._keep(asyncio.to_thread(place.send, methodcaller("rename", visitor.name)))

    def of_visitor(self, visitor: str) -> PrivateLab | None:
        """The visitor's running lab."""
        mine = (place for place in self._places.values() if place.visitor == visitor and place.port and not place.why)
        return next(mine, None)

    def _lessons_before(self, visitor: Visitor) -> tuple[str, tuple[LessonProgress, ...]]:
        """The open lesson and the progress in the visitor's lab before, of this server or an earlier one."""
        ended = [status for owner, _, status in list(self._ended.values()) if owner == visitor.id]
        closing = [place.status() for place in list(self._places.values()) if place.visitor == visitor.id]
        for status in reversed([*ended, *closing]):
            return status.lesson, status.lessons
        return last_lessons(self._settings.logs, visitor.owner)

    def ended(self, visitor: str, lab: str) -> str:
        """Return why this visitor's lab has ended; empty for other people's labs and for unknown ones."""
        going = self._places.get(lab)
        owner, sentence = (going.visitor, going.why) if going is not None else self._ended.get(lab, ("", ""))[:2]
        return sentence if owner == visitor else ""

    def left(self, place: Lab) -> None:
        """Begin the lab's idle time when a page is closed."""
        if isinstance(place, PrivateLab):
            place.seen = time.monotonic()

    def running(self) -> Sequence[Lab]:
        """All private labs that are open."""
        return [place for place in self._places.values() if place.port]

    async def close(self) -> Path | None:
        """End all labs at once and return the newest recording."""
        if self._watch is not None:
            self._watch.cancel()
        places = list(self._places.values())
        for place in places:
            place.why = place.why or CLOSED
        now = time.monotonic()
        # A lab that has missed several reports hangs: closing need not wait for it.
        silent = [now - place.heard_at > SILENT_AT_CLOSING for place in places]
        patience = [GOODBYE if hangs else STOP_TIME for hangs in silent]
        stops = (asyncio.to_thread(place.stop, seconds) for place, seconds in zip(places, patience, strict=True))
        await asyncio.gather(*stops)
        await asyncio.gather(*self._tasks, return_exceptions=True)
        recordings = [place.status().recording for place in places]
        return max(filter(None, recordings), key=lambda path: path.name, default=self._last)

    def _taken(self) -> set[str]:
        """Visitors who have a lab or are getting one; a lab that is closing no longer counts."""
        return {place.visitor for place in self._places.values() if not place.why} | set(self._opening)

    async def _close_idle_ones(self) -> None:
        idle, looked = self._settings.idle_time, time.monotonic()
        while True:
            await asyncio.sleep(min(idle / ROUNDS_PER_IDLE_TIME, LONGEST_ROUND))
            before, looked = looked, time.monotonic()
            if looked - before > SILENCE / 2:
                continue  # The server itself was suspended and has not yet read the labs' reports.
            for place in list(self._places.values()):
                if place.port and not place.visitors and not place.why and time.monotonic() - place.seen > idle:
                    place.why = IDLE.format(time=f"{idle / 60:g} min" if idle >= 60 else f"{idle:g} s")
                    self._keep(asyncio.to_thread(place.stop, STOP_TIME))
                elif place.port and not place.why and time.monotonic() - place.heard_at > SILENCE:
                    log.warning("A private lab has said nothing for %g s: it is closed.", SILENCE)
                    place.why = HANGING
                    self._keep(asyncio.to_thread(place.stop, LAST_CHANCE))

    def _over(self, lab: str) -> None:
        """Note that a worker's process has ended, by request or by itself."""
        place = self._places.pop(lab, None)
        if place is None:
            return
        code, recording = place.process.exitcode, place.status().recording
        self._last = recording or self._last
        if not place.why:
            reason = f"ended by signal {-code}" if code is not None and code < 0 else f"exit code {code}"
            log.warning("A private lab ended unexpectedly (%s); its run is in %s.", reason, recording)
            place.why = CRASHED.format(reason=reason)
        self._keep(asyncio.to_thread(_mend, self._settings.logs, recording))
        self._ended[lab] = place.visitor, place.why, place.status()
        self._addresses = {visitor: self._addresses.get(visitor, "") for visitor in self._taken()}
        while len(self._ended) > ENDED_KEPT:
            self._ended.popitem(last=False)

    def _keep(self, work: Coroutine[Any, Any, None]) -> None:
        """Run work in the background. The task is stored, because an event loop drops tasks without a reference."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def _mend(logs: Path, recording: Path | None) -> None:
    """Finish the recordings of a worker that may have died while it wrote.

    Its last report names its run, but up to a second late: a run begun since then is found only in the folder.
    """
    if recording is not None:
        with contextlib.suppress(FlexlabError, OSError):
            finish(recording)
    finish_abandoned(logs)
