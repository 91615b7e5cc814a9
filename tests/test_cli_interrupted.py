"""Ctrl-C at any moment, while modules load or a law computes, ends the program quietly and blames nobody."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from lab_process import PATIENCE
from own_law_text import PD, at_work
from waiting import wait_until

from flexlab.recording.reader import read_recording

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
"""A program that presses Ctrl-C the moment a module begins to load."""
PRESS = "os.kill(os.getpid(), signal.SIGINT)"
AS_ANOTHER_ERROR = f"""
            try:
                {PRESS}
            except KeyboardInterrupt:
                raise RuntimeError("the interrupt, as some libraries pass it on")
"""


IN_A_CALLBACK = f"""
            import weakref
            kept = weakref.ref(Pressing(), lambda gone: {PRESS})
"""
"""Python drops what is raised there, and its imports have such callbacks too."""


@pytest.mark.parametrize("press", [PRESS, AS_ANOTHER_ERROR, IN_A_CALLBACK])
@pytest.mark.parametrize("module", ["flexlab.cli", "flexlab.text", "tyro", "pydantic", "numba"])
def test_ctrl_c_while_modules_load_is_quiet(module: str, press: str, tmp_path: Path):
    program = PRESSING.format(module=module, press=press, words=["run", "paper", "--duration", "0.1"])
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 130, done
    assert done.stdout == ""
    assert done.stderr in ("", "Interrupted.\n")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_run_that_is_killed_or_whose_terminal_closes_is_recorded_whole(name: str, tmp_path: Path):
    number = getattr(signal, name)
    command = [sys.executable, "-m", "flexlab", "run", "paper", "--duration", "100000"]
    run = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # Tests that nohup started ignore a closed terminal.
    )  # fmt: skip
    try:
        wait_until(
            lambda: any(path.stat().st_size > 1e6 for path in tmp_path.glob("logs/*.rrd")), "a second is recorded"
        )
        run.send_signal(number)
        said = run.communicate(timeout=PATIENCE)
    finally:
        run.kill()
    assert (run.returncode, *said) == (128 + number, "", "Interrupted.\n")
    path, _ = sorted(tmp_path.glob("logs/*"), key=lambda path: path.suffix, reverse=True)
    recording = read_recording(path)
    assert (recording.state, recording.status) == ("complete", "finished")
    assert recording.status.text == f"Stopped at t = {recording.samples.time[-1]:g} s."


PRESS_AT_WORK = """
if at.time > 0.02:
    import signal, time
    os.kill(int(open(f"/proc/{os.getppid()}/stat").read().rpartition(")")[2].split()[1]), signal.SIGINT)
    time.sleep(%s)
"""
"""Statements in a law that press Ctrl-C on the command, the parent of its supervisor, `%s` seconds before the answer."""


EACH_IN_TURN = """
import sys
from flexlab.__main__ import main
for law in ("soon.py", "late.py", "never.py"):
    sys.argv = ["flexlab", "run", "paper", "--duration", "1", "--law", law]
    try:
        main()
    except SystemExit as end:
        print(end.code)
"""


def test_ctrl_c_while_a_law_computes_is_not_blamed_on_the_law(tmp_path: Path):
    for name, before in (("soon", 0.005), ("late", 0.06), ("never", 600.0)):
        (tmp_path / f"{name}.py").write_text(at_work(PRESS_AT_WORK % before))
    done = subprocess.run(
        [sys.executable, "-c", EACH_IN_TURN], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stderr == 3 * "Interrupted.\n"
    assert done.stdout == 3 * "130\n"


PRESSED_OFTEN = """
import os, signal, threading
import flexlab
flexlab.simulate("paper", 0.01, law="own_pd.py")
for number in range(40):
    pressing = threading.Timer(0.05 + 0.001 * number, os.kill, (os.getpid(), signal.SIGINT))
    pressing.start()
    try:
        print(flexlab.simulate("paper", 60.0, law="own_pd.py").status.text)
    except KeyboardInterrupt:
        print("ended")
"""


def test_ctrl_c_in_python_ends_a_run_with_a_law_wherever_it_comes(tmp_path: Path):
    """It may come in the law or in machine code, where Python raises it just before the law's next call, then drops it."""
    (tmp_path / "own_pd.py").write_text(PD)
    command = [sys.executable, "-c", PRESSED_OFTEN]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == 40 * "ended\n"


PRESSED_IN_EACH_CALL = """
import builtins
import flexlab

builtins.calls, builtins.pressed = 0, -1
flexlab.simulate("paper", 0.01, law="presses.py")
for builtins.pressed in range(builtins.calls):
    builtins.calls = 0
    try:
        for run in range(2):
            flexlab.simulate("paper", 0.01, law="presses.py")
        print("lost")
    except KeyboardInterrupt:
        print("ended")
"""
PRESS_IN_ONE_CALL = """
import builtins, os, signal
builtins.calls += 1
if builtins.calls - 1 == builtins.pressed:
    os.kill(os.getpid(), signal.SIGINT)
"""


def test_ctrl_c_in_the_last_call_of_a_law_is_not_lost(tmp_path: Path):
    """No step follows that call, so the run ends without seeing it, and a script would go on with its next run."""
    (tmp_path / "presses.py").write_text(at_work(PRESS_IN_ONE_CALL))
    command = [sys.executable, "-c", PRESSED_IN_EACH_CALL]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    said = done.stdout.splitlines()
    assert len(said) > 10
    assert set(said) == {"ended"}
