"""Where the payload's middle can be at its present angle.

Floor shading of what the arms cannot reach, and of what is near a stretched or folded elbow.
"""

import numpy as np
import viser

from flexlab.lab.scene.stage import floor_extent
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.termination import elbow_sine, wrist_reach

CELL = 0.02
"""Size of one pixel of the shading, m."""
CLOSE = 0.35
"""Sine of the elbow below which a pose counts as near a singularity (20°)."""
ANGLE_STEP = 0.05
"""Change of the payload's angle after which the shading is made anew, rad."""
ABOVE_FLOOR = 0.004
"""m, so that shading and floor do not flicker through each other."""
UNREACHABLE = (128, 134, 142, 150)
SINGULAR = (230, 159, 0)
"""Grey for what cannot be reached; orange, the denser the nearer, for what is near a singularity."""


def elbow_sines(scenario: Scenario, x: np.ndarray, y: np.ndarray, angle: float) -> np.ndarray:
    """The smaller |sin(elbow)| of the arms for the payload's middle at each (x, y) m and `angle` rad; 0: out of reach."""
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
        x, y = np.arange(x_min, x_max, CELL) + CELL / 2, np.arange(y_min, y_max, CELL) + CELL / 2
        # First row of the picture at the far edge.
        self._x, self._y = np.meshgrid(x, y[::-1])
        self._shown_for: tuple[Scenario, float] | None = None
        self._picture = scene.add_image(
            "/reach",
            np.zeros((*self._x.shape, 4), np.uint8),
            render_width=len(x) * CELL,
            render_height=len(y) * CELL,
            format="png",
            position=((x_min + x_max) / 2, (y_min + y_max) / 2, ABOVE_FLOOR),
            wxyz=(0.0, 1.0, 0.0, 0.0),
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def update(self, scenario: Scenario, sample: Samples, shown: bool) -> None:
        """Shade for the angle of `sample` (N = 1), if shown."""
        self._picture.visible = shown
        if not shown:
            return
        angle = round(float(sample.pose[0, 2]) / ANGLE_STEP) * ANGLE_STEP
        if self._shown_for is not None and self._shown_for[1] == angle and self._shown_for[0] is scenario:
            return
        self._picture.image = shade(elbow_sines(scenario, self._x, self._y, angle))
        self._shown_for = (scenario, angle)

    def remove(self) -> None:
        """Take the shading out of the scene."""
        self._picture.remove()
