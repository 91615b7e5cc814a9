"""One lab: a server for browsers, the simulation behind it, and whoever records it, on one object."""

import threading
from collections.abc import Callable, Sequence

import viser

from flexlab.errors import LabError
from flexlab.lab.input_guard import InputGuard
from flexlab.lab.lab_state import LabState
from flexlab.lab.look_back import LookBack
from flexlab.lab.mode_computation import ModeStudy
from flexlab.lab.own_file_watch import OwnFileWatch
from flexlab.lab.page_reports import PAGE_SCRIPT, PageReports, Report
from flexlab.lab.panel.guide_panel import Guide
from flexlab.lab.panel.panel import Panel
from flexlab.lab.panel.readouts import SpokenSummary
from flexlab.lab.picking import Picking
from flexlab.lab.plots.explanation_list import ExplanationList
from flexlab.lab.plots.plots import Plots
from flexlab.lab.reference_run import Recorded
from flexlab.lab.render_loop import Attendance, RenderLoop
from flexlab.lab.ring_sound import RingSound
from flexlab.lab.scene.cameras import FIELD_OF_VIEW, ClientCameras, Window, payload_view
from flexlab.lab.scene.scene import Scene
from flexlab.lab.viser_internals import GuardedServer, fold_panel, set_panel_width
from flexlab.lab.viser_server import open_server
from flexlab.own import hosts
from flexlab.scenario import Scenario
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Consumer
from flexlab.sim.world_state import Origin

SHEET = """
[data-dock-region], [data-dock-root] > div[style*="box-shadow"] { visibility: hidden; pointer-events: none; }
#server-bar { display: none !important; }
[data-dock-root] > div:first-child { left: 0 !important; right: 0 !important; }
/* One plot along the upper edge: of the motion that of the deflection, which is the second. */
[data-floating-window] { left: 0.5rem !important; width: calc(100vw - 20rem) !important; height: 26.5rem !important;
  max-width: none !important; }
[data-dock-strip], [data-floating-handle] { display: none !important; }
div:has(> div > .uplot-container):has(> :nth-child(2) .uplot-container) > :not(:nth-child(2)) { display: none; }
div:has(> div > .uplot-container):not(:has(> :nth-child(2) .uplot-container)) > :not(:first-child) { display: none; }
div:has(> div > .uplot-container) { grid-template-columns: 1fr !important; }
.uplot-container { zoom: 1.6; }
.fl-number { display: grid !important; }
.fl-number, .fl-caption, .fl-float { visibility: visible; }
.fl-caption, .fl-float { font-size: 1.6rem; }
.fl-hear[aria-pressed="false"], div:has(> .fl-scrub) + div:has(.mantine-Slider-root) { display: none; }
"""
"""Over that of the panel."""


class Presentation:
    """Which browsers present."""

    def __init__(self, server: viser.ViserServer, plots: viser.PanelHandle):
        """`plots`: their panel, which the presentation opens."""
        self._plots = plots
        self._sheets: dict[int, viser.GuiHtmlHandle] = {}
        self._lock = threading.Lock()
        server.on_client_disconnect(self._forget)

    def toggle(self, client: viser.ClientHandle) -> None:
        """Begin or end the presentation in one browser."""
        with self._lock:
            sheet = self._sheets.pop(client.client_id, None)
            if sheet is None:
                style = f'<style class="fl-presentation">{SHEET}</style>'
                self._sheets[client.client_id] = client.gui.add_html(style)
        if sheet is not None:
            sheet.remove()
        fold_panel(client, self._plots, sheet is not None)

    async def _forget(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._sheets.pop(client.client_id, None)


PANEL_WIDTH, NARROW_PANEL = 330, 300
"""px: enough for the longest label with its unit on one line; and beside a narrow picture."""
NARROW_WINDOW = 1200
"""px: windows narrower than this leave the panel less room."""
GUIDE_WIDTH, FOLDED_WIDTH = 280, 36
"""px: of the guide's column, open and folded."""
PLOTS_HEIGHT, GAP = 300, 8
"""px: two charts side by side with their legends; the distance from the picture's edges."""
GUIDE, PLOTS = "guide", "plots"
"""What a page calls the panels that can be folded."""
FIRST_WINDOW = Window(1.0)
"""The picture on an ordinary screen beside both panels, until a browser tells its own."""


class Session:
    """A running lab. Any number may live in one process; each is started once and stopped once.

    `consumers` get every sample and event (a recorder, say). `recording` gives the sentence that the panel shows about
    the recording, `link` the address that opens a scenario in another browser. `port` 0 takes any free port. `shadows`
    costs a slow graphics card most of its time. With an `origin` the first run goes on from there.
    With a `secret` the page answers only a server in front of it that sends it along. `attended`: runs begin when a browser
    has drawn them, and hold while nobody looks; else they run whoever looks.
    `recorded` gives back what the engine remembers no longer of the present run; `recorded_as` is the name of its recording,
    empty without one.
    """

    def __init__(
        self,
        scenario: Scenario,
        name: str = "scenario",
        *,
        consumers: Sequence[Consumer] = (),
        host: str = "127.0.0.1",
        port: int = 8080,
        playing: bool = True,
        shadows: bool = True,
        recording: Callable[[], str] = lambda: "",
        link: Callable[[Scenario], str] | None = None,
        origin: Origin | None = None,
        secret: str = "",
        attended: bool = False,
        recorded: Recorded | None = None,
        recorded_as: Callable[[], str] = lambda: "",
    ):
        hosts.run_apart()
        self._scenario, self._host, self._port = scenario, host, port
        self._shadows, self._recording, self._link = shadows, recording, link
        self._origin, self._secret, self._attended = origin, secret, attended
        self._recorded, self._recorded_as = recorded, recorded_as
        self.guard = InputGuard()
        """Looks at every message of a browser; counts those that it refuses."""
        self.runner = Runner(scenario, name, consumers=consumers, playing=playing, origin=origin, hold_starts=attended)
        self._server: GuardedServer | None = None
        self._lab_state: LabState | None = None
        self._study = ModeStudy()
        self._drawing: RenderLoop | None = None
        self._own_files: OwnFileWatch | None = None

    @property
    def server(self) -> GuardedServer:
        """The running server; raises `LabError` before `start` and after `stop`."""
        if self._server is None:
            raise LabError("This lab is not running: start it first.")
        return self._server

    @property
    def lab_state(self) -> LabState:
        """What the controls share; raises `LabError` before `start` and after `stop`."""
        if self._lab_state is None:
            raise LabError("This lab is not running: start it first.")
        return self._lab_state

    @property
    def port(self) -> int:
        """The port that the server has (the one asked for, or the one found for 0)."""
        return self._server.get_port() if self._server else self._port

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the lab."""
        host = "127.0.0.1" if self._host in ("0.0.0.0", "::") else self._host
        return f"http://{host}:{self.port}"

    def start(self) -> None:
        """Serve the page and start the simulation. Raises `LabError`, and leaves nothing running, if it cannot."""
        self._server = open_server(self._host, self._port, "flexlab", self.guard, self._secret, PAGE_SCRIPT)
        try:
            self._drawing = self._furnish(self._server)
            self._own_files = OwnFileWatch(self.lab_state)
            self._own_files.start()
            self.runner.start()
            self._drawing.start()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Stop drawing, simulation and server; returns when all threads are done. May be called twice."""
        hosts.stop_loading()
        if self._own_files is not None:
            self._own_files.stop()
        if self._drawing is not None:
            self._drawing.stop()
        self._study.stop()
        self.runner.stop()
        if self._server is not None:
            self._server.stop()
        self._drawing = self._lab_state = self._server = None

    def __enter__(self) -> "Session":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _furnish(self, server: GuardedServer) -> RenderLoop:
        """Fill the server's page."""
        lab_state = self._lab_state = LabState(self.runner, self._origin)
        lab_state.company = lambda: len(server.get_clients())
        look_back = LookBack(lab_state, self.runner, self._recorded_as)
        touch = Picking(lab_state)
        scene = Scene(server, self._scenario, self._study, touch, self._shadows)
        cameras = ClientCameras(server, self.runner)
        board, reading = server.gui.add_panel(), server.gui.add_panel()
        presentation = Presentation(server, board)
        panel = Panel(
            server.gui,
            lab_state,
            look_back,
            self.runner,
            self._study,
            touch,
            cameras.choose,
            self._recording,
            self._link,
            presentation.toggle,
            lambda client: reports.say(client, summary.text),
            self._recorded,
        )
        plots = Plots(server.gui, board, self._scenario, lab_state.view.plot_window)
        explanations = ExplanationList(server.gui, self.runner, self._study, plots.homes)
        summary = SpokenSummary(server.gui, self.runner, look_back, lambda: explanations.sentences)
        with reading.add_tab("Guide"):
            guide = Guide(server.gui, lab_state, self.runner)

        def arrange(client: viser.ClientHandle, report: Report) -> None:
            panel_width = PANEL_WIDTH if report.width >= NARROW_WINDOW else NARROW_PANEL
            set_panel_width(client, server.gui.main_panel, panel_width)
            set_panel_width(client, board, max(report.width - panel_width - FOLDED_WIDTH - 2 * GAP, PANEL_WIDTH))
            for name, foldable in ((GUIDE, reading), (PLOTS, board)):
                if name in report.open:
                    fold_panel(client, foldable, False)

        first = self.runner.snapshot
        reports = PageReports(server, first.run_number, first.name, arrange, cameras.cover, lab_state.back_to_baseline)
        attendance = Attendance(self.runner, lab_state, reports) if self._attended else None
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(PANEL_WIDTH)
        board.float(x=GAP, y=GAP, height=PLOTS_HEIGHT)
        board.minimize()
        reading.dock_left()
        reading.set_width(GUIDE_WIDTH)
        reading.minimize()
        shot = payload_view(self._scenario, FIRST_WINDOW)
        server.initial_camera.fov = FIELD_OF_VIEW
        server.initial_camera.look_at = shot.look_at
        server.initial_camera.position = shot.position
        self.guard.watch(server, lab_state)
        sound = RingSound(server.gui, look_back)
        readouts = (guide, explanations, summary)
        return RenderLoop(
            server,
            self.runner,
            lab_state,
            look_back,
            scene,
            cameras,
            panel,
            plots,
            readouts,
            sound,
            reports,
            attendance,
        )
