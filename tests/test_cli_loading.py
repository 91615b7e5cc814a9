"""The modules that `flexlab.cli.warmup` puts off are loaded at their first use."""

import gc
import importlib
import subprocess
import sys

import pytest

from flexlab.cli import warmup


@pytest.fixture
def module(tmp_path, monkeypatch):
    """The name of a module that notes when it is executed."""
    (tmp_path / "seldom_asked.py").write_text("import sys\nsys.read_at_last = True\nanswer = 42\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "read_at_last", False, raising=False)
    yield "seldom_asked"
    sys.modules.pop("seldom_asked", None)
    gc.unfreeze()


def test_a_module_that_is_put_off_is_executed_at_its_first_use(module, monkeypatch):
    monkeypatch.setattr(warmup, "UNASKED", frozenset({module}))
    with warmup.loading():
        found = importlib.import_module(module)
    assert not sys.read_at_last  # type: ignore[attr-defined]
    assert found.answer == 42
    assert sys.read_at_last  # type: ignore[attr-defined]


def test_all_other_modules_are_executed_at_once(module, monkeypatch):
    before = list(sys.meta_path)
    with warmup.loading():
        importlib.import_module(module)
    assert sys.read_at_last  # type: ignore[attr-defined]
    assert sys.meta_path == before
    assert gc.isenabled()


def test_a_lab_loads_no_library_for_figures_or_fits_at_its_start():
    """Together these libraries take as long to load as all of flexlab itself."""
    program = "import sys, flexlab.server.front_server; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "flexlab.analysis.figures" in done.stdout.split()
    assert not {"matplotlib", "scipy.optimize", "scipy.stats"} & set(done.stdout.split())
