"""Ctrl-C at any moment of a command's start is no fault of the program: it ends quietly, as interrupted."""

import subprocess
import sys
from pathlib import Path

import pytest

PRESSING = """
import os, runpy, signal, sys

class Pressing:
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            sys.meta_path.remove(self)
            {press}

sys.meta_path.insert(0, Pressing())
sys.argv = ["flexlab", *{words!r}]
runpy.run_module("flexlab", run_name="__main__", alter_sys=True)
"""
"""Ctrl-C at the moment at which a module begins to load."""
PRESS = "os.kill(os.getpid(), signal.SIGINT)"
AS_ANOTHER_ERROR = f"""
            try:
                {PRESS}
            except KeyboardInterrupt:
                raise RuntimeError("the interrupt, as some libraries pass it on")
"""


@pytest.mark.parametrize("press", [PRESS, AS_ANOTHER_ERROR])
@pytest.mark.parametrize("module", ["flexlab.cli", "flexlab.text", "tyro", "pydantic", "numba"])
def test_ctrl_c_while_modules_load_is_quiet(module: str, press: str, tmp_path: Path):
    program = PRESSING.format(module=module, press=press, words=["run", "paper", "--duration", "0.1"])
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 130, done
    assert done.stdout == ""
    assert done.stderr in ("", "Interrupted.\n")
