"""Where the camera stands so that the whole machine is in the picture, whatever the window's shape."""

from typing import NamedTuple

import numpy as np

from flexlab.lab.scene.stage import floor_extent
from flexlab.scenario import Scenario

FIELD_OF_VIEW = np.radians(28.0)
"""Vertical, rad: narrow, so that the plane of motion is hardly distorted."""
TILT = np.radians(24.0)
"""Angle between the line of sight and the vertical, rad."""
ROOM_HIGH, ROOM_WIDE = 1.1, 1.25
"""Distance relative to the one at which the floor's middle fills the window: room for its nearer edge and the labels."""
TELEPHONE_SHIFT = 0.22
"""On a telephone a sheet covers the lower half: there the machine stands higher by this share of the height."""


class Shot(NamedTuple):
    """A camera position and the point it looks at, m, (3,) each."""

    position: np.ndarray
    look_at: np.ndarray


def overview(scenario: Scenario, aspect: float, telephone: bool = False) -> Shot:
    """The view of the whole floor from above, for a window `aspect` times as wide as high."""
    x_min, x_max, y_min, y_max = floor_extent(scenario)
    center = np.array([(x_min + x_max) / 2, (y_min + y_max) / 2, 0.0])
    half_angle = np.tan(FIELD_OF_VIEW / 2)
    needed_high = 0.5 * (y_max - y_min) / half_angle
    needed_wide = 0.5 * (x_max - x_min) / (half_angle * max(aspect, 0.1))
    distance = max(ROOM_HIGH * needed_high, ROOM_WIDE * needed_wide)
    if telephone:
        center[1] -= TELEPHONE_SHIFT * 2 * half_angle * distance
    return Shot(center + distance * np.array([0.0, -np.sin(TILT), np.cos(TILT)]), center)
