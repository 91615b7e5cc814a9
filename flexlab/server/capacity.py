"""How many private labs a machine takes, from its memory and its cores."""

import os
from dataclasses import dataclass
from pathlib import Path

LAB_MEMORY = 120e6
"""Bytes that a lab has for itself: measured 65 to 100 MB where labs share the program, with room for fine meshes."""
KEPT_FREE = 1e9
"""Bytes for the server itself, exports, and whatever else the machine does."""
LABS_PER_CORE = 6
"""A lab that runs before its visitor's eyes costs a quarter to a third of a core, one that nobody looks at 0.3 %: so many as
leave each at full speed while half of a class reads."""
MEMORY_TABLE = Path("/proc/meminfo")


@dataclass(frozen=True)
class Capacity:
    """What a machine has."""

    cores: int
    memory: float | None
    """Bytes that are free, or can be made so; None if the system does not tell."""

    @property
    def labs(self) -> int:
        """Private labs that it takes at once, at least one."""
        by_cores = self.cores * LABS_PER_CORE
        by_memory = by_cores if self.memory is None else int((self.memory - KEPT_FREE) / LAB_MEMORY)
        return max(1, min(by_cores, by_memory))

    @property
    def text(self) -> str:
        """What it has, in words."""
        cores = "1 core" if self.cores == 1 else f"{self.cores} cores"
        return cores if self.memory is None else f"{cores}, {self.memory / 1e9:.1f} GB of memory free"


def capacity() -> Capacity:
    """Of this machine, now."""
    return Capacity(_cores(), _free_memory())


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _free_memory() -> float | None:
    try:
        for line in MEMORY_TABLE.read_text(encoding="ascii").splitlines():
            name, _, amount = line.partition(":")
            if name == "MemAvailable":
                return 1024.0 * int(amount.split()[0])
    except (OSError, ValueError, IndexError):
        pass
    return None
