"""What a start of the command line loads."""

import subprocess
import sys

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
    assert not {"matplotlib", "scipy.optimize", "scipy.special", "scipy.stats", "pandas"} & set(names.split())
    assert shape == "(2, 1)", "pandas is still there for whoever asks"


def test_the_process_of_a_law_or_unit_loads_no_compiler():
    loading = "import sys, flexlab.own.child, flexlab.own.unit_at_work; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", loading], capture_output=True, text=True, check=True)
    assert not {"numba", "llvmlite", "pydantic"} & set(done.stdout.split())
