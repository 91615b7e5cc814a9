"""Compiling is told once, where it takes longer than a moment; a start that finds everything compiled says nothing."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from flexlab import compiled

Command = Callable[..., subprocess.CompletedProcess[str]]

SIMULATE = "import flexlab; flexlab.simulate('paper', 0.01)"
AT_ONCE = "import flexlab.compiled as compiled; compiled.A_MOMENT = 0.0; "
"""What would be told for the shortest compilation, so that no load of a machine decides."""


def complaints(program: str, cache: Path | None = None) -> str:
    environment = os.environ | ({"NUMBA_CACHE_DIR": str(cache)} if cache else {})
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    return done.stderr


@pytest.mark.skipif(compiled.PLAIN_PYTHON, reason="nothing is compiled")
def test_python_says_it_in_one_line_and_then_no_more(tmp_path: Path):
    said = complaints(SIMULATE, tmp_path)
    assert "compiling the equations of motion" in said
    assert said.count("\n") == 1
    assert complaints(AT_ONCE + SIMULATE, tmp_path) == ""


def test_a_command_that_finds_everything_compiled_says_nothing(
    flexlab_command: Command, monkeypatch: pytest.MonkeyPatch
):
    words = "run", "paper", "soft-beam", "--duration", "0.01", "--json"
    flexlab_command(*words)  # Where nothing has compiled them for all tests.
    monkeypatch.setattr(compiled, "A_MOMENT", 0.0)
    monkeypatch.setattr(compiled.COMPILATION, "told", False)
    done = flexlab_command(*words)
    assert (done.returncode, done.stderr) == (0, "")
