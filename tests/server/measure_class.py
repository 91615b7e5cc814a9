"""Measure what a class costs the server: python tests/server/measure_class.py [labs=25].

The script starts `flexlab --private`. Visitors open labs one after another, each as a browser does (page and live connection),
and all but the first leave again. It prints how long opening took, the memory and processor time of a lab, the speed of the
first lab, and the cost and delay of the teacher's page.
"""

import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # pytest adds this folder itself; a script must do so.
from http_client import ask, looking, post
from lab_process import Lab
from waiting import wait_until

WATCHED = 20.0
"""Time over which processor time is measured, s."""
POLL = 0.4
"""Time between two requests of the teacher's page, s."""


def open_lab(url: str) -> tuple[dict[str, str], str, float]:
    """Open a new visitor's lab; return (cookies, path, time until page and live connection were there, s)."""
    begun = time.monotonic()
    sent_on = ask(url, "/lab/")
    cookies, path = sent_on.cookies, sent_on.headers["Location"]
    assert ask(url, path, cookies=cookies).status == 200
    with looking(url, path.rstrip("/"), cookies):
        return cookies, path.rstrip("/"), time.monotonic() - begun


def processor_time(process: psutil.Process) -> float:
    """User and system time of a process, s."""
    times = process.cpu_times()
    return times.user + times.system


def told(url: str) -> dict[str, dict]:
    """Path of each lab → its state, as the teacher's page gets it."""
    return {lab["lab"]: lab for lab in json.loads(ask(url, "/teacher/labs").text)["labs"]}


def labs_of(server: psutil.Process) -> list[psutil.Process]:
    """The processes of the labs; on Linux they are children of the process that forks them."""
    return [lab for child in server.children() for lab in child.children()] or server.children()


def measure_labs(server: psutil.Process, url: str, first: str) -> None:
    """Print memory and processor time of the labs while somebody looks at the first one."""
    labs = labs_of(server)
    memory = [lab.memory_full_info().uss / 1e6 for lab in labs]
    print(f"memory of its own: median {statistics.median(memory):.0f} MB, most {max(memory):.0f} MB")
    before = {lab.pid: processor_time(lab) for lab in labs}
    begun, simulated = time.monotonic(), told(url)[first]["time"]
    time.sleep(WATCHED)
    took = time.monotonic() - begun
    print(f"the active lab: {(told(url)[first]['time'] - simulated) / took:.2f} times real time")
    share = sorted(100 * (processor_time(lab) - before[lab.pid]) / took for lab in labs)
    print(f"processor: active {share.pop():.0f} %, idle", end=" ")
    print(f"median {statistics.median(share):.2f} %, most {max(share):.2f} % of a core")


def measure_teacher(server: psutil.Process, url: str, first: str) -> None:
    """Print what an open teacher's page costs the server, and how long a pause takes to show on it."""

    def spent(looks: bool) -> float:
        before, end = processor_time(server), time.monotonic() + WATCHED
        while time.monotonic() < end:
            begun = time.monotonic()
            if looks:
                told(url)
            time.sleep(max(0.0, POLL - (time.monotonic() - begun)))
        return 100 * (processor_time(server) - before) / WATCHED

    without, with_page = spent(False), spent(True)
    print(
        f"teacher's page: {with_page - without:.2f} % of a core (the server: {without:.2f} % without, {with_page:.2f} % with)"
    )
    late = []
    for action, state in 5 * (("pause", "paused"), ("resume", "running")):
        post(url, f"/teacher/{action}", {"lab": first})
        begun = time.monotonic()
        wait_until(lambda state=state: told(url)[first]["state"] == state, f"the page says {state}")
        late.append(time.monotonic() - begun)
    print(
        f"a change is told after {statistics.median(late):.2f} s, at most {max(late):.2f} s; the page asks every {POLL:g} s"
    )


def main() -> None:
    """Measure and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 25
    began = time.monotonic()
    lab = Lab(Path(tempfile.mkdtemp()), "--private", "--max-sessions", str(count), "--max-per-address", str(count))
    try:
        url = f"http://127.0.0.1:{lab.port()}"
        print(f"the server is open after {time.monotonic() - began:.1f} s")
        server = psutil.Process(lab.process.pid)
        cookies, first, took = open_lab(url)
        with looking(url, first, cookies):
            opening = [took, *(open_lab(url)[2] for _ in range(1, count))]
            print(f"opening: first {took:.1f} s, median {statistics.median(opening):.1f}, worst {max(opening):.1f}")
            time.sleep(2.0)
            measure_labs(server, url, first)
            measure_teacher(server, url, first)
    finally:
        lab.end()


if __name__ == "__main__":
    main()
