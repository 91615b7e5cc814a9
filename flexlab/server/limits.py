"""How many things of a kind one visitor, one address and all together may have at once; the teacher finds a place beside."""

import asyncio
import contextlib
import ipaddress
import time
from collections import OrderedDict
from collections.abc import Generator
from dataclasses import dataclass

from flexlab.errors import LabError


class BusyError(LabError):
    """Too much of something is going on: the same request may be answered later."""


HOUSEHOLD = 64
"""Bits of an IPv6 address that name a network, such as a household's: a machine in it chooses the others freely."""


def network_of(address: str) -> str:
    """By what addresses are told from one another: of IPv6 its network, as one machine has as many addresses as it likes."""
    try:
        number = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(number, ipaddress.IPv4Address):
        return address
    mapped = number.ipv4_mapped
    return str(mapped or ipaddress.ip_network((int(number), HOUSEHOLD), strict=False))


@dataclass(frozen=True)
class Asker:
    """Who asks for something that costs."""

    visitor: str
    """The id of their cookie; empty without one."""
    address: str
    """As `network_of` has it."""
    is_teacher: bool = False

    @property
    def person(self) -> str:
        """By what one visitor is told from another: those without a cookie by their address."""
        return self.visitor or self.address


THE_SERVER = Asker("", "", is_teacher=True)
"""Who asks for what the server does of its own accord."""


class Limit:
    """Bounds one kind of thing. For the server's event loop only."""

    def __init__(self, what: str, of_one: int, of_address: int, of_all: int, for_teacher: int):
        """`what`: its name, plural. `for_teacher`: so many more of all for who teaches, to whom the other bounds do not apply."""
        self._what, self._of_one, self._of_address, self._of_all = what, of_one, of_address, of_all
        self._for_teacher = for_teacher
        self._taken: list[Asker] = []

    def check(self, asker: Asker) -> None:
        """Raises `BusyError` if this asker gets no place now."""
        if asker.is_teacher:
            bounds = [("This server has", len(self._taken), self._of_all + self._for_teacher)]
        else:
            mine = sum(other.visitor == asker.visitor for other in self._taken)
            near = sum(other.address == asker.address for other in self._taken)
            # Those without a cookie are many at some addresses, so that only their address bounds them.
            bounds = [
                ("You have", mine if asker.visitor else 0, self._of_one),
                ("Your address has", near, self._of_address),
                ("This server has", len(self._taken), self._of_all),
            ]
        for who, taken, most in bounds:
            if taken >= most:
                raise BusyError(
                    f"{who} {taken} {self._what} already, and may have {most}: try again when one has ended."
                )

    @contextlib.contextmanager
    def place(self, asker: Asker) -> Generator[None]:
        """Hold one of the places. Raises `BusyError` if there is none for this asker."""
        self.check(asker)
        self._taken.append(asker)
        try:
            yield
        finally:
            self._taken.remove(asker)


FREE = 10.0
"""Wrong tokens of one address that are answered at once: somebody who mistypes."""
SPACING = 0.5
"""s between two later answers."""
MOST_PENDING, MOST_HELD = 8, 64
"""Answers that are held back at once, of one address and of all. An address that asks more is not even compared; where all
together do, answers come at once, so that nobody is locked out by others."""
MOST_ADDRESSES = 10_000
"""Addresses that are remembered: the one that guessed longest ago is forgotten first."""


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
