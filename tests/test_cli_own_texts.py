"""Every command runs a user's law in a process of its own: its end is told in a sentence, and its output is limited."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from lab_process import Command
from own_law_text import PD, at_work

from flexlab.own.child import MOST_PRINTED

BOARD = ("leaderboard", "--law-name", "pd", "--case", "B3", "--law")
COMMANDS = {
    "run": ("run", "paper", "--duration", "0.1", "--law"),
    "compare": ("compare", "newest", "--json", "--law"),
    "sweep": ("sweep", "paper", "--duration", "0.1", "--vary", "gravity=0,1", "--law"),
    "leaderboard": BOARD,
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_law_that_exits_does_not_end_the_command(name: str, flexlab_command: Command, tmp_path: Path):
    (tmp_path / "ends.py").write_text(at_work("if at.time > 0.02: os._exit(0)"))
    if name == "compare":
        assert flexlab_command("run", "paper", "--duration", "0.05").returncode == 0
    done = flexlab_command(*COMMANDS[name], "ends.py")
    said = " ".join((done.stdout + done.stderr).split())
    assert re.search(r"ends\.py, line \d+: it ended its own process with os\._exit", said), said
    assert "Traceback" not in said


@pytest.mark.parametrize("after", [-1.0, 0.02])
def test_a_replayed_law_that_exits_does_not_end_the_command(after: float, flexlab_command: Command, tmp_path: Path):
    (tmp_path / "ends.py").write_text(at_work(f"if at.time > {after} and os.path.exists('again'): os._exit(0)"))
    assert flexlab_command("run", "paper", "--duration", "0.05", "--law", "ends.py").returncode == 0
    (tmp_path / "again").touch()
    done = flexlab_command("replay", "--run-own-law")
    assert done.returncode == 1
    assert "it ended its own process with os._exit" in " ".join(done.stdout.split())


def test_what_a_law_prints_is_escaped_and_cut_off(
    flexlab_command: Command, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    # In many answers: one of 50 ms may print less than 1 MB on a busy machine.
    prints = "if at.time > 0: print('\\x1b[2J', 'x' * 60_000)\nwhile at.time > 0.03: pass"
    (tmp_path / "prints.py").write_text(at_work(prints))
    done = flexlab_command("run", "paper", "--duration", "0.1", "--law", "prints.py")
    assert done.returncode == 1
    said = capfd.readouterr().err
    assert "␛[2J xxx" in said
    assert "\x1b" not in said
    assert len(said) < 1.1 * MOST_PRINTED
    assert "What is printed beyond 1 MB is left out." in said
    assert "act did not answer within 50 ms" in " ".join(done.stderr.split())


def test_what_a_law_prints_stays_out_of_the_leaderboard(
    flexlab_command: Command, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    (tmp_path / "prints.py").write_text("print('hello', flush=True)\n" + PD)
    done = flexlab_command(*BOARD, "prints.py")
    assert done.returncode == 0, done.stderr
    said = capfd.readouterr()
    assert "hello" in said.err
    assert "hello" not in done.stdout + said.out


def test_files_named_like_modules_of_python_do_no_harm(tmp_path: Path):
    # As pip installs the command: in another folder than the one where it is started.
    command, here = tmp_path / "bin" / "flexlab", tmp_path / "course"
    for folder in (command.parent, here):
        folder.mkdir()
    command.write_text("from flexlab.__main__ import main\nmain()\n")
    for name in ("random", "signal", "struct"):
        (here / f"{name}.py").write_text("raise RuntimeError('not the module of Python')\n")
    (here / "helper.py").write_text("NAME = 'a helper'\n")
    (here / "laws").mkdir()
    asked = "import helper, os, signal\nprint(helper.NAME, signal.__file__, os.environ.get('PYTHONSAFEPATH'))\n"
    (here / "laws" / "pd.py").write_text(asked + PD)
    words = [sys.executable, str(command), "run", "paper", "--duration", "0.01", "--law", "laws/pd.py"]
    done = subprocess.run(
        words, cwd=here, env=os.environ | {"COLUMNS": "200"}, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(rf"a helper {re.escape(os.path.dirname(os.__file__))}/signal\.py None", done.stderr), done.stderr


IN_PYTHON = """import time
import flexlab
with flexlab.Lab("paper", law="laws/pd.py") as lab:
    runner, end = lab.session.runner, time.monotonic() + 120
    while runner.snapshot.latest.time[0] < 0.05 and not runner.snapshot.status.failed and time.monotonic() < end:
        time.sleep(0.02)
    print(runner.snapshot.status.text, float(runner.snapshot.latest.time[0]))
"""


def test_nor_in_a_lab_that_a_notebook_opens(tmp_path: Path):
    """Python itself has begun elsewhere; the law's process begins in the working folder."""
    (tmp_path / "laws").mkdir()
    (tmp_path / "laws" / "pd.py").write_text(PD)
    for name in ("signal", "struct"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('not the module of Python')\n")
    words = [sys.executable, "-P", "-c", IN_PYTHON]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) >= 0.05, done.stdout
