"""Drag every slider of the panel as a page does, 20 values a second for 3 s, and report how the lab keeps up.

    python tests/lab/measure_drags.py [elements ...]

The page is a connection without a picture, in a process of its own: without a graphics card, a real page would leave the lab
little of two processors. Each line gives simulated over wall time during the drag and in the second half of the second after
it, the longest time that the picture stood still, and the delay from sending a value to the first state that has it (median,
p95). For each given number of elements, the sliders of stiffness and mesh are dragged again.
"""

import multiprocessing
import statistics
import sys
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import msgspec.msgpack
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # As pytest does, for running this file by itself.
from raw_browser import open_socket

from flexlab.lab.session import Session
from flexlab.presets import load_preset

PERIOD, SECONDS = 0.05, 3.0
"""Time between two values, and duration of a drag, s."""
SPAN = 0.2
"""Share of a slider's range that is dragged over, centred on its value."""


class Drag(NamedTuple):
    """The results of one drag."""

    pace: float
    after: float
    longest: float
    """Longest time that the picture stood still, s."""
    delays: list[float]
    """Time from sending each new value to the first state that has it, s."""


def page(address: str, pipe: Connection) -> None:
    """Send the values that the pipe asks for, and read what the lab sends meanwhile."""
    socket = open_socket(address)
    while True:
        wanted = None
        if pipe.poll():
            wanted = pipe.recv()
        if wanted is None:
            _take_in(socket, 0.05)
            continue
        uuid, values = wanted
        begin, sent = time.monotonic(), []
        for k, value in enumerate(values):
            sent.append((value, time.monotonic()))
            socket.send(msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}))
            _take_in(socket, begin + (k + 1) * PERIOD - time.monotonic())
        pipe.send(sent)


def _take_in(socket: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        try:
            socket.recv(timeout=left)
        except TimeoutError:
            return


def values_of(handle: Any) -> list[float]:
    """The values of a drag to and fro, rounded to the slider's steps."""
    low, high, step = handle.min, handle.max, handle.step
    half = SPAN * (high - low) / 2
    phase = 2 * np.pi * np.arange(round(SECONDS / PERIOD)) / 20
    wished = np.clip(handle.value + half * np.sin(phase), low, high)
    return [type(handle.value)(low + round((value - low) / step) * step) for value in wished]


def drag(session: Session, pipe: Connection, handle: Any, values: Sequence[float]) -> Drag:
    """Drag one slider."""
    runner = session.runner

    def now() -> tuple[int, float]:
        snapshot = runner.snapshot
        return snapshot.run_number, snapshot.latest.time[0]

    (run, last), simulated, stood, longest = now(), 0.0, time.monotonic(), 0.0
    begin, scenarios = time.monotonic(), [(time.monotonic(), runner.snapshot.scenario)]
    pipe.send((handle._impl.uuid, list(values)))
    while not pipe.poll():
        time.sleep(0.002)
        (run_now, t), instant = now(), time.monotonic()
        simulated += t - last if t >= last else t
        if (run_now, t) != (run, last):
            longest, stood = max(longest, instant - stood), instant
        run, last = run_now, t
        scenario = runner.snapshot.scenario
        if scenario is not scenarios[-1][1]:
            scenarios.append((instant, scenario))
    wall, sent = time.monotonic() - begin, pipe.recv()
    time.sleep(0.5)
    (_, before), start = now(), time.monotonic()
    time.sleep(0.5)
    after = (now()[1] - before) / (time.monotonic() - start)
    arrivals = [instant for instant, _ in scenarios[1:]]
    changes = [when for (value, when), (before, _) in zip(sent[1:], sent, strict=False) if value != before]
    delays = [min((a - when for a in arrivals if a >= when), default=np.nan) for when in changes]
    return Drag(simulated / wall, after, longest, [delay for delay in delays if delay == delay])


def report(label: str, found: Drag) -> None:
    """Print one line."""
    delays = sorted(found.delays)
    words = (
        f"{1e3 * statistics.median(delays):4.0f} {1e3 * delays[int(0.95 * len(delays))]:4.0f}"
        if delays
        else "no change"
    )
    print(f"{label:34} {found.pace:5.2f} {found.after:5.2f}  {1e3 * found.longest:4.0f} ms  {words} ms", flush=True)


def sliders(session: Session) -> dict[str, Any]:
    """The panel's sliders by label."""
    handles = session.server.gui._gui_input_handle_from_uuid.values()
    found = [handle for handle in handles if type(handle).__name__ == "GuiSliderHandle" and not handle.disabled]
    return {f"{handle._impl.props.label} [{handle.min:g}, {handle.max:g}]": handle for handle in found}


def measure(elements: int | None) -> None:
    """Print a line per slider; for a given number of elements, only for stiffness and mesh."""
    context = multiprocessing.get_context("spawn")
    scenario = load_preset("paper").replace({"payload.element_count": elements or 2})
    with Session(scenario, "paper", shadows=False) as session:
        pipe, far = context.Pipe()
        process = context.Process(target=page, args=(session.url.replace("http", "ws"), far), daemon=True)
        process.start()
        time.sleep(6)
        print(f"n = {elements or 2:<30} pace after longest   median p95")
        for label, handle in sliders(session).items():
            if elements is None or "stiffness EI" in label:
                report(label, drag(session, pipe, handle, values_of(handle)))
            elif "lements" in label:
                wave = np.linspace(4, elements, 20).round().tolist()
                report(label, drag(session, pipe, handle, [int(value) for value in (wave + wave[::-1]) * 2][:60]))
        process.terminate()


def main() -> None:
    """Measure the paper's beam, then a beam with each given number of elements."""
    for elements in [None, *map(int, sys.argv[1:])]:
        measure(elements)


if __name__ == "__main__":
    main()
