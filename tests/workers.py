"""Folders of tests run in a few more processes than there are processors, each file in one of them; single files run here.

So `pytest` needs no option, a debugger meets one process (`pytest tests/test_api.py`, `-n0`, `--pdb`, `-p no:xdist`), and the
fixtures of a file are made once. On two processors two of them drive a browser, one for tests of the lab, one for tests of the
server: with more, pages draw so slowly that they time out. These start first, as they take longest; then come the servers.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from flexlab.machine import cores

MOST = 6
"""Largest number of processes: each takes about a gigabyte of memory, and its browser half of one."""
WAITING = 2
"""Processes beyond the number of processors: those that drive a browser wait for it most of the time."""
BROWSERS = min(max(1, cores() // 2), 2)
"""Number of processes that drive a browser for tests of the lab, and as many for tests of the server."""

BROWSER = "browser"
"""Beginning of the names under which the scheduler groups the files of one browser."""

FEW_AND_LONG = ("test_same_bits.py", "test_cluster.py", "test_bench.py", "test_documented.py", "test_plain_python.py")
"""Files with few but long tests: run last, they would leave a processor idle."""


def is_of_browser(test: str) -> bool:
    """Whether a test's file drives a browser, judged by its name: the process that distributes the tests knows no more."""
    return test.partition("::")[0].endswith("_in_browser.py")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Choose the number of processes if no option does; compile the kernels once before all processes need them."""
    if not config.pluginmanager.hasplugin("xdist") or hasattr(config, "workerinput"):
        return
    chosen = [Path(config.invocation_params.dir, name) for name in config.args]
    if config.option.numprocesses is None and any(path.is_dir() for path in chosen) and not config.option.usepdb:
        config.option.numprocesses = min(cores() + WAITING, MOST)
    if config.option.numprocesses and config.option.dist == "no":
        config.option.dist = "loadfile"
    if config.option.numprocesses and not config.option.collectonly and Path(__file__).parent in chosen:
        _compile_kernels()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log):
    """Schedule by file, the files of one browser together; long or waiting files first, then those with the most tests."""
    if config.option.dist != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    files: dict[str, list[str]] = {"lab": [], "server": []}

    class BrowsersApart(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            if not is_of_browser(nodeid):
                return file
            of = "lab" if file.startswith("tests/lab/") else "server"
            if file not in files[of]:
                files[of].append(file)
            return f"{BROWSER} {files[of].index(file) % BROWSERS + 1} of the {of}"

        def _assign_work_unit(self, node) -> None:
            self.workqueue.move_to_end(min(self.workqueue, key=_turn), last=False)
            super()._assign_work_unit(node)

    return BrowsersApart(config, log)


def _turn(unit: str) -> int:
    """Rank of a file in the schedule; files of the same rank keep their order."""
    return 0 if unit.startswith(BROWSER) else 1 if "/server/" in unit or unit.endswith(FEW_AND_LONG) else 2


def _compile_kernels() -> None:
    from flexlab.sim.compile_all import is_everything_compiled

    if not is_everything_compiled():
        print("compiling the equations of motion, once ...", flush=True)
        subprocess.run([sys.executable, "-m", "flexlab.sim.compile_all"], check=True)
