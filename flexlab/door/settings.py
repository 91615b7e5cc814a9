"""What a front door is told when it is opened."""

from dataclasses import dataclass
from pathlib import Path

from flexlab.errors import LabError

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Addresses that only this machine can reach."""
MOST_SESSIONS = 1000
"""Private labs that may be asked for at once: far more than any machine can run."""


@dataclass(frozen=True)
class Settings:
    """Where to listen, where runs are kept, and whether visitors share one lab."""

    logs: Path = Path("logs")
    host: str = "127.0.0.1"
    port: int = 8080
    """0: any free one."""
    token: str | None = None
    """The word that opens the door; None: made up if the host is not loopback, otherwise not asked for."""
    private: bool = False
    """Whether each visitor gets a lab, and a process, of their own."""
    max_sessions: int = 4
    """Private labs at once."""
    idle_time: float = 600.0
    """s without an open page after which a private lab is closed."""
    shadows: bool = True
    """Whether the scene casts shadows; without a graphics card they cost most of the time."""

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise LabError(f"port = {self.port} is not a port number: choose 0 (any free one) to 65535.")
        if not 1 <= self.max_sessions <= MOST_SESSIONS:
            raise LabError(f"max-sessions = {self.max_sessions} is outside 1 to {MOST_SESSIONS}: choose within it.")
        if not self.idle_time > 0:
            raise LabError(f"idle time = {self.idle_time:g} s is not usable: give more than 0.")
        if self.token is not None and len(self.token) < 8:
            raise LabError("The token is too short to keep anybody out: give at least 8 characters.")

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach the door."""
        return self.host in LOOPBACK
