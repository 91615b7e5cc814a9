"""Processes that a law in Python starts end with it and with the lab, however these end, and odd reports do no harm."""

import contextlib
import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from lab_process import Command
from own_law_text import PD, at_work
from own_path_text import ROUND
from waiting import wait_until

from flexlab.control.law import laws
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.lab.session import Session
from flexlab.own import hosts
from flexlab.own.files import LAW_FILES
from flexlab.own.hosts import LawApart
from flexlab.own.law import add_own_law
from flexlab.own.process import MOST_READ, PROBE
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.world import World

CHILDREN = """
import os, subprocess, sys, time
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)", "{mark}"])
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)", "{mark}"], start_new_session=True)
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        os.execv(sys.executable, [sys.executable, "-c", "import time; time.sleep(600)", "{mark}"])
    os._exit(0)
"""
"""Top of a law that starts a child, a child in a session of its own, and a process whose parent has exited."""


@pytest.fixture(autouse=True)
def _apart() -> None:
    hosts.run_apart()


def marked(mark: str) -> list[int]:
    """Ids of the running processes that have `mark` as a word of their command."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark.encode() in (place / "cmdline").read_bytes().split(b"\0") and "Z" not in state_of(place):
                found.append(int(place.name))
    return found


def state_of(place: Path) -> str:
    return (place / "stat").read_text().rpartition(")")[2].split()[0]


def world_of(source: str, file: str = "own_pd.py") -> World:
    return World(load_preset("paper").replace({"controller.kind": add_own_law(source, file).kind}))


def test_all_processes_that_a_law_started_end_with_it(tmp_path: Path):
    mark = f"flexlab-test-{os.getpid()}-closed"
    world = world_of(CHILDREN.format(mark=mark) + PD)
    assert len(world.advance(3)) == 3, world.status.text
    wait_until(lambda: len(marked(mark)) == 3, "its processes")
    hosts.close_all()
    assert marked(mark) == []


def test_all_processes_that_a_law_started_end_when_it_is_killed():
    mark = f"flexlab-test-{os.getpid()}-died"
    world = world_of(CHILDREN.format(mark=mark) + at_work("if at.time > 0.003: os.kill(os.getpid(), 9)"))
    wait_until(lambda: len(marked(mark)) == 3, "its processes")
    world.advance(20)
    assert world.status.failed
    assert "its process ended (signal 9)" in world.status.text
    wait_until(lambda: marked(mark) == [], "their end")


def test_all_processes_that_a_law_started_end_although_it_stopped_its_supervisor():
    mark = f"flexlab-test-{os.getpid()}-stopped"
    law = LawApart(CHILDREN.format(mark=mark) + "os.kill(os.getppid(), 19)\n" + PD, "own_pd.py")
    law.ensure()
    wait_until(lambda: len(marked(mark)) == 3, "its processes")
    law.dispose()
    assert marked(mark) == []


def test_a_closed_law_leaves_no_file_open():
    gc.collect()
    before = os.listdir("/proc/self/fd")
    law = LawApart(PD, "own_pd.py")
    law.ensure()
    law.close()
    law.ensure()
    law.close()
    del law
    gc.collect()
    assert len(os.listdir("/proc/self/fd")) == len(before)


def test_all_processes_that_a_law_started_end_although_it_killed_its_supervisor():
    mark = f"flexlab-test-{os.getpid()}-supervisor"
    world = world_of(
        CHILDREN.format(mark=mark) + at_work("if at.time > 0.003: os.kill(os.getppid(), 9); time.sleep(9)")
    )
    wait_until(lambda: len(marked(mark)) == 3, "its processes")
    world.advance(20)
    assert world.status.failed
    wait_until(lambda: marked(mark) == [], "their end")


FORKED_WHEN_LOADED = "import os\nif os.fork() == 0: os.setsid()\n"


@pytest.mark.parametrize("text", [at_work("if self.calls[0] == 9: os.fork()"), FORKED_WHEN_LOADED + PD])
def test_a_process_that_a_law_forks_does_not_answer_in_its_place(text: str):
    alone = world_of(PD, "alone.py")
    alone.advance(30)
    world = world_of(text)
    world.advance(30)
    assert not world.status.failed, world.status.text
    assert np.array_equal(world.state().y, alone.state().y)


def test_a_supervisor_that_its_law_stopped_ends_with_the_program(tmp_path: Path):
    file = f"flexlab-test-{os.getpid()}-halted.py"
    (tmp_path / file).write_text("import os\nos.kill(os.getppid(), 19)\n" + PD)
    program = (
        "from flexlab.own import hosts\nhosts.run_apart()\nfrom flexlab.own.law import add_own_law\n"
        f"from pathlib import Path\ntext = Path('{file}').read_text()\n"
        f"hosts.host_of(text, add_own_law(text, '{file}').kind)\nprint('ready', flush=True)\nimport os\nos._exit(0)\n"
    )
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, stdout=subprocess.DEVNULL, check=True)
    wait_until(lambda: marked(file) == [], "its process and the supervisor have ended")


def test_a_byte_order_mark_is_no_part_of_a_law(tmp_path: Path):
    (tmp_path / "own_pd.py").write_text(PD, encoding="utf-8-sig")
    assert LAW_FILES.text(tmp_path / "own_pd.py") == PD


def test_a_law_that_closes_its_connection_fails_with_a_reason():
    # Up to 10000: the number of the connection depends on the files that the parent had open.
    world = world_of(at_work("if at.time > 0.003: os.closerange(3, 10000)"))
    world.advance(20)
    assert world.status.failed
    assert "None" not in world.status.text


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_all_processes_that_a_law_started_end_with_a_killed_lab(number: int, tmp_path: Path):
    mark = f"flexlab-test-{os.getpid()}-lab-{number}"
    (tmp_path / "own_pd.py").write_text(CHILDREN.format(mark=mark) + PD)
    program = (
        "import time\nfrom flexlab.own import hosts\nhosts.run_apart()\n"
        "from flexlab.own.law import add_own_law\nfrom pathlib import Path\n"
        "law = add_own_law(Path('own_pd.py').read_text(), 'own_pd.py')\n"
        "hosts.host_of(Path('own_pd.py').read_text(), law.kind)\nprint('ready', flush=True)\ntime.sleep(600)\n"
    )
    lab = subprocess.Popen([sys.executable, "-c", program], cwd=tmp_path, stdout=subprocess.PIPE)
    assert lab.stdout is not None
    assert lab.stdout.readline() == b"ready\n"
    wait_until(lambda: len(marked(mark)) == 3, "its processes")
    lab.send_signal(number)
    lab.wait()
    wait_until(lambda: marked(mark) == [], "their end")
    lab.stdout.close()


def test_a_law_that_failed_is_named_although_a_study_has_started_it_again():
    """The lab's study of poles starts a failed law anew. The run then read no reason, and blamed "too late" torques."""
    text = at_work("if at.time > 0.01: 1 / 0")
    world = world_of(text)
    world.advance(100)
    controller = world.scenario.controller
    law = hosts.known_law(controller.source)
    assert isinstance(law, LawApart)
    assert "ZeroDivisionError" in world.status.text
    law.ensure()  # As each study does.
    assert law.problem == ""
    assert "ZeroDivisionError" in laws()[controller.kind].problem(controller)
    assert len(world_of(text).advance(3)) == 3
    assert laws()[controller.kind].problem(controller) == "", "it answers again"


def test_saving_a_law_many_times_leaves_few_processes_and_files_behind():
    file = f"/tmp/flexlab-test-{os.getpid()}-saved.py"
    world = world_of(PD, file)
    files = 0
    for number in range(LawApart.kept + 6):
        source = PD.replace("adds up its error", f"adds up its error {number}")
        add_own_law(source, file)
        world.apply(ChangeScenario({"controller.source": source}))
        assert len(world.advance(2)) == 2
        if number == LawApart.kept:
            files = len(os.listdir("/proc/self/fd"))
    assert len(marked(file)) <= 2 * LawApart.running
    assert len(os.listdir("/proc/self/fd")) <= files


BUSY = "import os\nos.sched_setaffinity(0, {{{processor}}})\nprint('busy', flush=True)\nwhile True: pass"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell who waits for a processor")
def test_a_wait_for_a_processor_counts_before_it_ends():
    """Linux counts a wait when it ends: a law that was waiting was once taken for one that works too long."""
    world = world_of(PD)
    assert len(world.advance(1)) == 1
    (host,) = hosts.known.values()
    assert isinstance(host, LawApart)
    command = [sys.executable, "-c", BUSY.format(processor=min(os.sched_getaffinity(0)))]
    crowd = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(2)]
    try:
        for one in crowd:
            assert one.stdout is not None
            assert one.stdout.readline() == b"busy\n"
        host._worker = crowd[0].pid
        os.sched_setscheduler(host._worker, os.SCHED_IDLE, os.sched_param(0))

        def waits() -> bool:
            before = host._look()
            time.sleep(PROBE)
            waited, after = host._waited(before), host._look()
            has_not_ended = (after.worked, after.waited) == (before.worked, before.waited)
            return has_not_ended and waited >= PROBE

        wait_until(waits, "a wait is seen as it goes on")
    finally:
        for one in crowd:
            one.kill()
            one.communicate()


@pytest.fixture
def without_reports_on_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on macOS, which has no /proc."""
    monkeypatch.setattr("flexlab.own.process.PROCESSES", tmp_path)


@pytest.mark.usefixtures("without_reports_on_processes")
def test_a_process_that_cannot_work_waits_where_nothing_reports_it():
    """On macOS, a law that waited 80 ms for a processor was stopped: "act did not answer within 50 ms"."""
    world = world_of(PD)
    assert len(world.advance(1)) == 1
    (host,) = hosts.known.values()
    assert isinstance(host, LawApart)
    os.kill(host._worker, signal.SIGSTOP)
    before = host._look()
    time.sleep(0.2)
    assert host._waited(before) >= 0.2
    os.kill(host._worker, signal.SIGCONT)
    assert len(world.advance(1)) == 1


@pytest.mark.usefixtures("without_reports_on_processes")
def test_an_endless_law_ends_where_nothing_reports_waits():
    world = world_of(at_work("while at.time > 0.0015: pass"))
    world.advance(5)
    assert "act did not answer within 50 ms" in world.status.text


def test_without_forks_an_own_law_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch):
    """As on Windows, where it was a traceback, and the page of studies an error."""
    monkeypatch.delattr(os, "fork")
    with pytest.raises(FlexlabError, match="run on Linux and macOS only: on Windows, start flexlab in WSL"):
        world_of(PD)


REPORTS = {
    "deep lists": "b'[' * 100_000 + b'\\n'",
    "deep objects": "b'{\"a\":' * 50_000 + b'\\n'",
    "no object": "b'{1}\\n[1]\\n7\\nnull\\n'",
    "other kinds": 'b\'{"problem": {}, "ready": [], "pid": "x"}\\n\'',
    "no end": "b'{' * 3_000_000",
    "no letters": "b'\\xff\\x00\\n{\\xff}\\n'",
}


@pytest.mark.parametrize("what", REPORTS)
def test_odd_data_from_a_law_in_place_of_reports_do_no_harm(what: str):
    writing = f"import socket\nif at.time < 0.004: socket.socket(fileno=os.dup(int(sys.argv[2]))).send({REPORTS[what]})"
    world = world_of(at_work(writing))
    (host,) = hosts.known.values()
    for _ in range(4):
        assert len(world.advance(2)) == 2
        assert host.problem == ""
    assert isinstance(host, LawApart)
    assert len(host._said) <= 2 * MOST_READ


def test_a_law_that_starts_too_many_processes_is_refused():
    mark = f"flexlab-test-{os.getpid()}-many"
    many = f'subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)", "{mark}"])'
    source = f"import subprocess, sys, time\nfor _ in range(40):\n    {many}\ntime.sleep(600)\n" + PD
    with pytest.raises(ScenarioError, match="it started more than 32 processes"):
        world_of(source)
    wait_until(lambda: marked(mark) == [], "their end")


def test_stop_loading_ends_a_law_that_is_still_loading():
    source = "import time\ntime.sleep(600)\n" + PD
    law = add_own_law(source, "slow.py")
    said: list[str] = []

    def load() -> None:
        try:
            hosts.host_of(source, law.kind)
        except ScenarioError as error:
            said.append(str(error))

    loading = threading.Thread(target=load)
    loading.start()
    wait_until(lambda: bool(hosts.known), "its process")
    time.sleep(0.5)
    hosts.stop_loading()
    loading.join(20)
    assert not loading.is_alive()
    assert "its process was ended" in said[0]


def test_a_lab_closes_while_a_law_loads():
    source = "import time\ntime.sleep(600)\n" + PD
    add_own_law(source, "slow.py")
    session = Session(load_preset("paper"), "paper")
    session.start()
    session.lab_state.change({"controller.kind": "own-pd"})
    wait_until(lambda: bool(hosts.known), "its process")
    closing = threading.Thread(target=session.stop)
    closing.start()
    closing.join(20)
    assert not closing.is_alive()


def test_a_command_ends_without_open_sockets(flexlab_process: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PYTHONWARNINGS", "error::ResourceWarning")
    (tmp_path / "law.py").write_text(PD, encoding="utf-8")
    (tmp_path / "path.py").write_text(ROUND, encoding="utf-8")
    done = flexlab_process("run", "paper", "--law", "law.py", "--path", "path.py", "--duration", "0.01")
    assert done.returncode == 0, done.stderr
    assert "ResourceWarning" not in done.stderr
