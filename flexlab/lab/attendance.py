"""Whether anybody is there: runs begin when a page has drawn them, and hold when nobody has looked for a minute."""

import time
from collections.abc import Callable

from flexlab.lab.lab_state import LabState
from flexlab.lab.page_reports import PageReports
from flexlab.lab.panel.text import number
from flexlab.sim.commands import Pause, Play
from flexlab.sim.runner import Runner

UNATTENDED_TIME = 60.0
"""s without a browser after which a lab holds, and so records nothing more: a reload takes ten."""


class Attendance:
    """Releases and holds the runs of one lab. `update` is to be called often, from one thread."""

    def __init__(
        self,
        runner: Runner,
        lab_state: LabState,
        reports: PageReports,
        longest: float = UNATTENDED_TIME,
        clock: Callable[[], float] = time.monotonic,
    ):
        """`longest`: s without a browser before the lab holds."""
        self._runner, self._lab_state, self._reports = runner, lab_state, reports
        self._longest, self._clock = longest, clock
        self._seen_at = clock()
        self._held_run = 0

    def update(self) -> None:
        """Look who is there, and act on it."""
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
        """Somebody has come: what was held for want of them goes on."""
        snapshot = self._runner.snapshot
        if self._held_run == snapshot.run_number and not snapshot.playing:
            time_now = number(float(snapshot.latest.time[0]), 5)
            self._lab_state.say(f"This lab held at t = {time_now} s while nobody looked: it goes on.")
            self._lab_state.submit(Play())
        self._held_run = 0
