"""Overlays: virtual link, desired pose and path, trail, exaggeration factor, and the reach of the arms.

The floor is shaded where the arms cannot reach, and where an elbow is nearly stretched or folded.
"""

from collections import deque

import numpy as np
import viser

from flexlab.control.motion import poses
from flexlab.control.path import build_motion
from flexlab.lab.scene.arms import BEAM_HEIGHT, scene_size
from flexlab.lab.scene.beam import BEAM_COLOR, Tube
from flexlab.lab.scene.cameras import floor_extent
from flexlab.lab.view_settings import ViewSettings
from flexlab.scenario import Scenario
from flexlab.sim.geometry import link_points
from flexlab.sim.samples import Samples
from flexlab.sim.termination import elbow_sine, wrist_reach
from flexlab.views import GRAY, PURPLE, Color

DASHES = 15
"""Pieces of the dashed virtual link."""
PATH_POINTS = 961
"""Enough for paths of several turns: with fewer points, their chords lie beside one another and look like a thick line."""
LONGEST_PATH_TIME = 20.0
"""Longest part of the path that is drawn, s."""
TRAIL_POINTS = 91
"""Number of points of the trail: 3 s of pictures."""
GHOST_OPACITY = 0.3
GHOST_RADIUS = 0.013
"""Drawn radius of the desired pose for the paper's arms, m: thinner than the beam, so that the beam's colour stays visible."""
CELL, MOST_CELLS = 0.02, 1000
"""Size of one pixel of the shading, m, unless the floor is longer than the most pixels."""
CLOSE = 0.35
"""Sine of the elbow below which a pose counts as near a singularity (20°)."""
ANGLE_STEP = 0.05
"""Change of the payload's angle after which the shading is updated, rad."""
ABOVE_FLOOR = 0.004
"""Height of the shading above the floor, m, so that the two do not flicker through each other."""
UNREACHABLE = (128, 134, 142, 150)
SINGULAR = (230, 159, 0)
"""Grey where the arms cannot reach; orange near a singularity, denser the nearer."""


def path_points(scenario: Scenario) -> np.ndarray:
    """One cycle of the desired path of the payload's centre, m, (PATH_POINTS, 2)."""
    begin, end = scenario.trajectory.window
    times = np.linspace(begin, min(end, begin + LONGEST_PATH_TIME), PATH_POINTS)
    return poses(build_motion(scenario.trajectory), times)[:, 0, :2]


def segments(plane: np.ndarray, height: float) -> np.ndarray:
    """A line through points (count, 2) m as segments (count - 1, 2, 3) at `height` m."""
    points = np.column_stack([plane, np.full(len(plane), height)]).astype(np.float32)
    return np.stack([points[:-1], points[1:]], axis=1)


class Overlays:
    """Draws the overlays of one scenario; `update` follows the motion."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        self._height = BEAM_HEIGHT * self._size
        self._path_source: object = None
        self._trail_places: deque[np.ndarray] = deque(maxlen=TRAIL_POINTS)
        look = {"color": PURPLE, "opacity": GHOST_OPACITY, "cast_shadow": False}
        self._ghost = Tube(scene, scenario, "/overlays/desired", 2, GHOST_RADIUS, **look)
        self._path = self._line(scene, "path", PATH_POINTS - 1, PURPLE, 2.0)
        self._link = self._line(scene, "link", DASHES, GRAY, 2.0)
        self._trail = self._line(scene, "trail", TRAIL_POINTS - 1, BEAM_COLOR, 2.5)

    @staticmethod
    def _line(scene: viser.SceneApi, name: str, count: int, color: Color, width: float) -> viser.LineSegmentsHandle:
        points = np.zeros((count, 2, 3))
        return scene.add_line_segments(f"/overlays/{name}", points, color, thickness=width, thickness_units="screen")

    def update(self, scenario: Scenario, sample: Samples, view: ViewSettings) -> None:
        """Move everything to its place in `sample` (N = 1), and show what `view` asks for."""
        self._path.visible = view.path
        if scenario.trajectory != self._path_source:
            self._path.points = segments(path_points(scenario), self._height)
            self._path_source = scenario.trajectory
        self._trail.visible = view.trail
        place = sample.pose[0, :2]
        if not self._trail_places or np.any(place != self._trail_places[-1]):
            self._trail_places.append(place)
        if view.trail:
            missing = TRAIL_POINTS - len(self._trail_places)
            line = np.array([self._trail_places[0]] * missing + list(self._trail_places))
            self._trail.points = segments(line, self._height + 0.015 * self._size)
        self._ghost.mesh.visible = view.ghost
        # By vertices, not by node pose: the browser applies poses before arrays, so the ghost would be ahead of the beam.
        self._ghost.draw(link_points(scenario, sample.desired_pose)[0])
        grips = link_points(scenario, sample.pose)[0]
        share = np.linspace(0, 1, 2 * DASHES)[:, None]
        dashes = grips[0] + share * (grips[1] - grips[0])
        top = np.full(2 * DASHES, self._height + 0.03 * self._size)
        self._link.points = np.column_stack([dashes, top]).reshape(DASHES, 2, 3).astype(np.float32)

    def forget_trail(self) -> None:
        """Restart the trail, as after a reset."""
        self._trail_places.clear()


def elbow_sines(scenario: Scenario, x: np.ndarray, y: np.ndarray, angle: float) -> np.ndarray:
    """The smallest |sin(elbow)| of the arms for the payload's centre at each (x, y) m and `angle` rad; 0 if out of reach."""
    poses = np.stack(np.broadcast_arrays(x, y, np.full_like(x, angle)), axis=-1)
    worst = np.ones(x.shape)
    for index, arm in enumerate(scenario.arms):
        distance, _, _ = wrist_reach(scenario, index, poses)
        l1, l2, _ = arm.link_length
        worst = np.minimum(worst, elbow_sine(distance, l1, l2))
    return worst


def shade(sines: np.ndarray) -> np.ndarray:
    """RGBA picture (..., 4) of elbow sines."""
    picture = np.zeros((*sines.shape, 4), np.uint8)
    picture[..., :3] = SINGULAR
    picture[..., 3] = np.where(sines < CLOSE, 40 + 160 * (1 - sines / CLOSE), 0)
    picture[sines == 0] = UNREACHABLE
    return picture


class Reach:
    """The shading of one scenario's floor."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        x_min, x_max, y_min, y_max = floor_extent(scenario)
        cell = max(CELL, max(x_max - x_min, y_max - y_min) / MOST_CELLS)
        x, y = np.arange(x_min, x_max, cell) + cell / 2, np.arange(y_min, y_max, cell) + cell / 2
        # The picture's first row is at the far edge.
        self._x, self._y = np.meshgrid(x, y[::-1])
        self._shown_for: tuple[Scenario, float] | None = None
        self._picture = scene.add_image(
            "/reach",
            np.zeros((*self._x.shape, 4), np.uint8),
            render_width=len(x) * cell,
            render_height=len(y) * cell,
            format="png",
            position=((x_min + x_max) / 2, (y_min + y_max) / 2, ABOVE_FLOOR),
            wxyz=(0.0, 1.0, 0.0, 0.0),
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def update(self, scenario: Scenario, sample: Samples, shown: bool) -> None:
        """Shade the floor for the angle of `sample` (N = 1), if shown."""
        self._picture.visible = shown
        if not shown:
            return
        angle = round(float(sample.pose[0, 2]) / ANGLE_STEP) * ANGLE_STEP
        if self._shown_for is not None and self._shown_for[1] == angle and self._shown_for[0] is scenario:
            return
        self._picture.image = shade(elbow_sines(scenario, self._x, self._y, angle))
        self._shown_for = (scenario, angle)
