"""A process counts the processors and the memory of its container, as Linux tells them, and not those of the whole machine."""

import os
from pathlib import Path

import pytest

from flexlab import machine
from flexlab.machine import give_way
from flexlab.server.settings import capacity

GIGABYTE = 1_000_000_000
NONE = "9223372036854771712"
"""How version 1 of control groups writes that there is no limit to memory."""


@pytest.fixture(autouse=True)
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A machine of 64 processors with 200 GB of free memory; writes the files that tell of a process's groups."""
    monkeypatch.setattr(machine, "ROOT", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)), raising=False)

    def write(**texts: str) -> None:
        for name, text in texts.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{text}\n")

    write(**{"proc/meminfo": f"MemTotal: 1 kB\nMemAvailable:   {200 * GIGABYTE // 1024} kB"})
    return write


def found() -> tuple[int, int | None]:
    """Cores and free memory, whole GB."""
    memory = machine.free_memory()
    return machine.cores(), None if memory is None else round(memory / GIGABYTE)


def test_without_limits_all_of_the_machine_counts(files) -> None:
    assert found() == (64, 200)
    files(**{"proc/self/cgroup": "0::/", "sys/fs/cgroup/cpu.max": "max 100000", "sys/fs/cgroup/memory.max": "max"})
    assert found() == (64, 200)
    files(**{
        "proc/self/cgroup": "4:memory:/\n1:cpu,cpuacct:/\n0::/", "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1",
        "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000", "sys/fs/cgroup/memory/memory.limit_in_bytes": NONE,
        "sys/fs/cgroup/memory/memory.usage_in_bytes": "1000",
    })  # fmt: skip
    assert found() == (64, 200)


@pytest.mark.parametrize("limited", ["pod", "pod/lab"])
def test_a_limit_holds_for_all_groups_below_it(files, limited: str) -> None:
    group = f"sys/fs/cgroup/{limited}"
    files(**{
        "proc/self/cgroup": "0::/pod/lab", f"{group}/cpu.max": "250000 100000", f"{group}/memory.max": f"{4 * GIGABYTE}",
        f"{group}/memory.current": f"{3 * GIGABYTE}", f"{group}/memory.stat": f"anon 5\ninactive_file {GIGABYTE}\nshmem 7",
    })  # fmt: skip
    assert found() == (2, 2), "files that nothing has read lately can leave the memory"


def test_a_container_sees_its_group_of_version_1_at_the_top(files) -> None:
    files(**{
        "proc/self/cgroup": "4:memory:/docker/ab12\n1:cpu,cpuacct:/docker/ab12\n0::/docker/ab12",
        "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "150000", "sys/fs/cgroup/cpu/cpu.cfs_period_us": "50000",
        "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{8 * GIGABYTE}",
        "sys/fs/cgroup/memory/memory.usage_in_bytes": f"{2 * GIGABYTE}",
        "sys/fs/cgroup/memory/memory.stat": f"inactive_file 1\ntotal_inactive_file {GIGABYTE}",
    })  # fmt: skip
    assert found() == (3, 7)


def test_half_a_processor_and_used_up_memory_still_open_one_lab(files) -> None:
    group = "sys/fs/cgroup"
    files(**{
        "proc/self/cgroup": "0::/", f"{group}/cpu.max": "50000 100000", f"{group}/memory.max": "1000",
        f"{group}/memory.current": "2000",
    })  # fmt: skip
    assert found() == (1, 0)
    assert capacity().labs == 1


def test_a_system_that_does_not_tell_has_all_its_processors_and_unknown_memory(tmp_path: Path) -> None:
    (tmp_path / "proc/meminfo").unlink()
    assert found() == (64, None)


def test_a_system_without_niceness_works_on(monkeypatch: pytest.MonkeyPatch):
    """On Windows, the process that compiles beside a lab ended at once."""
    monkeypatch.delattr(os, "nice")
    give_way(1)
