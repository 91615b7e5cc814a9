"""The spring with which a person pulls the beam: an arrow from the held point to the hand, with its force in N."""

import numpy as np
import viser

from flexlab.lab import colors
from flexlab.lab.scene import models
from flexlab.lab.scene.arms import scene_size
from flexlab.lab.view import View
from flexlab.scenario import Scenario
from flexlab.sim.commands import Pull
from flexlab.sim.samples import Samples
from flexlab.sim.shape import deflection_at


def held_point(scenario: Scenario, sample: Samples, s: float, exaggeration: float = 1.0) -> np.ndarray:
    """Where the material point s, m, of the beam is, (x, y) m, deflection times `exaggeration`."""
    x, y, angle = sample.pose[0]
    w = exaggeration * float(deflection_at(scenario.payload, sample.beam_coordinates, np.array([s]))[0, 0])
    return np.array([x + s * np.cos(angle) - w * np.sin(angle), y + s * np.sin(angle) + w * np.cos(angle)])


class PullArrow:
    """Drawn while somebody pulls."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        size = scene_size(scenario)
        self._height = (models.BEAM_HEIGHT + 0.06) * size
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

    def update(self, scenario: Scenario, sample: Samples, view: View, pull: Pull | None) -> None:
        """Draw `pull`, if there is one, at the point it holds in `sample` (N = 1)."""
        self._arrow.visible = self._label.visible = pull is not None
        if pull is None:
            return
        target = np.array(pull.target)
        force = pull.stiffness * float(np.linalg.norm(target - held_point(scenario, sample, pull.position)))
        drawn = held_point(scenario, sample, pull.position, view.exaggeration)
        ends = np.column_stack([[drawn, target], [self._height, self._height]])
        self._arrow.points = ends[None].astype(np.float32)
        self._label.text = f"pull {force:.1f} N"
        self._label.position = (*pull.target, self._height)

    def remove(self) -> None:
        """Take the arrow out of the scene."""
        self._arrow.remove()
        self._label.remove()
