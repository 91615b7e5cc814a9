"""Fixtures for all tests: paths, the command line, the lab, and one browser."""

import contextlib
import gc
import io
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from browser_window import BY_THE_PROCESSOR, PATIENCE, SOFTWARE_RENDERING
from few_pictures import send_few
from get_browser import find_browser
from hypothesis import settings
from lab_process import Command, Lab
from playwright.sync_api import Browser, expect, sync_playwright
from threadpoolctl import threadpool_limits
from workers import is_of_browser, pytest_cmdline_main, pytest_xdist_make_scheduler

from flexlab.cli import main
from flexlab.cli.console import notes, output
from flexlab.control.law import LAWS
from flexlab.control.path import PATHS
from flexlab.own import hosts
from flexlab.own.files import PATH_FILES

__all__ = ["pytest_cmdline_main", "pytest_xdist_make_scheduler"]

settings.register_profile("flexlab", deadline=None)  # A busy machine takes its time.
settings.load_profile("flexlab")

ROOT = Path(__file__).resolve().parent.parent

REGISTRIES = LAWS, PATHS


def pytest_configure() -> None:
    """React to Ctrl-C in the test processes too: a shell lets what it starts in the background ignore it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Exempt everything loaded so far from garbage collection, which would walk through it again and again."""
    gc.freeze()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options that run tests left out by default."""
    parser.addoption("--all-lessons", action="store_true", help="do every lesson of the guide in a real browser")
    parser.addoption(
        "--documented", action="store_true", help="do every command of README, CONTRIBUTING and the documentation"
    )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that drive a browser: `pytest -m "not browser"` leaves out these slow ones."""
    for item in items:
        if " at 0x" in item.nodeid:
            raise pytest.UsageError(f"{item.nodeid}: the name holds an address, so that no two processes agree on it")
        if "chromium" in getattr(item, "fixturenames", ()):
            if not is_of_browser(item.nodeid):
                raise pytest.UsageError(f"{item.nodeid} drives a browser: its file's name has to end in _in_browser.py")
            item.add_marker("browser")


@contextlib.contextmanager
def forgetting_own_kinds() -> Iterator[None]:
    """Forget at the end which laws and paths were added or allowed to run inside: other tests draw from all known ones."""
    before = [set(registry.all()) for registry in REGISTRIES]
    apart, allowed = hosts._apart, hosts.allowed()
    yield
    hosts.run_apart(apart)
    if hosts.allowed() != allowed:
        hosts.close_all()
        hosts._allowed.clear()
        hosts.allow_digests(allowed)
        PATH_FILES._added.clear()
    for registry, known in zip(REGISTRIES, before, strict=True):
        for kind in set(registry.all()) - known:
            registry.forget(kind)


@pytest.fixture(autouse=True)
def _forget_those_of_a_test() -> Iterator[None]:
    with forgetting_own_kinds():
        yield


@pytest.fixture(scope="module", autouse=True)
def _forget_those_of_a_file() -> Iterator[None]:
    """Forget the laws and paths that a file's shared fixtures added."""
    hosts.run_apart(False)  # The default in Python, whatever fixtures of the session have set.
    with forgetting_own_kinds():
        yield


@pytest.fixture(scope="session", autouse=True)
def _one_blas_thread() -> Iterator[None]:
    """Use one BLAS thread: it is fastest for small matrices, and idle threads would spin on the cores of other tests."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # For processes that tests start.
    with threadpool_limits(1, user_api="blas"):
        yield


@pytest.fixture(scope="session")
def root() -> Path:
    """The source checkout."""
    return ROOT


SPOKEN_TO = {"COLUMNS": "120", "NO_COLOR": "1", "PYTHONIOENCODING": "utf-8"}
"""Environment variables that shape a command's output, the same for all tests."""


@pytest.fixture
def flexlab_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run the command line in an empty folder; the result holds exit code, output and errors.

    It runs in this process, which has loaded and compiled everything: starting a new process takes a hundred times longer
    than most commands do. `flexlab_process` does start one.
    """

    def run(*words: str, folder: Path = tmp_path, **environment: str) -> subprocess.CompletedProcess[str]:
        said, complained = io.StringIO(), io.StringIO()
        with monkeypatch.context() as circumstances, contextlib.chdir(folder):
            for name, value in (SPOKEN_TO | environment).items():
                circumstances.setenv(name, value)
            circumstances.setattr("sys.stdin", io.StringIO())
            # Consoles keep the width that they were made for.
            output.cache_clear()
            notes.cache_clear()
            with redirect_stdout(said), redirect_stderr(complained), pytest.raises(SystemExit) as ended:
                main(words)
        hosts.run_apart(False)  # The default in Python.
        output.cache_clear()
        notes.cache_clear()
        assert isinstance(ended.value.code, int)
        return subprocess.CompletedProcess(words, ended.value.code, said.getvalue(), complained.getvalue())

    return run


@pytest.fixture
def flexlab_process(tmp_path: Path) -> Command:
    """Like `flexlab_command`, but in a new process, as a user starts it."""

    def run(*words: str, folder: Path = tmp_path) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "flexlab", *words],
            cwd=folder,
            env=os.environ | SPOKEN_TO,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=300,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """A headless Chromium, one for all tests: playwright cannot be started twice on one thread."""
    path = find_browser()
    assert path, "no Chromium found: install one with python tests/get_browser.py"
    expect.set_options(timeout=PATIENCE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=SOFTWARE_RENDERING)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def plain_chromium(chromium: Browser) -> Iterator[Browser]:
    """A cheaper browser, for pages without rerun's viewer."""
    arguments = [*SOFTWARE_RENDERING, BY_THE_PROCESSOR]
    browser = chromium.browser_type.launch(executable_path=find_browser(), args=arguments)
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def few_pictures() -> Iterator[None]:
    """Let labs of this process send only as many pictures as a page of the tests draws."""
    with pytest.MonkeyPatch.context() as patch:
        send_few(patch)
        yield


@pytest.fixture
def start_lab(tmp_path: Path) -> Iterator[Callable[..., Lab]]:
    """Start labs as a user would, in the test's folder; kill those that still run after the test."""
    labs: list[Lab] = []

    def start(*words: str, **circumstances) -> Lab:
        labs.append(Lab(tmp_path, *words, **circumstances))
        return labs[-1]

    yield start
    for lab in labs:
        if lab.process.poll() is None:
            lab.process.kill()
        lab.wait_for_end()
