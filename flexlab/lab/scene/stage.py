"""The floor's grid with lengths along its edges, and the light."""

import numpy as np
import viser

from flexlab.lab import colors
from flexlab.scenario import Scenario

CELL, SECTION = 0.1, 0.5
"""Grid spacing, m."""
SKY_INTENSITY = 0.9
"""Light from all sides, relative to three.js' unit: fills in the sides that the lamp above leaves dark."""
FLOOR_COLOR, FLOOR_OPACITY = (120, 130, 144), 0.16
"""A floor a little darker than a light page and lighter than a dark one: beam and grips are brighter than both."""
LABEL_INSET = 0.03
"""Distance of the lengths from the floor's edge, m."""
LABEL_HEIGHT = 0.04
"""Height of the lengths above the floor, which would hide a part of them, m."""
ELBOW_SHARE = 0.88
"""How far an elbow swings out beside its base, in lengths of the first link: the paper's motion with a little room."""
MARGIN = 0.25
"""Floor around the arms' reach, m."""
BEYOND = 3.0
"""How far the drawn floor goes on, m: to the edges of any picture."""


def floor_extent(scenario: Scenario) -> tuple[float, float, float, float]:
    """x_min, x_max, y_min, y_max of the floor, m, on whole cells: bases, and where trajectory and elbows go."""
    bases = np.array([arm.base for arm in scenario.arms])
    center, swing = np.array(scenario.trajectory.middle[:2]), np.array(scenario.trajectory.reach[:2])
    half = 0.5 * scenario.payload.length
    elbow = max(arm.link_length[0] for arm in scenario.arms)
    low = np.minimum(bases.min(axis=0) - [ELBOW_SHARE * elbow, MARGIN], center - swing - half - MARGIN)
    high = np.maximum(bases.max(axis=0) + [ELBOW_SHARE * elbow, MARGIN], center + swing + half)
    low, high = np.floor(low / CELL) * CELL, np.ceil(high / CELL) * CELL
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _sections(low: float, high: float) -> np.ndarray:
    """The multiples of `SECTION` from low to high, m."""
    return SECTION * np.arange(np.ceil(low / SECTION - 1e-6), np.floor(high / SECTION + 1e-6) + 1) + 0.0


def _lengths(axis: str, places: np.ndarray) -> list[tuple[float, str]]:
    """(place, text) along an axis; the last one has name and unit, so that the others fit into a small window."""
    texts = [f"{place:g}".replace("-", "−") for place in places]
    return list(zip(places.tolist(), [*texts[:-1], *(f"{axis} = {text} m" for text in texts[-1:])], strict=True))


def draw_floor(scene: viser.SceneApi, scenario: Scenario) -> None:
    """The grid below the arms, with lengths along its edges."""
    x_min, x_max, y_min, y_max = floor_extent(scenario)
    scene.add_grid(
        "/floor/grid",
        width=x_max - x_min + 2 * BEYOND,
        height=y_max - y_min + 2 * BEYOND,
        position=((x_min + x_max) / 2, (y_min + y_max) / 2, 0.0),
        cell_size=CELL,
        cell_color=colors.GRAY,
        cell_thickness=0.3,
        section_size=SECTION,
        section_color=colors.GRAY,
        section_thickness=0.7,
        plane_color=FLOOR_COLOR,
        plane_opacity=FLOOR_OPACITY,
        shadow_opacity=0.25,
    )
    for x, text in _lengths("x", _sections(x_min, x_max)):
        place = (x, y_min + LABEL_INSET, LABEL_HEIGHT)
        # At the floor's corners, which the window's edge may cut, words stand inside.
        side = "left" if x - x_min < CELL else "right" if x_max - x < CELL else "center"
        scene.add_label(f"/floor/x{x:g}", text, position=place, anchor=f"bottom-{side}", depth_test=True)
    for y, text in _lengths("y", _sections(y_min, y_max)):
        place = (x_min + LABEL_INSET, y, LABEL_HEIGHT)
        scene.add_label(f"/floor/y{y:g}", text, position=place, anchor="center-left", depth_test=True)


def set_light(scene: viser.SceneApi, shadows: bool) -> None:
    """Light from above and the side: bright enough for both colour modes, without bleaching the colours."""
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=True, cast_shadow=shadows)
    scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(170, 178, 190), intensity=SKY_INTENSITY)
