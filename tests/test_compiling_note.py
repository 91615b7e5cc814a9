"""A command that finds everything compiled says nothing of it; `test_same_bits` looks at what a first start says."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from lab_process import Command

from flexlab import compiled


def test_a_command_that_finds_everything_compiled_says_nothing(
    flexlab_command: Command, monkeypatch: pytest.MonkeyPatch
):
    words = "run", "paper", "soft-beam", "--duration", "0.01", "--json"
    flexlab_command(*words)  # Where nothing has compiled them for all tests.
    monkeypatch.setattr(compiled, "A_MOMENT", 0.0)
    monkeypatch.setattr(compiled.COMPILATION, "told", False)
    done = flexlab_command(*words)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("words", [("run", "paper", "--duration", "0.01"), ("--no-browser", "--port", "0")])
def test_ctrl_c_while_compiling_is_a_sentence(tmp_path: Path, words: tuple[str, ...]):
    process = subprocess.Popen(
        [sys.executable, "-m", "flexlab", *words],
        cwd=tmp_path,
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "NO_COLOR": "1", "COLUMNS": "200"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    with process:
        assert process.stderr.readline().startswith("flexlab is compiling the equations of motion")
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
    assert (process.returncode, said) == (130, "Interrupted: the next start compiles what is missing.\n")
