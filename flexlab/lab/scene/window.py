"""The scene alone in a browser, without panel and plots: a picture of a world that another program moves."""

import time

import viser

from flexlab.lab.scene import cameras
from flexlab.lab.scene.arms import Arms
from flexlab.lab.scene.beam import Beam
from flexlab.lab.scene.stage import Stage, set_light
from flexlab.lab.view_settings import ViewSettings, fitting_exaggeration
from flexlab.lab.viser_server import set_theme
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.text import number_text

PICTURES_PER_SECOND = 25
"""Of simulated time, which passes as fast as a clock's."""
LATE = 1.0
"""s by which a picture may be late and those after it still hurry."""


class Window:
    """The scene at an address that viser prints, for this machine only."""

    def __init__(self, scenario: Scenario):
        self._scenario, self._view = scenario, ViewSettings(exaggeration=fitting_exaggeration(scenario))
        self._server = server = viser.ViserServer(host="127.0.0.1", label="flexlab", verbose=False)
        set_theme(server.gui, dark=False)
        server.gui.add_markdown(f"Deflection drawn × {number_text(self._view.exaggeration)}")
        set_light(server.scene, shadows=True)
        self._stage, self._arms, self.beam = (part(server.scene, scenario) for part in (Stage, Arms, Beam))

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            place = cameras.shot("Overview", scenario, self._sample, cameras.Window(client.camera.aspect))
            client.camera.fov = float(cameras.FIELD_OF_VIEW)
            client.camera.position, client.camera.look_at = place.position, place.look_at

        self._sample: Samples
        self._simulated, self._due = 0.0, time.monotonic()

    def show(self, sample: Samples, passed: float) -> None:
        """Show a sample (N = 1) that comes `passed` s after the last one, at the pace of a clock."""
        self._sample, self._simulated = sample, self._simulated + passed
        if self._simulated < (1 - 1e-9) / PICTURES_PER_SECOND:
            return
        with self._server.atomic():
            self._arms.update(self._scenario, sample)
            self.beam.update(self._scenario, sample, self._view)
        self._server.flush()
        self._due = max(self._due + self._simulated, time.monotonic() - LATE)
        self._simulated = 0.0
        time.sleep(max(self._due - time.monotonic(), 0.0))

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://127.0.0.1:{self._server.get_port()}"

    def close(self) -> None:
        """End the server."""
        self._server.stop()
