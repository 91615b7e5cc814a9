"""The settings of a front server, how many labs the machine takes, and its addresses for other machines."""

import contextlib
import ipaddress
import math
import re
import secrets
import socket
import string
from dataclasses import dataclass, field
from functools import partial
from io import StringIO
from pathlib import Path

import segno

from flexlab.errors import LabError
from flexlab.machine import cores, free_memory
from flexlab.sockets import LOOPBACK, UNIX, WILDCARDS, base_address, usual_spelling
from flexlab.text import counted

SECRET_BYTES = 18
"""Random bytes of a generated word."""
SHORTEST_TOKEN = 16
"""Fewest characters of a chosen token: at two guesses a second nobody finds it."""
TOKEN_LETTERS = frozenset(string.ascii_letters + string.digits + "-._~")
"""Characters that need no quoting in addresses and cookies."""
MOST_SESSIONS = 1000
"""Upper limit of `max_sessions`, far more than any machine can run."""
SHORTEST_IDLE, LONGEST_IDLE = 1.0, 604_800.0
"""Range of `idle_time`, s: from enough for reloading a page to a week."""
MEGABYTE, GIGABYTE = 1e6, 1e9
BASE_URL = re.compile(r"(/(?!\.{1,2}(/|$))[A-Za-z0-9._~%@+-]+)*", re.ASCII)
"""Segments that need no quoting in pages, headers and cookies."""
FAR_AWAY = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}
"""Addresses of no machine: the route to them goes through the interface that others can reach. Nothing is sent."""
LAB_MEMORY = 120e6
"""Memory of a lab alone, bytes: measured 65 to 100 MB where labs share the program, with room for fine meshes."""
KEPT_FREE = 1e9
"""Memory kept free, bytes, for the server itself, exports, and whatever else the machine does."""
LABS_PER_CORE = 6
"""A running lab costs a quarter to a third of a core while its visitor watches, 0.3 % while nobody does: with this many per
core, each runs at full speed while half of a class reads."""


def secret_word() -> str:
    """A new word that nobody can guess, in characters that addresses and cookies hold."""
    return secrets.token_urlsafe(SECRET_BYTES)


@dataclass(frozen=True)
class Settings:
    """Where to listen, where runs are kept, and whether visitors share one lab: named as the options of `flexlab`."""

    logs: Path = Path("logs")
    host: str = "127.0.0.1"
    port: int = 8080
    """Port to listen on; 0 for any free one."""
    base_url: str = ""
    """Prefix of all addresses of the server behind a proxy, as in "/user/ann/flexlab"; a slash at its end is dropped."""
    rerun: bool = False
    """Whether rerun viewers can show each lab's data live."""
    private: bool = False
    """Whether each visitor gets a lab, and a process, of their own."""
    max_sessions: int = 4
    """Private labs at once."""
    max_per_address: int | None = None
    """Private labs of one address at once; None: one less than `max_sessions`."""
    idle_time: float = 600.0
    """Seconds without an open page after which a private lab is closed."""
    token: str | None = None
    """The token that opens the server; generated if the host is not loopback and none is given. None: not needed."""
    teacher_token: str | None = None
    """The token that opens everything, all labs and all runs; generated where there is a `token`. None: not needed."""
    quota: float | None = None
    """Megabytes that the runs of one visitor with a private lab may take; None: any number."""
    max_size: float | None = None
    """Size of all runs, gigabytes, over which the oldest that are not kept are deleted; None: never."""
    max_age: float | None = None
    """Age, days, after which a run that is not kept is deleted; None: never."""
    shadows: bool = True
    """Whether the scene casts shadows; without a graphics card they cost most of the time."""
    class_service: str = ""
    """Address of the hub's service to which the lab reports, see `labs/hub_labs.py`; empty for none."""
    is_hub_service: bool = False
    """Whether this is such a service, which needs no tokens because its hub identifies people."""
    resumes_class: bool = field(init=False)
    """Whether a class resumes with the rules that were kept: only if its teacher's token was given, not generated."""

    def __post_init__(self) -> None:
        settle = partial(object.__setattr__, self)
        settle("base_url", self.base_url.rstrip("/"))
        settle("host", usual_spelling(self.host))
        settle("resumes_class", self.teacher_token is not None)
        if not BASE_URL.fullmatch(self.base_url):
            raise LabError(
                f"base-url = {self.base_url!r:.80} is not a valid prefix of an address: write one like /user/ann/flexlab."
            )
        if not self.host:  # It would mean all addresses of the machine.
            raise LabError("host is empty: name an address, such as 127.0.0.1, or leave it out.")
        if self.host.startswith(UNIX) and self.private:
            raise LabError("A Unix socket serves one person behind a proxy: leave out --private.")
        ranges = (
            ("max-sessions", self.max_sessions, 1, MOST_SESSIONS, ""),
            ("idle-time", self.idle_time, SHORTEST_IDLE, LONGEST_IDLE, " s"),
            ("max-per-address", self.max_per_address, 1, self.max_sessions, ""),
        )
        for name, given, low, high, unit in ranges:
            if given is not None and not low <= given <= high:
                raise LabError(f"{name} = {given!r:.60}{unit} is outside {low:g} to {high:g}{unit}: choose within it.")
        limits = ("max-size", self.max_size, "GB"), ("max-age", self.max_age, "days"), ("quota", self.quota, "MB")
        for name, limit, unit in limits:
            if limit is not None and not 0 < limit < math.inf:
                raise LabError(f"{name} = {limit:g} {unit} is not a limit: give a number above 0, or leave it out.")
        for name, token in (("--token", self.token), ("--teacher-token", self.teacher_token)):
            if token is not None:
                _check_token(token, name)
        if self.token is not None and self.token == self.teacher_token:
            raise LabError("--teacher-token is the same as --token, which opens the lab to all: choose another one.")
        if self.token is None and not self.is_local:
            settle("token", secret_word())
        if self.teacher_token is None and self.token is not None:
            settle("teacher_token", secret_word())

    @property
    def labs_per_address(self) -> int:
        """Private labs that the visitors of one address may have at once; by default one stays free for others."""
        return self.max_per_address or max(self.max_sessions - 1, 1)

    @property
    def has_class(self) -> bool:
        """Whether there is a class with a teacher; also behind a proxy on this machine if there are tokens."""
        return self.private or not self.is_local or self.teacher_token is not None

    @property
    def bytes_of_visitor(self) -> float | None:
        """The quota in bytes."""
        return None if self.quota is None else self.quota * MEGABYTE

    def public_host(self) -> str:
        """This machine's name or address for other machines."""
        return next(iter(self._reached_at()), socket.gethostname())

    def address(self, port: int, path: str = "", host: str | None = None, token: str | None = None) -> str:
        """The address of a page; on a Unix socket, the part after the proxy's address. `host`: this machine's name for others."""
        base = "" if self.is_socket else base_address(host or self.host, port)
        return base + self.base_url + path + (f"?token={token}" if token else "")

    def outside_addresses(self, port: int, path: str = "/") -> list[str]:
        """A page's addresses for other machines, token included; none if the server is for this machine only."""
        hosts = [] if self.is_local else self._reached_at()
        return [self.address(port, path, host, self.token) for host in hosts]

    def _reached_at(self) -> list[str]:
        """The names or addresses at which other machines reach the server."""
        if self.host not in WILDCARDS:
            return [self.host]
        # 0.0.0.0 takes no connections by IPv6; :: takes both.
        return [address for address in network_addresses() if self.host != "0.0.0.0" or ":" not in address]

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach the server, or another program decides who can."""
        return self.host in LOOPBACK or self.is_socket or self.is_hub_service

    @property
    def is_socket(self) -> bool:
        """Whether the server listens on a Unix socket, behind a proxy that decides who gets in."""
        return self.host.startswith(UNIX)


def _check_token(token: str, name: str) -> None:
    """Raise `LabError` for a token that is too short, or that addresses and cookies cannot hold unchanged."""
    if len(token) < SHORTEST_TOKEN:
        raise LabError(
            f"{name} has {counted(len(token), 'character')}, too few to keep anybody out: give at least {SHORTEST_TOKEN}."
        )
    strange = sorted(set(token) - TOKEN_LETTERS)
    if strange:
        raise LabError(
            f"{name} has {' '.join(map(ascii, strange[:5]))}, which an address cannot hold as it stands: "
            "use letters a to z, A to Z, digits, hyphens, dots and underscores."
        )


def network_addresses() -> list[str]:
    """This machine's addresses in its networks, the one of the default route first."""
    found: list[str] = []
    for family, far in FAR_AWAY.items():
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as plug:
            plug.connect((far, 9))
            found.append(plug.getsockname()[0])
    with contextlib.suppress(OSError):
        found += [str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None)]
    return list(dict.fromkeys(address for address in found if _is_reachable(address)))


def _is_reachable(address: str) -> bool:
    number = ipaddress.ip_address(address.partition("%")[0])
    return not (number.is_loopback or number.is_link_local or number.is_unspecified)


def terminal_code(address: str) -> str:
    """A QR code as lines of text, two rows of squares per line."""
    text = StringIO()
    segno.make(address, micro=False).terminal(text, compact=True, border=1)
    return text.getvalue()


def picture_code(address: str) -> str:
    """A QR code as a data URI of its picture, dark on light whatever the page's colours."""
    return segno.make(address, micro=False).svg_data_uri(scale=4, border=2, dark="#1c2430", light="#ffffff")


@dataclass(frozen=True)
class Capacity:
    """Cores and memory of a machine."""

    cores: int
    memory: float | None
    """Free memory, bytes, with what can be freed; None if the system does not tell."""

    @property
    def labs(self) -> int:
        """The number of private labs that the machine can run at once, at least one."""
        by_cores = self.cores * LABS_PER_CORE
        by_memory = by_cores if self.memory is None else int((self.memory - KEPT_FREE) / LAB_MEMORY)
        return max(1, min(by_cores, by_memory))

    @property
    def text(self) -> str:
        """Cores and memory in words."""
        cores = counted(self.cores, "core")
        return cores if self.memory is None else f"{cores}, {self.memory / 1e9:.1f} GB of memory free"


def capacity() -> Capacity:
    """Cores and memory that this machine, or its container, has now."""
    return Capacity(cores(), free_memory())
