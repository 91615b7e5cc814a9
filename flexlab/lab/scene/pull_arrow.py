"""The spring with which a person pulls beam or link: an arrow from the held point to the hand, with its force in N."""

import numpy as np
import viser

from flexlab.lab import colors
from flexlab.lab.scene import arm_models
from flexlab.lab.scene.arm_meshes import scene_size
from flexlab.lab.view_settings import ViewSettings
from flexlab.scenario import Scenario
from flexlab.sim.commands import Pull
from flexlab.sim.geometry import arm_points, deflection_at
from flexlab.sim.samples import Samples


def held_point(scenario: Scenario, sample: Samples, pull: Pull, exaggeration: float = 1.0) -> np.ndarray:
    """Where the held point of beam or link is in `sample` (N = 1), (x, y) m, deflection times `exaggeration`."""
    if pull.link is not None:
        arm, link = pull.link
        inner, outer = arm_points(scenario, sample)[0, arm - 1, link - 1 : link + 1]
        return inner + pull.position / scenario.arms[arm - 1].link_length[link - 1] * (outer - inner)
    s, (x, y, angle) = pull.position, sample.pose[0]
    w = exaggeration * float(deflection_at(scenario.payload, sample.beam_coordinates, np.array([s]))[0, 0])
    return np.array([x + s * np.cos(angle) - w * np.sin(angle), y + s * np.sin(angle) + w * np.cos(angle)])


class PullArrow:
    """Drawn while somebody pulls."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = size = scene_size(scenario)
        self._arrow = scene.add_arrows(
            "/pull",
            np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]]),
            np.array([colors.VERMILION], np.uint8),
            shaft_radius=0.005 * size,
            head_radius=0.014 * size,
            head_length=0.035 * size,
            visible=False,
        )
        self._label = scene.add_label("/pull_force", "", anchor="bottom-left", visible=False)

    def update(self, scenario: Scenario, sample: Samples, view: ViewSettings, pull: Pull | None) -> None:
        """Draw `pull`, if there is one, at the point it holds in `sample` (N = 1)."""
        held = pull is not None and (pull.link is None or pull.link[0] <= len(scenario.arms))
        self._arrow.visible = self._label.visible = held
        if pull is None or not held:
            return
        target = np.array(pull.target)
        force = pull.stiffness * float(np.linalg.norm(target - held_point(scenario, sample, pull)))
        drawn = held_point(scenario, sample, pull, view.exaggeration)
        # In the plane in which the hand moves, so that the arrow's tip is under the pointer.
        height = self._size * (
            arm_models.BEAM_HEIGHT if pull.link is None else arm_models.LINK_HEIGHTS[pull.link[1] - 1]
        )
        ends = np.column_stack([[drawn, target], [height, height]])
        self._arrow.points = ends[None].astype(np.float32)
        self._label.text = f"pull {force:.1f} N"
        self._label.position = (*pull.target, height)

    def remove(self) -> None:
        """Take the arrow out of the scene."""
        self._arrow.remove()
        self._label.remove()
