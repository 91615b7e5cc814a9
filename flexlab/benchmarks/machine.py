"""What the figures were measured on."""

import os
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

LIBRARIES = ("flexlab", "numpy", "numba", "scipy")
"""Whose versions decide about speed."""


@dataclass(frozen=True)
class Machine:
    """Processor, load and versions."""

    processor: str
    cores: int
    """That this process may use."""
    load: float | None
    """Processes that wanted to run in the last minute, on average; None where the system does not tell."""
    system: str
    python: str
    versions: dict[str, str]

    @property
    def text(self) -> str:
        """One line."""
        busy = "" if self.load is None else f", load {self.load:.1f}"
        libraries = ", ".join(f"{name} {number}" for name, number in self.versions.items())
        return f"{self.processor}, {self.cores} cores{busy}; {self.system}, Python {self.python}, {libraries}"


def this_machine() -> Machine:
    """The machine that this runs on."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    versions = {name: number for name in LIBRARIES if (number := version_of(name))}
    return Machine(_processor(), cores, load, platform.system(), platform.python_version(), versions)


def version_of(library: str) -> str | None:
    """The installed version of a library, None if it is not installed."""
    try:
        return version(library)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
