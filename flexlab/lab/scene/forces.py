"""Forces and moments at the grips: straight and bent arrows, each kind with its own scale, which adapts in steps."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from flexlab.lab.ranges import AFTER_PICTURES, Range
from flexlab.lab.scene.arms import BEAM_HEIGHT, LINK_HEIGHTS, scene_size
from flexlab.lab.view_settings import ViewSettings
from flexlab.scenario import Scenario
from flexlab.sim.commands import Pull
from flexlab.sim.geometry import arm_points, deflection_at, link_points
from flexlab.sim.samples import Samples
from flexlab.text import fixed_text, number_text
from flexlab.views import ORANGE, SKY, VERMILION, Color

LONGEST_ARROW = 0.4
"""Length of an arrow at the limit of the force range, in beam lengths: the arrows of two pressing grips never meet."""
WIDEST_ARC = np.pi
"""Angle of a bent arrow at the limit of the moment range, rad."""
ARC_RADIUS = 0.09
"""Radius of the bent arrows for the paper's arms, m."""
ARC_PIECES = 16
LEAST_FORCE, LEAST_MOMENT = 1.0, 0.5
"""Least ranges, N and N·m: smaller loads need not be magnified."""
INTERNAL_FORCE, MOVING_FORCE = ORANGE, SKY
AWAY = np.array([0.0, 0.0, -1e3])
"""Place of hidden parts, m: a browser shows a part at once and moves it a picture later, so that a part that is shown again would
flash at its last place."""
HIDDEN_BELOW = 0.03
"""Fraction of the range below which arrows are hidden: their heads alone would exaggerate."""


def _arrows_away(count: int) -> np.ndarray:
    """Ends (count, 2, 3) of hidden arrows."""
    return np.tile([AWAY, AWAY + [1.0, 0.0, 0.0]], (count, 1, 1)).astype(np.float32)


def _hidden_arrows(scene: viser.SceneApi, name: str, color: Color, count: int, sizes: Sequence[float]) -> Any:
    """Add hidden arrows. `sizes`: radii of shaft and head, and the head's length, m."""
    shaft, head, length = sizes
    look = {"shaft_radius": shaft, "head_radius": head, "head_length": length, "visible": False}
    return scene.add_arrows(name, _arrows_away(count), np.tile(np.array(color, np.uint8), (count, 1)), **look)


class Arrows:
    """Arrows of one kind, one for each grip, with their own scale."""

    def __init__(self, handle: Any, away: np.ndarray, least: float, height: float):
        """`away`: the points of hidden arrows; `least`: the smallest range; `height` above the floor, m."""
        self._handle, self._away, self._height = handle, away, height
        self._range = Range(least, AFTER_PICTURES)
        self._was_shown = False

    def update(self, places: np.ndarray, loads: np.ndarray, shown: bool) -> None:
        """Draw `loads`, (arms, 2) N or (arms,) N·m, at `places` (arms, 2) m."""
        largest = float(np.linalg.norm(loads.reshape(len(loads), -1), axis=1).max())
        self._range.fit(largest)
        self._handle.visible = shown and largest > HIDDEN_BELOW * self._range.limit
        if shown:  # Even if they are too small to be seen: they grow at their place.
            plane = self._plane(places, loads)
            height = np.full((*plane.shape[:2], 1), self._height)
            self._handle.points = np.concatenate([plane, height], axis=2).astype(np.float32)
        elif self._was_shown:
            self._handle.points = self._away
        self._was_shown = shown

    def _plane(self, places: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Ends of the drawn lines, (lines, 2, 2) m."""
        raise NotImplementedError


class StraightArrows(Arrows):
    """Arrows of forces."""

    def __init__(self, scene: viser.SceneApi, name: str, color: Color, scenario: Scenario, height: float):
        self._longest = LONGEST_ARROW * scenario.payload.length
        count, sizes = len(scenario.arms), [scene_size(scenario) * part for part in (0.006, 0.016, 0.04)]
        arrows = _hidden_arrows(scene, name, color, count, sizes)
        super().__init__(arrows, _arrows_away(count), LEAST_FORCE, height)

    @property
    def per_meter(self) -> float:
        """Force that one metre of arrow stands for, N."""
        return self._range.limit / self._longest

    def _plane(self, places: np.ndarray, loads: np.ndarray) -> np.ndarray:
        return np.stack([places, places + loads / self.per_meter], axis=1)


class BentArrows(Arrows):
    """Arrows of moments: arcs with heads."""

    def __init__(self, scene: viser.SceneApi, name: str, color: Color, count: int, size: float, height: float):
        self._radius = ARC_RADIUS * size
        away = np.tile(AWAY, (count * (ARC_PIECES + 2), 2, 1)).astype(np.float32)
        lines = scene.add_line_segments(name, away, color, thickness=3.5, thickness_units="screen", visible=False)
        super().__init__(lines, away, LEAST_MOMENT, height)

    @property
    def per_quarter_turn(self) -> float:
        """Moment that a quarter of a turn stands for, N·m."""
        return self._range.limit * (np.pi / 2) / WIDEST_ARC

    def _plane(self, places: np.ndarray, loads: np.ndarray) -> np.ndarray:
        turns = loads / self._range.limit * WIDEST_ARC
        return np.concatenate([self._arc(center, turn) for center, turn in zip(places, turns, strict=True)])

    def _arc(self, center: np.ndarray, turn: float) -> np.ndarray:
        """Line segments (ARC_PIECES + 2, 2, 2): the arc from the top of the circle, and the two lines of its head."""
        angle = np.pi / 2 + np.linspace(0, turn, ARC_PIECES + 1)
        line = center + self._radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        back = angle[-1] - np.sign(turn) * min(0.35, abs(turn))
        strokes = [center + factor * self._radius * np.array([np.cos(back), np.sin(back)]) for factor in (0.8, 1.2)]
        head = np.array([[line[-1], stroke] for stroke in strokes])
        return np.concatenate([np.stack([line[:-1], line[1:]], axis=1), head])


class Forces:
    """Internal force, moving force and internal moment of every grip."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        count, size = len(scenario.arms), scene_size(scenario)
        height = (BEAM_HEIGHT + 0.05) * size
        self._internal = StraightArrows(scene, "/forces/internal", INTERNAL_FORCE, scenario, height)
        self._moving = StraightArrows(scene, "/forces/moving", MOVING_FORCE, scenario, height + 0.01 * size)
        self._moment = BentArrows(scene, "/forces/moment", INTERNAL_FORCE, count, size, height)

    def update(self, scenario: Scenario, sample: Samples, view: ViewSettings) -> None:
        """Draw the forces of `sample` (N = 1) that `view` asks for."""
        grips = link_points(scenario, sample.pose)[0][: len(scenario.arms)]
        moving = np.repeat(sample.moving_force[:, :2], len(grips), axis=0)
        self._internal.update(grips, sample.internal_force[0, :, :2], view.forces)
        self._moving.update(grips, moving, view.moving_force)
        self._moment.update(grips, sample.internal_force[0, :, 2], view.moments)

    def scales(self, view: ViewSettings) -> list[tuple[str, str]]:
        """(label, value) of the scale of every kind of arrow that is shown."""
        rows = (
            (view.forces, "scale of the internal force", 0.1 * self._internal.per_meter, "N per 10 cm"),
            (view.moving_force, "scale of the moving force", 0.1 * self._moving.per_meter, "N per 10 cm"),
            (view.moments, "scale of the internal moment", self._moment.per_quarter_turn, "N·m per ¼ turn"),
        )
        return [(what, f"{number_text(amount)} {unit}") for shown, what, amount, unit in rows if shown]


def held_point(scenario: Scenario, sample: Samples, pull: Pull, exaggeration: float = 1.0) -> np.ndarray:
    """Position (x, y), m, of the held point of beam or link in `sample` (N = 1), with the deflection times `exaggeration`."""
    if pull.link is not None:
        arm, link = pull.link
        inner, outer = arm_points(scenario, sample)[0, arm - 1, link - 1 : link + 1]
        return inner + pull.position / scenario.arms[arm - 1].link_length[link - 1] * (outer - inner)
    s, (x, y, angle) = pull.position, sample.pose[0]
    w = exaggeration * float(deflection_at(scenario.payload, sample.beam_coordinates, np.array([s]))[0, 0])
    return np.array([x + s * np.cos(angle) - w * np.sin(angle), y + s * np.sin(angle) + w * np.cos(angle)])


class PullArrow:
    """The arrow of a pull, drawn while somebody pulls."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        sizes = [self._size * part for part in (0.005, 0.014, 0.035)]
        self._arrow = _hidden_arrows(scene, "/pull", VERMILION, 1, sizes)
        self._label = scene.add_label("/pull_force", "", anchor="bottom-left", visible=False)

    def update(self, scenario: Scenario, sample: Samples, view: ViewSettings, pull: Pull | None) -> None:
        """Draw `pull`, if there is one, at the point that it holds in `sample` (N = 1)."""
        held = pull is not None and (pull.link is None or pull.link[0] <= len(scenario.arms))
        was_held, self._arrow.visible, self._label.visible = self._arrow.visible, held, held
        if pull is None or not held:
            if was_held:
                self._arrow.points, self._label.text, self._label.position = _arrows_away(1), "", tuple(AWAY)
            return
        target = np.array(pull.target)
        force = pull.stiffness * float(np.linalg.norm(target - held_point(scenario, sample, pull)))
        drawn = held_point(scenario, sample, pull, view.exaggeration)
        # In the plane of the dragged point, so that the arrow's tip is under the pointer.
        height = self._size * (BEAM_HEIGHT if pull.link is None else LINK_HEIGHTS[pull.link[1] - 1])
        ends = np.column_stack([[drawn, target], [height, height]])
        self._arrow.points = ends[None].astype(np.float32)
        self._label.text = f"pull {fixed_text(force, 1)} N"
        self._label.position = (*pull.target, height)
