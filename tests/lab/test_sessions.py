"""Sessions start where they are asked to, say why when they cannot, and leave nothing behind."""

import ctypes
import gc
import os
import socket
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import psutil
import pytest
from lab_page import wait_until
from raw_browser import RawBrowser

from flexlab.errors import LabError
from flexlab.lab.session import Session
from flexlab.presets import load_preset

MANY = 25
"""Sessions after which a leak would show."""


def kept_memory() -> int:
    """Resident memory, bytes, without freed memory that the allocator still holds, which varies by megabytes."""
    if sys.platform == "linux" and (trim := getattr(ctypes.CDLL(None), "malloc_trim", None)):
        trim(0)
    return psutil.Process(os.getpid()).memory_info().rss


def open_sockets() -> int:
    return len(psutil.Process().net_connections(kind="inet"))


def test_a_busy_port_is_named_and_nothing_is_left_running() -> None:
    threads = threading.active_count()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        session = Session(load_preset("paper"), port=port)
        with pytest.raises(LabError, match=f"port {port} is in use"):
            session.start()
        session.stop()
    wait_until(lambda: threading.active_count() <= threads, "no thread is left", 10)


def test_two_labs_in_one_process_do_not_touch_each_other() -> None:
    from flexlab.sim.commands import ChangeScenario

    with Session(load_preset("paper")) as one, Session(load_preset("soft-beam")) as two:
        assert one.port != two.port
        with RawBrowser(one), RawBrowser(two):
            one.runner.submit(ChangeScenario({"payload.bending_stiffness": 7.0}))
            wait_until(lambda: one.runner.snapshot.scenario.payload.bending_stiffness == 7.0, "the change is taken", 20)
            assert two.runner.snapshot.scenario == load_preset("soft-beam")


def test_labs_that_start_and_stop_together_are_quiet_and_leave_standard_output_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    output, all_run = sys.stdout, threading.Barrier(4, timeout=60)

    def live_shortly(_: int) -> None:
        with Session(load_preset("paper")):
            all_run.wait()

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(live_shortly, range(4)))
    assert sys.stdout is output
    assert capsys.readouterr().out == ""


def receive_picture(browser: RawBrowser) -> None:
    """Wait for a message of more than 1000 bytes; what the first one contains depends on when it is sent."""
    while len(browser.receive(20)) <= 1000:
        pass


def test_a_browser_gets_pictures_and_a_late_one_sees_the_running_state(session: Session) -> None:
    with RawBrowser(session) as first:
        receive_picture(first)
        wait_until(lambda: float(session.runner.snapshot.latest.time[0]) > 0.3, "time passes", 20)
        with RawBrowser(session) as late:
            receive_picture(late)


def test_a_connection_has_a_short_send_buffer(session: Session) -> None:
    with RawBrowser(session):
        connections = session.server._websock_server._live_connections
        wait_until(lambda: connections, "the browser is connected", 20)
        plug = next(iter(connections.values())).transport.get_extra_info("socket")
        # Linux answers with twice the size that was asked for.
        wait_until(lambda: plug.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) <= 2 * 64 * 1024, "a short buffer", 20)


def test_nothing_is_drawn_while_nobody_looks() -> None:
    with Session(load_preset("paper")) as session:
        buffer = session.server._websock_server._broadcast_buffer

        def is_still() -> bool:
            before = buffer.message_counter
            time.sleep(0.5)
            return buffer.message_counter == before

        wait_until(is_still, "nothing is sent for half a second", 20)
        wait_until(lambda: float(session.runner.snapshot.latest.time[0]) > 0.3, "time goes on", 20)


def test_many_sessions_leave_nothing_behind() -> None:
    scenario = load_preset("paper")

    def live_shortly() -> None:
        with Session(scenario) as session, RawBrowser(session) as browser:
            browser.receive(20)
        gc.collect()

    for _ in range(5):
        live_shortly()
    threads, sockets, memory = threading.active_count(), open_sockets(), [kept_memory()]
    for _ in range(2):
        for _ in range(MANY // 2):
            live_shortly()
        wait_until(lambda: threading.active_count() <= threads, "threads are back to where they were", 20)
        wait_until(lambda: open_sockets() <= sockets, "sockets are back to where they were", 20)
        memory.append(kept_memory())
    # A leak of sessions grows in both rounds; what anything else in this process takes, it takes once.
    grown = min(after - before for before, after in pairwise(memory)) / (MANY // 2)
    assert grown < 200_000, f"{grown:.0f} bytes per session stay behind"
