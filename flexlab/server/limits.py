"""Limits on each visitor: work at once, wrong tokens, and disk space for their runs."""

import asyncio
import contextlib
import hashlib
import ipaddress
import time
from collections import OrderedDict
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

from flexlab.errors import LabError
from flexlab.recording.rerun_internals.rrd_file import has_footer
from flexlab.recording.store.notes import notes_path
from flexlab.recording.store.people import owner_of
from flexlab.recording.store.run_files import list_runs
from flexlab.server.settings import MEGABYTE

HOUSEHOLD = 64
"""Bits of an IPv6 address that identify a network, such as a household's; a machine in it chooses the others freely."""
FREE = 10.0
"""Wrong tokens from one address that are answered without delay: people mistype."""
SPACING = 0.5
"""Seconds between two answers after those."""
MOST_PENDING, MOST_HELD = 8, 64
"""Most answers held back at once, for one address and for all. Beyond the first, an address's tokens are not even compared;
beyond the second, answers come without delay, so that nobody is locked out by others."""
MOST_ADDRESSES = 10_000
"""Most addresses remembered; the one that guessed longest ago is forgotten first."""
LOOK, LOOK_AGAIN = 5.0, 1.0
"""Seconds between two checks of the folder, usually and when more is asked for than was free at the last check."""
PER_SECOND = 0.6 * MEGABYTE
"""Approximate bytes of a simulated second of the paper's run."""
INDEX, INDEX_SHARE = 160_000, 0.01
"""The most that a recording grows when it is finished, bytes and share of its size: 136 kB and 0.5 kB per written block."""


class BusyError(LabError):
    """Too much of one kind is under way; the same request may succeed later."""


def network_of(address: str) -> str:
    """What counts as one address: for IPv6 the network, as one machine can have any number of addresses in it."""
    try:
        number = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(number, ipaddress.IPv4Address):
        return address
    mapped = number.ipv4_mapped
    return str(mapped or ipaddress.ip_network((int(number), HOUSEHOLD), strict=False))


@dataclass(frozen=True)
class Visitor:
    """The sender of a request."""

    id: str = ""
    """The secret in their cookie; empty without one."""
    address: str = ""
    """Their address, as `network_of` returns it."""
    is_teacher: bool = False
    """Whether they may do everything: they have the teacher's token, or there is none."""
    name: str = ""
    """Their name; empty if they gave none."""

    @property
    def person(self) -> str:
        """Identifies a visitor: by their cookie, else by their address."""
        return self.id or self.address

    @property
    def owner(self) -> str:
        """The mark of their runs in the notes, which does not reveal the id; empty without one."""
        return (
            hashlib.sha256(f"flexlab run of {self.id}".encode("utf-8", "replace")).hexdigest()[:32] if self.id else ""
        )


THE_SERVER = Visitor(is_teacher=True)
"""The server itself, for its own work."""


class Limit:
    """Bounds how many things of one kind there are at once. For the server's event loop only."""

    def __init__(self, what: str, of_one: int, of_address: int, of_all: int, for_teacher: int):
        """`what`: the things' name, plural. `for_teacher`: places beyond `of_all` for the teacher, who has no other bound."""
        self._what, self._of_one, self._of_address, self._of_all = what, of_one, of_address, of_all
        self._for_teacher = for_teacher
        self._taken: list[Visitor] = []

    def check(self, asker: Visitor) -> None:
        """Raise `BusyError` if this asker gets no place now."""
        if asker.is_teacher:
            bounds = [("This server has", len(self._taken), self._of_all + self._for_teacher)]
        else:
            mine = sum(other.id == asker.id for other in self._taken)
            near = sum(other.address == asker.address for other in self._taken)
            # Many visitors without a cookie may share an address, so only their address bounds them.
            bounds = [
                ("You have", mine if asker.id else 0, self._of_one),
                ("Your address has", near, self._of_address),
                ("This server has", len(self._taken), self._of_all),
            ]
        for who, taken, most in bounds:
            if taken >= most:
                raise BusyError(
                    f"{who} {taken} {self._what} already, and may have {most}: try again when one has ended."
                )

    @contextlib.contextmanager
    def place(self, asker: Visitor) -> Generator[None]:
        """Hold one of the places. Raises `BusyError` if there is none for this asker."""
        self.check(asker)
        self._taken.append(asker)
        try:
            yield
        finally:
            self._taken.remove(asker)


class Guesses:
    """The wrong tokens of all addresses of one server. For its event loop only."""

    def __init__(self) -> None:
        self._due: OrderedDict[str, float] = OrderedDict()
        """Address → when the answer to its last wrong token is due."""
        self._held = 0

    def is_flooding(self, address: str) -> bool:
        """Whether so many guesses of this address await their answers that its next token is not even compared."""
        return self._due.get(address, 0.0) - time.monotonic() > (MOST_PENDING - 1) * SPACING

    async def slow_down(self, address: str) -> None:
        """Hold back the answer to a wrong token, for `SPACING` times `MOST_PENDING` s at most."""
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


def for_teacher(problem: str) -> str:
    """Reword for the teacher why a visitor's lab does not record: a quota's advice is meant for the visitor."""
    taken, of_visitor, _ = problem.partition(" that each visitor has")
    if not of_visitor:
        return problem
    return f"{taken.replace('Your', 'Their', 1)}{of_visitor}: nothing more is recorded until some are deleted."


class Quota:
    """Bounds the disk space of one visitor's runs. Called by one recorder's thread."""

    def __init__(self, logs: Path, owner: str, most: float | None, clock: Callable[[], float] = time.monotonic):
        """`owner`: the mark of the visitor's runs. `most`: bytes; no bound if it is None or there is no owner."""
        self._logs, self._owner, self._most, self._clock = logs, owner, most, clock
        self._finished: set[Path] = set()
        self._looked_at = float("-inf")
        self._known = self._granted = 0.0
        """Bytes at the last check, and bytes granted since then."""

    def __call__(self, size: int = 0) -> str:
        """Return why `size` more bytes may not be written, as a sentence; if they may, count them and return ""."""
        if self._most is None or not self._owner:
            return ""
        fits = self._known + self._granted + size <= self._most
        if self._clock() - self._looked_at >= (LOOK if fits else LOOK_AGAIN):
            self._looked_at = self._clock()
            self._known, self._granted = self._taken(), 0.0
        taken = self._known + self._granted
        if taken + size <= self._most:
            self._granted += size
            return ""
        needs = f"{size / MEGABYTE:.1f}"
        told = f", and this needs {needs} MB" if taken <= self._most and float(needs) else ""
        return (
            f"Your runs take {taken / MEGABYTE:.0f} MB of the {self._most / MEGABYTE:.0f} MB that each visitor has{told}: "
            "delete some of them on the page Runs, the present one after a reset. A simulated second takes about "
            f"{PER_SECOND / MEGABYTE:g} MB, so that {self._most / PER_SECOND:.0f} s fit in all."
        )

    def _taken(self) -> float:
        """The most bytes that the visitor's runs take once all are finished, with their notes."""
        total = 0.0
        for path in list_runs(self._logs):
            if owner_of(path) == self._owner:
                with contextlib.suppress(OSError):
                    total += self._finished_size(path)
                with contextlib.suppress(OSError):
                    total += notes_path(path).lstat().st_size
        return total

    def _finished_size(self, path: Path) -> float:
        size = path.stat().st_size
        if path not in self._finished:
            if not has_footer(path):
                return INDEX + (1 + INDEX_SHARE) * size
            self._finished.add(path)
        return size
