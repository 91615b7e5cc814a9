"""The picture: arms, beam, floor and overlays in viser's 3D scene, redrawn from snapshots."""

import viser

from flexlab.lab.scene.arms import Arms
from flexlab.lab.scene.beam import Beam
from flexlab.lab.scene.overlays import Overlays
from flexlab.lab.scene.stage import Stage, set_light
from flexlab.lab.view import View
from flexlab.scenario import Scenario
from flexlab.sim.snapshot import Snapshot


class Scene:
    """Everything in the 3D view of one server. `update` may be called from one thread only."""

    def __init__(self, server: viser.ViserServer, scenario: Scenario, shadows: bool = True):
        self._server = server
        set_light(server.scene, shadows)
        self._built_for: object = None
        self._parts: list[Arms | Beam | Overlays | Stage] = []
        self._build(scenario)

    def update(self, snapshot: Snapshot, view: View) -> None:
        """Draw a snapshot, all parts at once."""
        scenario, sample = snapshot.scenario, snapshot.display
        if _structure(scenario) != self._built_for:
            self._build(scenario)
        with self._server.atomic():
            self._arms.update(scenario, sample)
            self._beam.update(scenario, sample, view.exaggeration)
            self._overlays.update(scenario, sample, view)
        self._server.flush()

    @property
    def force_per_meter(self) -> float:
        """N that one metre of a force arrow now stands for."""
        return self._overlays.force_per_meter

    def _build(self, scenario: Scenario) -> None:
        scene = self._server.scene
        for part in self._parts:
            part.remove()
        self._stage, self._arms = Stage(scene, scenario), Arms(scene, scenario)
        self._beam, self._overlays = Beam(scene, scenario), Overlays(scene, scenario)
        self._parts = [self._stage, self._arms, self._beam, self._overlays]
        self._built_for = _structure(scenario)


def _structure(scenario: Scenario) -> tuple:
    """What the drawn parts were built from; a change rebuilds them, everything else only moves them."""
    return scenario.left_arm, scenario.right_arm, scenario.payload.length, scenario.trajectory.center
