"""What `flexlab.cli.warmup` leaves out is there as soon as somebody asks for it."""

import gc
import importlib
import subprocess
import sys

import pytest

from flexlab.cli import warmup


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module that says when it is read."""
    (tmp_path / "seldom_asked.py").write_text("import sys\nsys.read_at_last = True\nanswer = 42\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "read_at_last", False, raising=False)
    yield "seldom_asked"
    sys.modules.pop("seldom_asked", None)
    gc.unfreeze()


def test_a_module_that_nobody_asks_is_read_when_somebody_does(module, monkeypatch):
    monkeypatch.setattr(warmup, "UNASKED", frozenset({module}))
    with warmup.loading():
        found = importlib.import_module(module)
    assert not sys.read_at_last  # type: ignore[attr-defined]
    assert found.answer == 42
    assert sys.read_at_last  # type: ignore[attr-defined]


def test_other_modules_and_later_ones_are_read_at_once(module, monkeypatch):
    before = list(sys.meta_path)
    with warmup.loading():
        importlib.import_module(module)
    assert sys.read_at_last  # type: ignore[attr-defined]
    assert sys.meta_path == before
    assert gc.isenabled()


def test_a_lab_in_which_nobody_draws_or_fits_loads_no_library_for_it():
    """Together they take as long to load as everything that flexlab itself has."""
    program = "import sys, flexlab.server.front_server; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "flexlab.analysis.figures" in done.stdout.split()
    assert not {"matplotlib", "scipy.optimize", "scipy.stats"} & set(done.stdout.split())
