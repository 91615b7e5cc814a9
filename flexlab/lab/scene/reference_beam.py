"""The beam of a kept run, drawn behind the present one at the same simulation time."""

import numpy as np
import viser

from flexlab.lab import colors
from flexlab.lab.reference_run import ReferenceRun
from flexlab.lab.scene import arm_models
from flexlab.lab.scene.arm_meshes import scene_size
from flexlab.lab.scene.beam_mesh import SIDES, STATIONS, TUBE_RADIUS, tube_faces, tube_vertices
from flexlab.lab.view_settings import ViewSettings
from flexlab.scenario import Scenario
from flexlab.sim.geometry import beam_points
from flexlab.sim.samples import Samples

OPACITY = 0.45
SHARE = 0.9
"""Thickness relative to the present beam, which must stay in front."""


class ReferenceBeam:
    """Drawn while a run is kept and has a sample for the present time."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        self._tube = scene.add_mesh_simple(
            "/kept",
            np.zeros(((STATIONS + 2) * SIDES, 3)),
            tube_faces(STATIONS),
            color=colors.GRAY,
            opacity=OPACITY,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def update(self, sample: Samples, view: ViewSettings, kept: ReferenceRun | None) -> None:
        """Draw `kept` at the time of `sample` (N = 1)."""
        past = kept.at(float(sample.time[0])) if kept is not None else None
        self._tube.visible = past is not None
        if kept is not None and past is not None:
            line = beam_points(kept.scenario, past, STATIONS, view.exaggeration)[0]
            height = arm_models.BEAM_HEIGHT * self._size
            self._tube.vertices = tube_vertices(line, SHARE * TUBE_RADIUS * self._size, height)

    def remove(self) -> None:
        """Take the beam out of the scene."""
        self._tube.remove()
