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


STARTING = """
import sys
from flexlab.cli.warmup import loading
with loading():
    import flexlab.server.front_server
import pyarrow
table = pyarrow.table({"time": [0.0, 0.1]})
print(*sys.modules)
print(table.to_pandas().shape)
"""
"""Loads what a lab loads, makes a table as a recorder does, and asks for a data frame at last."""


def test_a_lab_loads_no_library_for_figures_fits_or_data_frames_at_its_start():
    """Together these libraries take as long to load as all of flexlab itself."""
    done = subprocess.run([sys.executable, "-c", STARTING], capture_output=True, text=True, check=True)
    names, shape = done.stdout.splitlines()
    assert {"flexlab.analysis.figures", "pyarrow"} < set(names.split())
    assert not {"matplotlib", "scipy.optimize", "scipy.stats", "pandas"} & set(names.split())
    assert shape == "(2, 1)", "pandas is still there for whoever asks"


def test_the_process_of_a_law_or_unit_loads_no_compiler():
    loading = "import sys, flexlab.own.child, flexlab.own.unit_at_work; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", loading], capture_output=True, text=True, check=True)
    assert not {"numba", "llvmlite", "pydantic"} & set(done.stdout.split())
