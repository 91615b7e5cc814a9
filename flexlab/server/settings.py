"""What a front server is told when it is opened."""

import math
import socket
import string
from dataclasses import dataclass
from pathlib import Path

from flexlab.errors import LabError
from flexlab.sockets import LOOPBACK

WILDCARDS = ("0.0.0.0", "::", "")
"""Hosts that stand for all addresses of this machine."""
SOMEWHERE = ("192.0.2.1", 9)
"""An address that nobody has (RFC 5737): asking for the way there sends nothing."""
SECRET_BYTES = 18
"""Randomness of a word that is made up."""
SHORTEST_TOKEN = 16
"""Characters of a chosen token: at two guesses a second nobody finds it."""
TOKEN_LETTERS = frozenset(string.ascii_letters + string.digits + "-._~")
"""What addresses and cookies hold unchanged."""
MOST_SESSIONS = 1000
"""Private labs that may be asked for at once: far more than any machine can run."""
SHORTEST_IDLE, LONGEST_IDLE = 1.0, 604_800.0
"""s: from what lets a page be reloaded to a week."""


@dataclass(frozen=True)
class Settings:
    """Where to listen, where runs are kept, and whether visitors share one lab."""

    logs: Path = Path("logs")
    host: str = "127.0.0.1"
    port: int = 8080
    """0: any free one."""
    token: str | None = None
    """The word that opens the server; None: made up if the host is not loopback, otherwise not asked for."""
    private: bool = False
    """Whether each visitor gets a lab, and a process, of their own."""
    max_sessions: int = 4
    """Private labs at once."""
    idle_time: float = 600.0
    """s without an open page after which a private lab is closed."""
    shadows: bool = True
    """Whether the scene casts shadows; without a graphics card they cost most of the time."""
    live: bool = False
    """Whether the data of each lab are to be had live, for rerun viewers."""
    most_bytes: float | None = None
    """Over which the oldest runs that are not kept are deleted; None: never."""
    most_days: float | None = None
    """After which a run that is not kept is deleted; None: never."""
    teacher_token: str | None = None
    """The word that opens everything: all labs and all runs; None: made up where `token` is, else everybody may."""
    most_bytes_per_visitor: float | None = None
    """Which the runs of one visitor with a private lab may take; None: any number."""
    max_per_address: int | None = None
    """Private labs of one address at once; None: one less than in all."""

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise LabError(f"port = {self.port} is not a port number: choose 0 (any free one) to 65535.")
        if not 1 <= self.max_sessions <= MOST_SESSIONS:
            raise LabError(f"max-sessions = {self.max_sessions} is outside 1 to {MOST_SESSIONS}: choose within it.")
        if not SHORTEST_IDLE <= self.idle_time <= LONGEST_IDLE:
            raise LabError(
                f"idle-time = {self.idle_time:g} s is outside {SHORTEST_IDLE:g} to {LONGEST_IDLE:.0f} s: choose within it."
            )
        limits = (
            ("max-size", self.most_bytes, 1e9, "GB"),
            ("max-age", self.most_days, 1, "days"),
            ("quota", self.most_bytes_per_visitor, 1e6, "MB"),
        )
        for name, limit, scale, unit in limits:
            if limit is not None and not 0 < limit < math.inf:
                raise LabError(
                    f"{name} = {limit / scale:g} {unit} is no limit: give a number above 0, or leave it out."
                )
        for name, token in (("token", self.token), ("teacher's token", self.teacher_token)):
            if token is not None:
                _check_token(token, name)
        if self.token is not None and self.token == self.teacher_token:
            raise LabError("The teacher's token is the token that opens the lab to all: choose another one.")
        if self.max_per_address is not None and not 1 <= self.max_per_address <= self.max_sessions:
            raise LabError(
                f"max-per-address = {self.max_per_address} is outside 1 to {self.max_sessions}: choose within it."
            )

    @property
    def labs_per_address(self) -> int:
        """Private labs that the visitors of one address may have at once: unless chosen, one stays free for others."""
        return self.max_per_address or max(self.max_sessions - 1, 1)

    def public_host(self) -> str:
        """How other browsers know this machine."""
        return _own_address() if self.host in WILDCARDS else self.host

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach the server."""
        return self.host in LOOPBACK


def _check_token(token: str, name: str) -> None:
    """Raises `LabError` for a word that keeps nobody out, or that addresses and cookies do not take unchanged."""
    if len(token) < SHORTEST_TOKEN:
        raise LabError(f"The {name} is too short to keep anybody out: give at least {SHORTEST_TOKEN} characters.")
    strange = sorted(set(token) - TOKEN_LETTERS)
    if strange:
        raise LabError(
            f"The {name} has {' '.join(map(ascii, strange[:5]))}, which an address cannot hold as it stands: "
            "use letters a to z, A to Z, digits, hyphens, dots and underscores."
        )


def _own_address() -> str:
    """This machine's address in its network; its name where it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(SOMEWHERE)
            return probe.getsockname()[0]
        except OSError:
            return socket.gethostname()
