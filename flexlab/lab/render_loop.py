"""The drawing thread: brings the newest snapshot to the screen, 30 times a second, plots and readouts every third time."""

import threading
import time
from collections.abc import Callable

import viser

from flexlab.errors import telling
from flexlab.lab.lab_state import LabState
from flexlab.lab.page_reports import PageReports
from flexlab.lab.viser_internals import GuardedServer
from flexlab.sim.commands import Pause, Play
from flexlab.text import number_text

UNATTENDED_TIME = 60.0
"""Seconds without a browser after which a lab pauses, and so records no more; a reload takes ten."""


class Attendance:
    """Starts runs that a browser has drawn, and pauses them while no browser is connected. One thread calls `update` often."""

    def __init__(
        self,
        lab_state: LabState,
        reports: PageReports,
        longest: float = UNATTENDED_TIME,
        clock: Callable[[], float] = time.monotonic,
    ):
        """`longest`: seconds without a browser before the lab pauses."""
        self._runner, self._lab_state, self._reports = lab_state.runner, lab_state, reports
        self._longest, self._clock = longest, clock
        self._seen_at = clock()
        self._held_run = 0

    def update(self) -> None:
        """Release or pause the run, depending on who is connected."""
        snapshot = self._runner.snapshot
        if self._reports.count:
            self._seen_at = self._clock()
            self._go_on()
            if snapshot.waiting and self._reports.have_drawn(snapshot.run_number):
                self._runner.release(snapshot.run_number)
        elif snapshot.playing and not snapshot.waiting and self._clock() - self._seen_at > self._longest:
            if self._held_run != snapshot.run_number:
                self._held_run = snapshot.run_number
                self._lab_state.submit(Pause())

    def _go_on(self) -> None:
        """Resume a run that was paused because no browser was connected."""
        snapshot = self._runner.snapshot
        if self._held_run == snapshot.run_number and not snapshot.playing and not self._lab_state.rules.locked:
            time_now = number_text(float(snapshot.latest.time[0]), 5)
            self._lab_state.say(f"This lab paused at t = {time_now} s while nobody watched: it runs again.")
            self._lab_state.submit(Play())
        self._held_run = 0


FRAME_TIME = 1 / 30
"""Wall seconds per picture."""
READOUT_EVERY = 3
"""Pictures per update of plots and readouts: 10 Hz, as fast as numbers can be read."""
SELDOM = 10
"""Updates per one of what takes longer to find, or to read: 1 Hz."""

UNSEEN_TIME = 0.25
"""Wall seconds between two checks for browsers; a new connection also wakes the thread at once."""


class RenderLoop:
    """Owns the drawing thread. While nobody looks it does nothing."""

    def __init__(
        self,
        server: GuardedServer,
        lab_state: LabState,
        draw: Callable[[bool, bool], None],
        attendance: Attendance | None,
    ):
        """`draw(readouts, all_of_them)` draws a picture, with plots and numbers or without, and with what is found seldom.

        `attendance`: releases and holds runs; None: they run whoever looks.
        """
        self._server, self._lab_state, self._draw, self._attendance = server, lab_state, draw, attendance
        self._stop, self._come = threading.Event(), threading.Event()
        server.on_client_connect(self._greet)
        self._thread = threading.Thread(target=self._run, name="flexlab-drawing", daemon=True)

    def start(self) -> None:
        """Start drawing."""
        self._thread.start()

    def stop(self) -> None:
        """Stop drawing; returns when the thread is done."""
        self._stop.set()
        self._come.set()
        if self._thread.is_alive():
            self._thread.join()

    async def _greet(self, _: viser.ClientHandle) -> None:
        self._come.set()

    def _run(self) -> None:
        frame = 0
        while not self._stop.is_set():
            self._come.clear()
            began = time.monotonic()
            if self._attendance is not None:
                self._attendance.update()
            seen = bool(self._server.get_clients())
            if frame == 0 or seen:
                with telling(self._lab_state.warn, "Drawing failed ({}); the simulation goes on."):
                    self._draw(frame % READOUT_EVERY == 0, frame % (READOUT_EVERY * SELDOM) == 0)
                frame += 1
            if seen:
                self._stop.wait(max(FRAME_TIME - (time.monotonic() - began), 0.002))
            else:
                self._come.wait(UNSEEN_TIME)
