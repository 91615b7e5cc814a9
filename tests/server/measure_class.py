"""Measures a class, as a script: python tests/server/measure_class.py [25].

Visitors open private labs one after another, each as a browser does (page and live connection), and leave again but for the
first, who goes on looking. Says how long each took, what memory and processor time a lab costs, and the first one's speed.
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # As pytest does, for who runs this file by itself.
from http_client import ask, looking

from flexlab.presets import load_preset
from flexlab.server.front_server import FrontServer, open_front_server
from flexlab.server.settings import Settings

WATCHED = 20.0
"""s over which processor time is measured."""


def open_lab(server: FrontServer, number: int) -> tuple[dict[str, str], str, float]:
    """(cookies, path, s until page and live connection were there) of a visitor's lab."""
    cookies, begun = {f"flexlab-visitor-{server.port}": f"visitor-{number:012d}"}, time.monotonic()
    path = ask(server.url, "/lab/", cookies=cookies).headers["Location"]
    assert ask(server.url, path, cookies=cookies).status == 200
    with looking(server.url, path.rstrip("/"), cookies):
        return cookies, path.rstrip("/"), time.monotonic() - begun


def processor_time(process: psutil.Process) -> float:
    """s, user and system."""
    times = process.cpu_times()
    return times.user + times.system


def main() -> None:
    """Measure and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 25
    settings = Settings(
        Path(tempfile.mkdtemp()), port=0, private=True, max_sessions=count, max_per_address=count, shadows=False
    )
    with open_front_server(settings, load_preset("paper"), "paper") as server:
        cookies, first, took = open_lab(server, 0)
        with looking(server.url, first, cookies):
            opening = [took, *(open_lab(server, number)[2] for number in range(1, count))]
            print(
                f"opening: first {opening[0]:.1f} s, median {statistics.median(opening):.1f}, worst {max(opening):.1f}"
            )
            time.sleep(2.0)
            labs = {place.worker.pid: place for place in server.places.running()}  # type: ignore[attr-defined]
            processes = {pid: psutil.Process(pid) for pid in labs}
            memory = [process.memory_full_info().uss / 1e6 for process in processes.values()]
            print(f"memory of its own: median {statistics.median(memory):.0f} MB, most {max(memory):.0f} MB")
            before = {pid: processor_time(process) for pid, process in processes.items()}
            active = next(place for place in labs.values() if place.path == first)
            begun, simulated = time.monotonic(), active.status().time
            time.sleep(WATCHED)
            took = time.monotonic() - begun
            print(f"the active lab: {(active.status().time - simulated) / took:.2f} times real time")
            share = {pid: 100 * (processor_time(processes[pid]) - before[pid]) / took for pid in processes}
            print(f"processor: active {share.pop(active.worker.pid):.0f} %, idle", end=" ")
            print(f"median {statistics.median(share.values()):.2f} %, most {max(share.values()):.2f} % of a core")


if __name__ == "__main__":
    main()
