"""A command that finds everything compiled says nothing of it; `test_same_bits` looks at what a first start says."""

import subprocess
from collections.abc import Callable

import pytest

from flexlab import compiled

Command = Callable[..., subprocess.CompletedProcess[str]]


def test_a_command_that_finds_everything_compiled_says_nothing(
    flexlab_command: Command, monkeypatch: pytest.MonkeyPatch
):
    words = "run", "paper", "soft-beam", "--duration", "0.01", "--json"
    flexlab_command(*words)  # Where nothing has compiled them for all tests.
    monkeypatch.setattr(compiled, "A_MOMENT", 0.0)
    monkeypatch.setattr(compiled.COMPILATION, "told", False)
    done = flexlab_command(*words)
    assert (done.returncode, done.stderr) == (0, "")
