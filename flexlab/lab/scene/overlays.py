"""What is drawn over the machine: virtual link, desired pose and path, grip forces, and the exaggeration factor."""

import numpy as np
import viser

from flexlab.lab import colors
from flexlab.lab.ranges import Range
from flexlab.lab.scene import models
from flexlab.lab.scene.arms import scene_size
from flexlab.lab.scene.beam import SIDES, tube_faces, tube_vertices
from flexlab.lab.scene.stage import floor_extent
from flexlab.lab.view import View
from flexlab.scenario import Scenario
from flexlab.sim.build import build_trajectory, desired_at
from flexlab.sim.samples import Samples
from flexlab.sim.shape import link_points

DASHES = 15
"""Pieces of the dashed virtual link."""
PATH_POINTS = 241
LONGEST_PATH_TIME = 20.0
"""The path is drawn for one period of its slowest part, but for no more than this, s."""
LONGEST_ARROW = 0.4
"""Length of an arrow at the limit of the present force range, m."""
LEAST_FORCE = 1.0
"""The force range never falls below this, N: smaller internal forces need not be magnified."""
FRAMES_BEFORE_SHRINKING = 75
"""Pictures without a large force before the arrows' scale is magnified (2.5 s)."""
HIDDEN_BELOW = 0.03
"""Share of the force range below which the arrows are hidden: their heads alone would say more than there is."""
SHORTEST_ARROW = 1e-4
"""Arrows keep this length, m, so that their direction stays defined."""
LABEL_OFFSET = 0.05
"""From the floor's far edge to the label of the exaggeration, m."""
GHOST_OPACITY = 0.3
GHOST_RADIUS = 0.016
"""Drawn radius of the desired pose for the paper's arms, m: a little wider than the beam, so that both are seen."""


def path_points(scenario: Scenario) -> np.ndarray:
    """The desired path of the payload's middle over one period, m, (PATH_POINTS, 2)."""
    moving = [f for f, a in zip(scenario.trajectory.frequency, scenario.trajectory.amplitude, strict=True) if f and a]
    period = min(1 / min(moving), LONGEST_PATH_TIME) if moving else 1.0
    trajectory = build_trajectory(scenario)
    return np.array([desired_at(trajectory, t)[0, :2] for t in np.linspace(0, period, PATH_POINTS)])


def arrow_vectors(force: np.ndarray, scale: float) -> np.ndarray:
    """Forces (..., 2) N as drawn vectors (..., 2) m: `scale` m per N, at least `SHORTEST_ARROW` long."""
    vector = force * scale
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.where(length < SHORTEST_ARROW, [SHORTEST_ARROW, 0.0], vector)


class Overlays:
    """Draws the overlays of one scenario; `update` follows the motion."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        self._height = models.BEAM_HEIGHT * self._size
        self._top = self._height + 0.03 * self._size
        self._path_source: object = None
        self._force_range = Range(LEAST_FORCE, FRAMES_BEFORE_SHRINKING)
        self._root = scene.add_frame("/overlays", show_axes=False)
        self._ghost = scene.add_mesh_simple(
            "/overlays/desired",
            np.zeros((4 * SIDES, 3)),
            tube_faces(2),
            color=colors.DESIRED,
            opacity=GHOST_OPACITY,
            cast_shadow=False,
            receive_shadow=False,
        )
        empty = np.zeros((PATH_POINTS - 1, 2, 3))
        self._path = scene.add_line_segments(
            "/overlays/path", empty, colors.DESIRED, thickness=2.0, thickness_units="screen"
        )
        self._link = scene.add_line_segments(
            "/overlays/link", np.zeros((DASHES, 2, 3)), colors.GRAY, thickness=2.0, thickness_units="screen"
        )
        count = len(scenario.arms)
        self._forces = scene.add_arrows(
            "/overlays/internal_force",
            np.tile([[0.0, 0.0, 0.0], [SHORTEST_ARROW, 0.0, 0.0]], (count, 1, 1)),
            np.tile(np.array(colors.INTERNAL_FORCE, np.uint8), (count, 1)),
            shaft_radius=0.006 * self._size,
            head_radius=0.016 * self._size,
            head_length=0.04 * self._size,
        )
        x_min, x_max, _, y_max = floor_extent(scenario)
        # It stands still: a browser applies poses ahead of arrays, so beside a moving beam it would run away from it.
        place = ((x_min + x_max) / 2, y_max + LABEL_OFFSET, 0.0)
        self._factor = scene.add_label("/overlays/factor", "", position=place, anchor="bottom-center")

    @property
    def force_per_meter(self) -> float:
        """N that one metre of arrow stands for."""
        return self._force_range.limit / LONGEST_ARROW

    def update(self, scenario: Scenario, sample: Samples, view: View) -> None:
        """Move everything to where `sample` (N = 1) has it, showing what `view` asks for."""
        self._update_path(scenario, view)
        self._ghost.visible = view.ghost
        # By vertices, not by node pose: the browser applies poses a frame ahead of arrays, and the ghost would lead the beam.
        desired = link_points(scenario, sample.desired_pose)[0]
        self._ghost.vertices = tube_vertices(desired, GHOST_RADIUS * self._size, self._height)
        grips = link_points(scenario, sample.pose)[0]
        self._link.points = self._dashes(grips)
        self._update_forces(grips, sample.internal_force[0, :, :2], view)
        self._factor.text = f"beam deflection drawn × {view.exaggeration:g}"

    def _update_path(self, scenario: Scenario, view: View) -> None:
        self._path.visible = view.path
        if scenario.trajectory != self._path_source:
            points = np.column_stack([path_points(scenario), np.full(PATH_POINTS, self._height)])
            self._path.points = np.stack([points[:-1], points[1:]], axis=1)
            self._path_source = scenario.trajectory

    def _dashes(self, grips: np.ndarray) -> np.ndarray:
        share = np.linspace(0, 1, 2 * DASHES)[:, None]
        plane = grips[0] + share * (grips[1] - grips[0])
        return np.column_stack([plane, np.full(2 * DASHES, self._top)]).reshape(DASHES, 2, 3)

    def _update_forces(self, grips: np.ndarray, force: np.ndarray, view: View) -> None:
        largest = float(np.linalg.norm(force, axis=1).max())
        self._force_range.fit(largest)
        self._forces.visible = view.forces and largest > HIDDEN_BELOW * self._force_range.limit
        if self._forces.visible:
            starts = grips[: len(force)]
            ends = starts + arrow_vectors(force, LONGEST_ARROW / self._force_range.limit)
            height = np.full((len(starts), 2, 1), self._top + 0.02 * self._size)
            self._forces.points = np.concatenate([np.stack([starts, ends], axis=1), height], axis=2).astype(np.float32)

    def remove(self) -> None:
        """Take the overlays out of the scene."""
        self._root.remove()
