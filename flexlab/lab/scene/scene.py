"""The picture: arms, beam, floor, forces and overlays in viser's 3D scene, redrawn from snapshots; and a window without a lab."""

import time

import numpy as np
import viser

from flexlab.lab.mode_computation import ModeStudy, peak_deflection
from flexlab.lab.picking import Picking
from flexlab.lab.reference_run import ReferenceRun
from flexlab.lab.scene import cameras
from flexlab.lab.scene.arms import Arms
from flexlab.lab.scene.beam import Beam, ReferenceBeam, StrainBeam
from flexlab.lab.scene.cameras import draw_stage
from flexlab.lab.scene.forces import Forces, PullArrow
from flexlab.lab.scene.overlays import Overlays, Reach
from flexlab.lab.view_settings import ViewSettings
from flexlab.lab.viser_server import set_theme
from flexlab.scenario import Scenario
from flexlab.sim.commands import Pull
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Snapshot
from flexlab.sockets import raise_handles
from flexlab.text import number_text
from flexlab.views import fitting_exaggeration

MODE_SHOWN_AT = 1.0
"""Frequency of an animated mode on the screen, Hz."""
MODE_SIZE = 0.06
"""Drawn size of an animated mode, in beam lengths, whatever the exaggeration."""
PICTURES_PER_SECOND = 25
"""Pictures per simulated second, which takes one second of wall time."""
LATE = 1.0
"""Largest delay that later pictures make up for, s."""


class Scene:
    """Everything in the 3D view of one server. `update` may be called from one thread only."""

    def __init__(
        self, server: viser.ViserServer, scenario: Scenario, study: ModeStudy, touch: Picking, shadows: bool = True
    ):
        self._server, self._study, self._touch, self._shadows = server, study, touch, shadows
        self._built_for: object = None
        self._run_number = -1
        self.caption = ""
        """A text that says how the drawn deflection relates to the true one."""
        self._build(scenario)

    def update(self, snapshot: Snapshot, view: ViewSettings, pull: Pull | None, kept: ReferenceRun | None) -> None:
        """Draw a snapshot, with the pull and the kept run if there are any, all parts at once."""
        scenario, sample = snapshot.scenario, snapshot.display
        if _structure(scenario) != self._built_for:
            self._build(scenario)
        if snapshot.run_number != self._run_number:
            self._run_number = snapshot.run_number
            self._overlays.forget_trail()
        bent, self.caption = self._bent(scenario, sample, view)
        with self._server.atomic():
            self._arms.update(scenario, sample)
            self._beam.update(scenario, bent, view)
            self._strain.update(scenario, bent, view)
            self._overlays.update(scenario, sample, view)
            self._forces.update(scenario, sample, view)
            self._pull.update(scenario, sample, view, pull)
            self._kept.update(sample, view, kept)
            self._reach.update(scenario, sample, view.reach)
        self._server.flush()

    def scales(self, view: ViewSettings) -> list[tuple[str, str]]:
        """(label, value as HTML) of the picture's present scales."""
        return [*self._forces.scales(view), *self._strain.scales()]

    def _bent(self, scenario: Scenario, sample: Samples, view: ViewSettings) -> tuple[Samples, str]:
        """The sample to draw the beam from, and the caption: the run's, or those of the animated mode."""
        truth = f"deflection drawn × {number_text(view.exaggeration)}"
        result, index = self._study.result, view.shown_mode
        if index is None or result is None or index >= len(result.frequency):
            return sample, truth
        if result.shape.shape[0] != sample.beam_coordinates.shape[1]:
            return sample, truth
        shape = result.shape[:, index]
        size = MODE_SIZE * scenario.payload.length / peak_deflection(scenario.payload, shape)
        swing = np.sin(2 * np.pi * MODE_SHOWN_AT * time.monotonic()) / max(view.exaggeration, 1e-3)
        drawn = sample.having(beam_coordinates=(size * swing * shape)[None])
        return drawn, f"mode {index + 1} ({result.frequency[index]:.1f} Hz) animated at {MODE_SHOWN_AT:g} Hz"

    def _build(self, scenario: Scenario) -> None:
        scene = self._server.scene
        scene.reset()
        draw_stage(scene, scenario, self._shadows)
        self._reach = Reach(scene, scenario)
        self._arms, self._overlays = Arms(scene, scenario), Overlays(scene, scenario)
        self._beam, self._strain = Beam(scene, scenario), StrainBeam(scene, scenario)
        self._forces, self._pull = Forces(scene, scenario), PullArrow(scene, scenario)
        self._kept = ReferenceBeam(scene, scenario)
        self._touch.attach(self._beam.grab, self._arms.grab)
        self._built_for = _structure(scenario)


def _structure(scenario: Scenario) -> tuple:
    """Everything that the drawn parts are built from; a change of it rebuilds them, any other change only moves them."""
    return scenario.left_arm, scenario.right_arm, scenario.payload.length, scenario.trajectory.middle


class Window:
    """A page with the scene alone, for this machine only; viser prints its address."""

    def __init__(self, scenario: Scenario):
        self._scenario, self._view = scenario, ViewSettings(exaggeration=fitting_exaggeration(scenario))
        raise_handles()
        self._server = server = viser.ViserServer(host="127.0.0.1", label="flexlab", verbose=False)
        set_theme(server.gui, dark=False)
        server.gui.add_markdown(f"Deflection drawn × {number_text(self._view.exaggeration)}")
        draw_stage(server.scene, scenario, shadows=True)
        self._arms, self.beam = Arms(server.scene, scenario), Beam(server.scene, scenario)

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            place = cameras.shot("Overview", scenario, self._sample, cameras.Window(client.camera.aspect))
            client.camera.fov = float(cameras.FIELD_OF_VIEW)
            client.camera.position, client.camera.look_at = place.position, place.look_at

        self._sample: Samples
        self._simulated, self._due = 0.0, time.monotonic()

    def show(self, sample: Samples, passed: float) -> None:
        """Show a sample (N = 1) that is `passed` s after the last one, in real time."""
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
        """Address of the page."""
        return f"http://127.0.0.1:{self._server.get_port()}"

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()
