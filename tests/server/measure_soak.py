"""Measure a long lesson: python tests/server/measure_soak.py [minutes=10] [browsers=4] [other labs=20].

The script starts `flexlab --private`. Some visitors look at their labs in a real browser all the time and change a number every
half minute; the others open theirs and leave. Every minute it prints the simulated seconds per second of each watched lab, the
memory of server and labs, and the machine's load; at the end, how many samples the recordings lost.
"""

import os
import re
import sys
import tempfile
import time
from pathlib import Path

import psutil
from playwright.sync_api import Page, sync_playwright

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # pytest adds this folder itself; a script must do so.
from browser_window import BY_THE_PROCESSOR, SOFTWARE_RENDERING, open_window
from get_browser import find_browser
from lab_process import Lab
from measure_class import open_lab, told
from waiting import wait_until

from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import list_runs

MINUTE, CHANGE = 60.0, 30.0
"""Times between two printed lines, and between two changes of a number in each page, s."""
STIFFNESS = (80.0, 150.0)
"""Bending stiffnesses that the pages alternate between, N·m²: soft enough to ring, stiff enough to be accepted."""

BOX = re.compile(r" EI \((?!.*slider)")
"""The label of the number box of the bending stiffness."""


def memory(server: psutil.Process) -> float:
    """Unshared memory of the server and its labs, MB."""
    return sum(each.memory_full_info().uss for each in [server, *server.children(recursive=True)]) / 1e6


def open_pages(browser, url: str, count: int) -> list[Page]:
    """Open pages with labs of their own; return them once each shows its panel."""
    pages = []
    for _ in range(count):
        page = open_window(browser, 1024, 700).new_page()
        page.goto(f"{url}/lab/", timeout=120_000)
        page.get_by_label(BOX).first.wait_for(state="attached", timeout=120_000)
        pages.append(page)
    return pages


def change_stiffness(page: Page, value: float) -> None:
    """Type a bending stiffness, N·m²."""
    page.get_by_label(BOX).first.fill(f"{value:g}", force=True)


def main() -> None:
    """Measure and print."""
    numbers = [float(word) for word in sys.argv[1:]]
    minutes, browsers, beside = (*numbers, *(10.0, 4.0, 20.0)[len(numbers) :])
    count = int(browsers + beside)
    folder = Path(tempfile.mkdtemp())
    lab = Lab(folder, "--private", "--max-sessions", str(count), "--max-per-address", str(count))
    try:
        with sync_playwright() as playwright:
            url, server = f"http://127.0.0.1:{lab.port()}", psutil.Process(lab.process.pid)
            for _ in range(int(beside)):
                open_lab(url)
            others = set(told(url))
            browser = playwright.chromium.launch(
                executable_path=find_browser(), args=[*SOFTWARE_RENDERING, BY_THE_PROCESSOR]
            )
            pages = open_pages(browser, url, int(browsers))
            watched = sorted(set(told(url)) - others)
            wait_until(lambda: all(told(url)[name]["state"] == "running" for name in watched), "all play")
            begun = time.monotonic()
            start = before = {name: told(url)[name]["time"] for name in watched}
            last, changed, turn = begun, begun, 0
            print(f"{len(watched)} labs watched, {len(others)} beside; {memory(server):.0f} MB", flush=True)
            while time.monotonic() - begun < minutes * MINUTE:
                pages[turn % len(pages)].wait_for_timeout(500)
                if time.monotonic() - changed > CHANGE / len(pages):
                    change_stiffness(pages[turn % len(pages)], STIFFNESS[turn // len(pages) % 2])
                    changed, turn = time.monotonic(), turn + 1
                if time.monotonic() - last > MINUTE:
                    now, took = told(url), time.monotonic() - last
                    paces = [(now[name]["time"] - before[name]) / took for name in watched]
                    before, last = {name: now[name]["time"] for name in watched}, time.monotonic()
                    line = " ".join(f"{pace:.3f}" for pace in paces)
                    print(f"pace {line}; {memory(server):.0f} MB; load {os.getloadavg()[0]:.1f}", flush=True)
            now, took = told(url), time.monotonic() - begun
            whole = [(now[name]["time"] - start[name]) / took for name in watched]
            print("whole: pace", " ".join(f"{pace:.4f}" for pace in whole), flush=True)
            browser.close()
    finally:
        lab.end()
    runs = list_runs(folder / "logs")
    print(f"{len(runs)} recordings, {sum(read_notes(run).get('dropped', 0) for run in runs)} samples lost")
    print("".join(lab.complained)[-2000:])


if __name__ == "__main__":
    main()
