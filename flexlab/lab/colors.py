"""The lab's colours (Okabe and Ito's palette, distinguishable with any colour vision), RGB 0..255, for light and dark mode."""

from collections.abc import Sequence

import numpy as np

from flexlab.views import BLUE, GRAY, GREEN, ORANGE, PURPLE, SKY, VERMILION, VIOLET, Color, css  # noqa: F401

ARMS: tuple[Color, Color] = (BLUE, VERMILION)
"""Left arm, right arm."""
BEAM: Color = (20, 232, 150)
"""Also green, and the brightest colour of the picture."""
DESIRED = PURPLE
INTERNAL_FORCE = ORANGE
MOVING_FORCE = SKY


def for_instances(palette: Sequence[Color] | np.ndarray) -> np.ndarray:
    """Colours (N, 3) for viser's batched meshes: viser shows their numbers as linear light, all others as sRGB."""
    return np.round(255 * (np.asarray(palette) / 255) ** 2.2).astype(np.uint8)
