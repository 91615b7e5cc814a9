"""The drawing thread: brings the newest snapshot to the screen, 30 times a second, plots and readouts every third time."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import viser

from flexlab.lab.lab_state import LabState
from flexlab.lab.look_back import LookBack
from flexlab.lab.page_reports import PageReports
from flexlab.lab.panel.panel import Panel
from flexlab.lab.plots.plots import Plots
from flexlab.lab.scene.cameras import ClientCameras
from flexlab.lab.scene.scene import Scene
from flexlab.lab.viser_internals import GuardedServer
from flexlab.log_limits import limited
from flexlab.sim.commands import Pause, Play
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Snapshot
from flexlab.text import number_text

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
        if self._held_run == snapshot.run_number and not snapshot.playing and not self._lab_state.rules.locked:
            time_now = number_text(float(snapshot.latest.time[0]), 5)
            self._lab_state.say(f"This lab held at t = {time_now} s while nobody looked: it goes on.")
            self._lab_state.submit(Play())
        self._held_run = 0


FRAME_TIME = 1 / 30
"""Wall seconds per picture."""
READOUT_EVERY = 3
"""Pictures per update of plots and readouts: 10 Hz, as fast as numbers can be read."""

UNSEEN_TIME = 0.25
"""Wall seconds between two looks whether somebody has come: who comes is seen at once, so this bounds nothing that shows."""

log = limited(__name__)


class Readout(Protocol):
    """What follows the run, a few times a second."""

    def update(self, snapshot: Snapshot) -> None:
        """Bring it up to date."""


class RenderLoop:
    """Owns the thread. It only reads the runner; while nobody looks it does nothing."""

    def __init__(
        self,
        server: GuardedServer,
        runner: Runner,
        lab_state: LabState,
        look_back: LookBack,
        scene: Scene,
        cameras: ClientCameras,
        panel: Panel,
        plots: Plots,
        readouts: Sequence[Readout],
        sound: Readout,
        reports: PageReports,
        attendance: Attendance | None,
    ):
        """`readouts`: what else follows the run; `sound`: as often as the picture.

        `attendance`: who releases and holds runs; None: nobody has to look.
        """
        self._server, self._runner, self._lab_state, self._look_back = server, runner, lab_state, look_back
        self._scene, self._cameras, self._panel, self._plots, self._readouts = scene, cameras, panel, plots, readouts
        self._sound, self._reports, self._attendance = sound, reports, attendance
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
                try:
                    self._draw(frame % READOUT_EVERY == 0)
                except Exception as error:
                    log.exception("drawing failed")
                    self._lab_state.say(
                        f"Drawing failed ({type(error).__name__}: {error}); the simulation goes on.", "error"
                    )
                frame += 1
            if seen:
                self._stop.wait(max(FRAME_TIME - (time.monotonic() - began), 0.002))
            else:
                self._come.wait(UNSEEN_TIME)

    def _draw(self, readouts: bool) -> None:
        snapshot, view = self._runner.snapshot, self._lab_state.view
        seen = self._look_back.seen(snapshot)
        self._scene.update(seen, view, self._lab_state.pulled, self._lab_state.kept)
        if self._reports.somebody_hears:
            with self._server.inputs:
                self._sound.update(seen)
        self._reports.show_run(snapshot.run_number, snapshot.name)
        self._cameras.follow(seen)
        if readouts:
            with self._server.inputs:
                self._panel.update(snapshot, seen, self._scene.legend(view))
                for readout in self._readouts:
                    readout.update(snapshot)
            opened = self._reports.open_charts()
            self._plots.update(self._look_back.recent, seen, view, self._lab_state.kept, opened)
