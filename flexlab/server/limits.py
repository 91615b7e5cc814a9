"""Limits on one visitor: things at once, wrong tokens, and space on the disk for their runs."""

import asyncio
import contextlib
import hashlib
import ipaddress
import re
import time
from collections import OrderedDict
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

from flexlab.errors import LabError
from flexlab.recording.rerun_internals.rrd_file import has_footer
from flexlab.recording.store.notes import notes_path, read_notes
from flexlab.recording.store.run_files import list_runs

HOUSEHOLD = 64
"""Bits of an IPv6 address that name a network, such as a household's: a machine in it chooses the others freely."""
FREE = 10.0
"""Wrong tokens of one address that are answered at once: people mistype."""
SPACING = 0.5
"""Seconds between two later answers."""
MOST_PENDING, MOST_HELD = 8, 64
"""Answers that are held back at once, of one address and of all. An address that asks more is not even compared; where all
together do, answers come at once, so that nobody is locked out by others."""
MOST_ADDRESSES = 10_000
"""Addresses that are remembered: the one that guessed longest ago is forgotten first."""
LOOK, LOOK_AGAIN = 5.0, 1.0
"""Seconds between two checks of the folder, and where more is asked for than was free at the last one."""
MEGABYTE = 1e6
PER_SECOND = 0.6 * MEGABYTE
"""Bytes that a simulated second of the paper's run takes, about."""
INDEX, INDEX_SHARE = 160_000, 0.01
"""Bytes, and share of its size, by which a run grows at most when it is finished: 136 kB and 0.5 kB per written block."""
_TAKEN = re.compile(r"Your runs take (\d+) MB of the (\d+) MB ")


class BusyError(LabError):
    """Too much of something is going on: the same request may be answered later."""


def network_of(address: str) -> str:
    """What counts as one address: of IPv6 the network, as one machine has as many addresses as it likes."""
    try:
        number = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(number, ipaddress.IPv4Address):
        return address
    mapped = number.ipv4_mapped
    return str(mapped or ipaddress.ip_network((int(number), HOUSEHOLD), strict=False))


def owner_word(visitor: str) -> str:
    """The mark of a visitor's runs in their notes; it does not reveal the secret that it is made from. Empty for nobody."""
    return hashlib.sha256(f"flexlab run of {visitor}".encode("utf-8", "replace")).hexdigest()[:32] if visitor else ""


@dataclass(frozen=True)
class Visitor:
    """Who asks for something."""

    id: str = ""
    """The secret word of their cookie; empty without one."""
    address: str = ""
    """As `network_of` has it."""
    is_teacher: bool = False
    """Whether they may do everything: they have the teacher's token, or there is none."""
    name: str = ""
    """What they are called; empty: they gave no name."""

    @property
    def person(self) -> str:
        """Identifies a visitor: by their cookie, else by their address."""
        return self.id or self.address

    @property
    def owner(self) -> str:
        """The mark of their runs; empty for nobody."""
        return owner_word(self.id)


THE_SERVER = Visitor(is_teacher=True)
"""The server itself, which asks for its own work."""


class Limit:
    """Bounds one kind of thing. For the server's event loop only."""

    def __init__(self, what: str, of_one: int, of_address: int, of_all: int, for_teacher: int):
        """`what`: its name, plural. `for_teacher`: places beyond `of_all`, for the teacher, whom no other bound holds."""
        self._what, self._of_one, self._of_address, self._of_all = what, of_one, of_address, of_all
        self._for_teacher = for_teacher
        self._taken: list[Visitor] = []

    def check(self, asker: Visitor) -> None:
        """Raises `BusyError` if this asker gets no place now."""
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


def for_teacher(problem: str) -> str:
    """What keeps a visitor's lab from recording, as the teacher reads it: a quota's advice is the visitor's."""
    found = _TAKEN.match(problem)
    if found is None:
        return problem
    return (
        f"Their runs take {found[1]} MB of the {found[2]} MB that each visitor has: nothing more is recorded until "
        "some are deleted."
    )


class Quota:
    """Bounds what one visitor's runs take on the disk. Called by one recorder's thread."""

    def __init__(self, logs: Path, owner: str, most: float | None, clock: Callable[[], float] = time.monotonic):
        """`most`: bytes; None or no owner: any number. `owner`: the mark of the visitor's runs."""
        self._logs, self._owner, self._most, self._clock = logs, owner, most, clock
        self._owners: dict[Path, str] = {}
        self._finished: set[Path] = set()
        self._looked_at = float("-inf")
        self._known = self._granted = 0.0
        """Bytes at the last look, and those granted since then."""

    def __call__(self, size: int = 0) -> str:
        """Why `size` more bytes may not be written, as a sentence; empty if they may, and then they count."""
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
        """Bytes of the visitor's runs once all are finished, at most, and of what is noted of them."""
        runs = list_runs(self._logs)
        # The owner of a run does not change, but a run that is just being opened has none yet.
        known = {path: self._owners.get(path) or str(read_notes(path).get("owner", "")) for path in runs}
        self._owners = {path: owner or ("-" if path in self._owners else "") for path, owner in known.items()}
        total = 0.0
        for path, owner in known.items():
            if owner == self._owner:
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
