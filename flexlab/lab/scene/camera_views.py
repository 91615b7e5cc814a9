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
AROUND = 0.35
"""Room around the payload wherever its path takes it, in its lengths: for what bends, and the arms that hold it."""
LEAST_FREE = 0.2
"""Share of the picture's height that counts as free whatever covers it."""
CLOSE_UP = 2.6
"""Distance of the close views, in payload lengths."""

VIEWS = ("Payload", "Overview", "Plan", "Front", "Left grip", "Follow")
MOVING = ("Left grip", "Follow")
"""Those that move with the machine."""


class Window(NamedTuple):
    """A browser's picture: width over height, and the shares of its height that are covered, from above and from below."""

    aspect: float
    above: float = 0.0
    below: float = 0.0


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
    if view == "Payload":
        return payload_view(scenario, window)
    return overview(scenario, window, {"Plan": PLAN_TILT, "Front": FRONT_TILT}.get(view, TILT))


def overview(scenario: Scenario, window: Window, tilt: float = TILT) -> Shot:
    """The view of the whole floor, `tilt` rad from straight above."""
    x_min, x_max, y_min, y_max = floor_extent(scenario)
    return _fitted((x_min, x_max, y_min, y_max + CAPTION), window, tilt)


def payload_view(scenario: Scenario, window: Window) -> Shot:
    """The payload fills the free part of the picture, wherever its path takes it."""
    length, path = scenario.payload.length, scenario.trajectory
    half = np.array(path.reach[:2]) + [(0.5 + AROUND) * length, AROUND * length]
    low, high = np.array(path.middle[:2]) - half, np.array(path.middle[:2]) + half
    return _fitted((low[0], high[0], low[1], high[1]), window, TILT)


def _fitted(extent: tuple[float, float, float, float], window: Window, tilt: float) -> Shot:
    """`extent`, x_min, x_max, y_min, y_max on the floor, m, fits into the free part just so, and stands in its middle."""
    x_min, x_max, y_min, y_max = extent
    center = np.array([(x_min + x_max) / 2, (y_min + y_max) / 2, 0.0])
    half_angle = FILLED * np.tan(FIELD_OF_VIEW / 2)
    free = max(1.0 - window.above - window.below, LEAST_FREE)
    corners = np.array([(x, y, 0.0) for x in (x_min, x_max) for y in (y_min, y_max)]) - center
    forward, up = np.array([0.0, np.sin(tilt), -np.cos(tilt)]), np.array([0.0, np.cos(tilt), np.sin(tilt)])
    # A corner is in the picture from where its line of sight lies within the opening angle.
    wide = np.abs(corners[:, 0]) / (half_angle * max(window.aspect, 0.1))
    high = np.abs(corners @ up) / (half_angle * free)
    distance = float(np.max(np.maximum(wide, high) - corners @ forward))
    center[1] += (window.above - window.below) * np.tan(FIELD_OF_VIEW / 2) * distance / np.cos(tilt)
    return _from(center, distance, tilt)


def _near(place: np.ndarray, scenario: Scenario, window: Window, size: float) -> Shot:
    distance = size * CLOSE_UP * scenario.payload.length / min(max(window.aspect, 0.1), 1.0)
    return _from(np.array([*place, 0.15]), distance, TILT)


def _from(center: np.ndarray, distance: float, tilt: float) -> Shot:
    return Shot(center + distance * np.array([0.0, -np.sin(tilt), np.cos(tilt)]), center)
