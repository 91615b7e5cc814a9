"""Named places for the camera, so that the machine is in the picture whatever the window's shape."""

from typing import NamedTuple

import numpy as np

from flexlab.lab.scene.stage import floor_extent
from flexlab.scenario import Scenario
from flexlab.sim.geometry import link_points
from flexlab.sim.samples import Samples

FIELD_OF_VIEW = np.radians(28.0)
"""Vertical, rad: narrow, so that the plane of motion is hardly distorted."""
TILT = np.radians(24.0)
"""Angle between the line of sight and the vertical in the overview, rad."""
PLAN_TILT = np.radians(0.5)
"""Of the plan view, rad: straight down leaves it open which side is up."""
FRONT_TILT = np.radians(62.0)
CAPTION = 0.2
"""Room for the words above the picture, m."""
FILLED = 0.97
"""Share of the window that the floor takes up, in the direction in which it fits just so."""
TELEPHONE_SHIFT = 0.22
"""On a telephone a sheet covers the lower half: there the machine stands higher by this share of the height."""
CLOSE_UP = 2.6
"""Distance of the close views, in payload lengths."""

VIEWS = ("Overview", "Plan", "Front", "Left grip", "Follow")
MOVING = ("Left grip", "Follow")
"""Those that move with the machine."""


class Window(NamedTuple):
    """A browser's picture: width over height, width in px, and whether it is a telephone's."""

    aspect: float
    width: float = 800.0
    telephone: bool = False


class Shot(NamedTuple):
    """A camera position and the point it looks at, m, (3,) each."""

    position: np.ndarray
    look_at: np.ndarray


def shot(view: str, scenario: Scenario, sample: Samples, window: Window) -> Shot:
    """Where the camera stands for one of `VIEWS`; the close views depend on `sample` (N = 1)."""
    if view == "Left grip":
        return _near(link_points(scenario, sample.pose)[0, 0], scenario, window, 0.5)
    if view == "Follow":
        return _near(sample.pose[0, :2], scenario, window, 1.0)
    return overview(scenario, window, {"Plan": PLAN_TILT, "Front": FRONT_TILT}.get(view, TILT))


def overview(scenario: Scenario, window: Window, tilt: float = TILT) -> Shot:
    """The view of the whole floor, `tilt` rad from straight above."""
    x_min, x_max, y_min, y_max = floor_extent(scenario)
    center = np.array([(x_min + x_max) / 2, (y_min + y_max) / 2, 0.0])
    half_angle = FILLED * np.tan(FIELD_OF_VIEW / 2)
    corners = np.array([(x, y, 0.0) for x in (x_min, x_max) for y in (y_min, y_max + CAPTION)]) - center
    forward, up = np.array([0.0, np.sin(tilt), -np.cos(tilt)]), np.array([0.0, np.cos(tilt), np.sin(tilt)])
    # A corner is in the picture from where its line of sight lies within the opening angle.
    wide = np.abs(corners[:, 0]) / (half_angle * max(window.aspect, 0.1))
    high = np.abs(corners @ up) / half_angle
    distance = float(np.max(np.maximum(wide, high) - corners @ forward))
    if window.telephone:
        center[1] -= TELEPHONE_SHIFT * 2 * half_angle * distance
    return _from(center, distance, tilt)


def _near(place: np.ndarray, scenario: Scenario, window: Window, size: float) -> Shot:
    distance = size * CLOSE_UP * scenario.payload.length / min(max(window.aspect, 0.1), 1.0)
    return _from(np.array([*place, 0.15]), distance, TILT)


def _from(center: np.ndarray, distance: float, tilt: float) -> Shot:
    return Shot(center + distance * np.array([0.0, -np.sin(tilt), np.cos(tilt)]), center)
