"""One lab: its server for browsers, its simulation, its drawing thread, and its recorder."""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack

import viser

from flexlab.errors import LabError, telling
from flexlab.lab.lab_state import LabState, Outside
from flexlab.lab.look_back import LookBack
from flexlab.lab.mode_computation import ModeStudy
from flexlab.lab.own_file_watch import OwnFileWatch
from flexlab.lab.page_reports import GUIDE, PAGE_SCRIPT, PAGE_SHEET, PLOTS, PageReports, Report
from flexlab.lab.panel.guide_panel import Guide
from flexlab.lab.panel.panel import Panel
from flexlab.lab.panel.readouts import SpokenSummary
from flexlab.lab.picking import Picking
from flexlab.lab.plots.plots import ExplanationList, Plots
from flexlab.lab.ring_sound import RingSound
from flexlab.lab.scene.cameras import FIELD_OF_VIEW, ClientCameras, Window, first_view
from flexlab.lab.scene.scene import Scene
from flexlab.lab.viser_internals import GuardedServer, fold_panel, set_panel_width
from flexlab.lab.viser_server import InputGuard, open_server
from flexlab.lab.widgets import Widgets
from flexlab.own import hosts
from flexlab.scenario import Scenario
from flexlab.sim.commands import Pause, Play
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Origin
from flexlab.sim.snapshot import Consumer
from flexlab.sockets import LOOPBACK, base_address
from flexlab.text import number_text

UNATTENDED_TIME = 60.0
"""Time without a browser after which a lab pauses, and so stops recording, s; a reload takes ten."""
FRAME_TIME = 1 / 30
"""Time per picture, wall s."""
READOUT_EVERY = 3
"""Pictures per update of plots and readouts: 10 Hz, as fast as numbers can be read."""
SELDOM = 10
"""Updates of plots per update of what takes longer to compute or to read: 1 Hz."""
UNSEEN_TIME = 0.25
"""Time between two checks for browsers, wall s; a new connection also wakes the thread at once."""
PANEL_WIDTH, NARROW_PANEL = 330, 300
"""Width of the panel, px, which fits the longest label with its unit on one line, and its width in a narrow window."""
NARROW_WINDOW = 1200
"""Windows narrower than this, px, get the narrow panel."""
GUIDE_WIDTH, FOLDED_WIDTH = 280, 36
"""Width of the guide's column, px, open and folded."""
PLOTS_HEIGHT, GAP = 248, 8
"""Height of the plots' panel (a row of charts with two-line legends) and its distance from the picture's edges, px."""
FIRST_WINDOW = Window(1.0)
"""The window that is assumed until a browser reports its own."""


class Attendance:
    """Starts a run when a browser has drawn it, and pauses it while none is connected. One thread calls `update` often."""

    def __init__(
        self,
        lab_state: LabState,
        reports: PageReports,
        longest: float = UNATTENDED_TIME,
        clock: Callable[[], float] = time.monotonic,
    ):
        """`longest`: time without a browser before the lab pauses, s."""
        self._runner, self._lab_state, self._reports = lab_state.runner, lab_state, reports
        self._longest, self._clock = longest, clock
        self._seen_at = clock()
        self._held_run = 0

    def update(self) -> None:
        """Release or pause the run, depending on who is connected."""
        snapshot = self._runner.snapshot
        if self._reports.count:
            self._seen_at = self._clock()
            if self._held_run == snapshot.run_number and not snapshot.playing and not self._lab_state.rules.locked:
                time_now = number_text(float(snapshot.latest.time[0]), 5)
                self._lab_state.say(f"This lab paused at t = {time_now} s while nobody watched: it runs again.")
                self._lab_state.submit(Play())
            self._held_run = 0
            if snapshot.waiting and self._reports.have_drawn(snapshot.run_number):
                self._runner.release(snapshot.run_number)
        elif snapshot.playing and not snapshot.waiting and self._clock() - self._seen_at > self._longest:
            if self._held_run != snapshot.run_number:
                self._held_run = snapshot.run_number
                self._lab_state.submit(Pause())


class RenderLoop:
    """Owns the drawing thread, which is idle while no browser is connected."""

    def __init__(
        self,
        server: GuardedServer,
        lab_state: LabState,
        draw: Callable[[bool, bool], None],
        attendance: Attendance | None,
    ):
        """`draw(readouts, all_of_them)` draws a picture: with plots and numbers if `readouts`, with slow ones if `all_of_them`.

        `attendance`: starts and pauses runs; None if they run whether or not anybody looks.
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


class Session:
    """A running lab. A process may have any number of them; each is started once and stopped once.

    `consumers`, such as a recorder, get every sample and event. `port`: on loopback, 0 for any free one. `shadows` take a slow
    graphics card most of its time. With an `origin`, the first run continues from there. With a `secret`, the page answers only
    requests that carry it. `attended`: a run begins when a browser has drawn it, and pauses while no browser is connected.
    """

    def __init__(
        self,
        scenario: Scenario,
        name: str = "scenario",
        *,
        consumers: Sequence[Consumer] = (),
        port: int = 0,
        playing: bool = True,
        shadows: bool = True,
        origin: Origin | None = None,
        secret: str = "",
        attended: bool = False,
        outside: Outside | None = None,
    ):
        hosts.run_apart()
        self._scenario, self._port, self._shadows = scenario, port, shadows
        self._secret, self._attended = secret, attended
        self.guard = InputGuard()
        """Checks every message of every browser, and counts the refused ones."""
        self.runner = Runner(scenario, name, consumers=consumers, playing=playing, origin=origin, hold_starts=attended)
        self.lab_state = LabState(self.runner, origin, outside)
        self._server: GuardedServer | None = None
        self._study = ModeStudy()
        self._closing = ExitStack()

    @property
    def server(self) -> GuardedServer:
        """The running server; raises `LabError` before `start` and after `stop`."""
        if self._server is None:
            raise LabError("This lab is not running: start it first.")
        return self._server

    @property
    def port(self) -> int:
        """The server's port: the requested one, or the one found for 0."""
        return self._server.get_port() if self._server else self._port

    @property
    def url(self) -> str:
        """The lab's address on this machine."""
        return base_address(LOOPBACK[0], self.port)

    def start(self) -> None:
        """Serve the page and start the simulation. Raises `LabError`, and leaves nothing running, if it cannot."""
        self._server = open_server(self._port, self.guard, self._secret, PAGE_SCRIPT, PAGE_SHEET)
        closing = self._closing
        closing.callback(self._server.stop)
        try:
            drawing, own_files = self._furnish(self._server), OwnFileWatch(self.lab_state)
            for part in (self.runner, self._study, drawing, own_files):
                closing.callback(part.stop)
            self.runner.start()
            drawing.start()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Stop drawing, simulation and server; returns when all threads are done. May be called twice."""
        hosts.stop_loading()
        self._closing.close()
        self.runner.stop()  # Even if it never started.
        self._server = None

    def __enter__(self) -> "Session":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _furnish(self, server: GuardedServer) -> RenderLoop:
        lab_state = self.lab_state
        lab_state.company = lambda: len(server.get_clients())
        gui, runner, study = server.gui, self.runner, self._study
        widgets = Widgets(gui, lab_state)
        self._look_back = look_back = LookBack(lab_state)
        touch = Picking(widgets, self.guard.silence)
        self._scene = Scene(server, self._scenario, study, touch, self._shadows)
        self._cameras = ClientCameras(server, runner)
        board, reading = gui.add_panel(), gui.add_panel()
        self._panel = Panel(
            widgets,
            look_back,
            study,
            touch,
            self._cameras.choose,
            lambda client: fold_panel(client, board, not self._reports.toggle_presentation(client)),
            lambda client: self._reports.say(client, summary.text),
        )
        self._plots = Plots(gui, board, self._scenario, lab_state.view.plot_window)
        explanations = ExplanationList(gui, runner, study, self._plots.homes)
        summary = SpokenSummary(gui, runner, look_back, lambda: explanations.sentences)
        with reading.add_tab("Guide"):
            guide = Guide(widgets)
        self._readouts = (guide, explanations, summary, self._panel.comparing)

        def arrange(client: viser.ClientHandle, report: Report) -> None:
            panel_width = PANEL_WIDTH if report.width >= NARROW_WINDOW else NARROW_PANEL
            set_panel_width(client, gui.main_panel, panel_width)
            set_panel_width(client, board, max(report.width - panel_width - FOLDED_WIDTH - 2 * GAP, PANEL_WIDTH))
            for name, foldable in ((GUIDE, reading), (PLOTS, board)):
                if name in report.open:
                    fold_panel(client, foldable, False)

        first = runner.snapshot
        again = widgets.handler(lambda _: lab_state.back_to_baseline())
        self._reports = PageReports(server, first.run_number, first.name, arrange, self._cameras.cover, again)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        board.float(x=GAP, y=GAP, height=PLOTS_HEIGHT)
        board.minimize()
        reading.dock_left()
        reading.set_width(GUIDE_WIDTH)
        reading.minimize()
        shot = first_view(self._scenario, FIRST_WINDOW)
        server.initial_camera.fov = FIELD_OF_VIEW
        server.initial_camera.look_at = shot.look_at
        server.initial_camera.position = shot.position
        self.guard.watch(server, lab_state)
        self._sound = RingSound(gui, look_back)
        attendance = Attendance(lab_state, self._reports) if self._attended else None
        return RenderLoop(server, lab_state, self._draw, attendance)

    def _draw(self, readouts: bool, all_of_them: bool) -> None:
        """Draw the newest snapshot, with plots and numbers if `readouts`, with slow ones if `all_of_them`."""
        lab_state, reports, inputs = self.lab_state, self._reports, self.server.inputs
        snapshot, view = self.runner.snapshot, lab_state.view
        seen = self._look_back.seen(snapshot)
        self._scene.update(seen, view, lab_state.pulled, lab_state.kept)
        if reports.somebody_hears:
            with inputs:
                self._sound.update(seen)
        reports.show_run(snapshot.run_number, snapshot.name)
        self._cameras.follow(seen)
        if readouts:
            with inputs, lab_state.lock:
                self._panel.update(snapshot, seen, self._scene.scales(view), self._scene.caption)
                for readout in self._readouts if all_of_them else ():
                    readout.update(snapshot)
            self._plots.update(self._look_back.recent, seen, view, lab_state.kept, reports.open_charts())
