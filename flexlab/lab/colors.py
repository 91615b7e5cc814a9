"""The lab's colours (Okabe and Ito's palette, told apart with any colour vision), RGB 0..255, light and dark mode alike."""

from collections.abc import Sequence

import numpy as np

from flexlab.views import BLUE, GRAY, GREEN, ORANGE, PURPLE, SKY, VERMILION, VIOLET, Color  # noqa: F401

ARMS: tuple[Color, Color] = (BLUE, VERMILION)
"""Left arm, right arm."""
BEAM: Color = (20, 232, 150)
"""Green as well, and the brightest colour of the picture."""
DESIRED = PURPLE
INTERNAL_FORCE = ORANGE
MOVING_FORCE = SKY


def css(color: Color) -> str:
    """The colour as a page or plot wants it, "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def for_instances(palette: Sequence[Color] | np.ndarray) -> np.ndarray:
    """Colours (N, 3) as viser's batched meshes want them: it shows their numbers as linear light, all else as sRGB."""
    return np.round(255 * (np.asarray(palette) / 255) ** 2.2).astype(np.uint8)
