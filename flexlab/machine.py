"""Processors and memory that this process may use: those of the machine, or the share that its container was given.

`os.cpu_count` and /proc/meminfo tell of the whole machine, whatever a container's limits are. Linux keeps these limits as files,
in one folder per control group (cgroups, versions 1 and 2: https://docs.kernel.org/admin-guide/cgroup-v2.html).
"""

import contextlib
import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path("/")
"""Root of the file system in which Linux tells of both."""
KIBIBYTE = 1024.0


def cores() -> int:
    """Number of processors, at least 1; a share of their time counts as the whole processors in it."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    shares = (_processors(group) for group in _control_groups("cpu"))
    return max(1, math.floor(min((count, *shares))))


def give_way(niceness: int) -> None:
    """Let everything else on the machine take precedence, by a Unix niceness; on Windows, which has none, do nothing."""
    with contextlib.suppress(AttributeError, OSError):
        os.nice(niceness)


def limit_memory(most: float, process: int = 0) -> None:
    """Let a process, 0 for this one, take no more memory than `most`, bytes; only Linux enforces such a limit."""
    if sys.platform == "linux":
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        limit = int(most) if hard == resource.RLIM_INFINITY else min(int(most), hard)
        with contextlib.suppress(OSError):  # It has ended.
            resource.prlimit(process, resource.RLIMIT_DATA, (limit, hard))


def free_memory() -> float | None:
    """Free memory, bytes, with what can be freed; None if the system does not tell."""
    available = _entry(ROOT / "proc/meminfo", "MemAvailable:")
    if available is None:
        return None
    return min((KIBIBYTE * available, *(_memory_left(group) for group in _control_groups("memory"))))


def _control_groups(controller: str) -> Iterator[Path]:
    """Folders of the groups that limit this process: its own one and all above it."""
    mounted = ROOT / "sys/fs/cgroup"
    for line in _text(ROOT / "proc/self/cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers and controller not in controllers.split(","):
            continue
        top = mounted / controller if controllers else mounted  # Version 2 has one tree for all controllers.
        own = top / path.lstrip("/")
        yield from (folder for folder in (own, *own.parents) if folder.is_relative_to(top))


def _processors(group: Path) -> float:
    """Processors' worth of time that a group may use."""
    words = _text(group / "cpu.max") or f"{_text(group / 'cpu.cfs_quota_us')} {_text(group / 'cpu.cfs_period_us')}"
    try:
        quota, period = map(float, words.split())
    except ValueError:  # There is no such file, or the quota is "max".
        return math.inf
    return quota / period if quota > 0 else math.inf  # Version 1 writes -1 for no limit.


def _memory_left(group: Path) -> float:
    """Memory that a group may still take, bytes; the files' cache that nothing has read lately can be freed."""
    for limit, used, cached in (
        ("memory.max", "memory.current", "inactive_file"),
        ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    ):
        try:
            left = float(_text(group / limit)) - float(_text(group / used))
        except ValueError:  # There is no such file, or the limit is "max".
            continue
        return max(0.0, left + (_entry(group / "memory.stat", cached) or 0.0))
    return math.inf


def _entry(file: Path, name: str) -> float | None:
    """The number behind a name in a table; None without it."""
    words = _text(file).split()
    try:
        return float(words[words.index(name) + 1])
    except (ValueError, IndexError):
        return None


def _text(file: Path) -> str:
    """The text of a file; "" if it cannot be read."""
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
