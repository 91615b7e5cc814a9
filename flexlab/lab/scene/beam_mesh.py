"""The payload: one tube whose vertices follow the beam's centre line, deflection exaggerated by a shown factor.

The beam of a kept run is drawn behind the present one, at the same simulation time.
"""

import numpy as np
import viser

from flexlab.lab import colors
from flexlab.lab.reference_run import ReferenceRun
from flexlab.lab.scene import arms
from flexlab.lab.scene.arms import scene_size
from flexlab.lab.view_settings import ViewSettings
from flexlab.scenario import Scenario
from flexlab.sim.geometry import beam_points
from flexlab.sim.samples import Samples

STATIONS = 33
"""Points along the beam: smooth up to its eighth mode, and 4 kB a picture."""
SIDES = 10
GRAB_RADIUS = 0.035
"""Of the unseen tube that a hand takes hold of, for the paper's arms, m: wide enough for a finger on a telephone."""
GRAB_EVERY, GRAB_SIDES = 8, 6
"""Stations of the drawn tube per station of the unseen one; nobody sees that it is coarse."""
TUBE_RADIUS = 0.015
"""Drawn radius for the paper's arms, m; the model's beam has no thickness."""


def tube_vertices(line: np.ndarray, radius: float, height: float, sides: int = SIDES) -> np.ndarray:
    """Vertices ((count + 2) · sides, 3) of a closed tube around `line` (count, 2) m at `height` m above the floor."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    plane = line[:, None, :] + radius * np.cos(angle)[None, :, None] * across[:, None, :]
    up = np.broadcast_to(height + radius * np.sin(angle), plane.shape[:2])
    rings = np.concatenate([plane, up[:, :, None]], axis=2)
    caps = [np.broadcast_to([*line[end], height], (1, sides, 3)) for end in (0, -1)]
    return np.concatenate([caps[0], rings, caps[1]]).reshape(-1, 3).astype(np.float32)


def tube_faces(count: int, sides: int = SIDES) -> np.ndarray:
    """Triangles of `tube_vertices` for `count` points, outside counter-clockwise."""
    rows = np.arange(count + 1)[:, None] * sides
    here, next_ = np.arange(sides), (np.arange(sides) + 1) % sides
    near, near_next, far, far_next = rows + here, rows + next_, rows + sides + here, rows + sides + next_
    first = np.stack([near, far_next, far], axis=-1)
    second = np.stack([near, near_next, far_next], axis=-1)
    return np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


class Beam:
    """Draws the payload; `update` bends it. `grab`: an unseen thicker tube around it, to be touched."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        straight = np.column_stack([np.linspace(-0.5, 0.5, STATIONS) * scenario.payload.length, np.zeros(STATIONS)])
        self.mesh = scene.add_mesh_simple(
            "/beam",
            self._around(straight),
            tube_faces(STATIONS),
            color=colors.BEAM,
            receive_shadow=False,
        )

        self.grab = scene.add_mesh_simple(
            "/grab",
            self._grab_around(straight),
            tube_faces(len(straight[::GRAB_EVERY]), GRAB_SIDES),
            opacity=0.0,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _around(self, line: np.ndarray) -> np.ndarray:
        return tube_vertices(line, TUBE_RADIUS * self._size, arms.BEAM_HEIGHT * self._size)

    def _grab_around(self, line: np.ndarray) -> np.ndarray:
        height = arms.BEAM_HEIGHT * self._size
        return tube_vertices(line[::GRAB_EVERY], GRAB_RADIUS * self._size, height, GRAB_SIDES)

    def update(self, scenario: Scenario, sample: Samples, view: ViewSettings) -> None:
        """Bend the tube as `sample` (N = 1) has it, exaggerated as `view` asks; hidden while strain is coloured."""
        line = beam_points(scenario, sample, STATIONS, view.exaggeration)[0]
        self.mesh.visible = not (view.strain or view.axial)
        if not (view.strain or view.axial):
            self.mesh.vertices = self._around(line)
        self.grab.vertices = self._grab_around(line)

    def remove(self) -> None:
        """Take the beam out of the scene."""
        self.mesh.remove()
        self.grab.remove()


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
            height = arms.BEAM_HEIGHT * self._size
            self._tube.vertices = tube_vertices(line, SHARE * TUBE_RADIUS * self._size, height)

    def remove(self) -> None:
        """Take the beam out of the scene."""
        self._tube.remove()
