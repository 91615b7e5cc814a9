"""The lab's colours (Okabe and Ito's palette, told apart with any colour vision), RGB 0..255, light and dark mode alike."""

from collections.abc import Sequence

import numpy as np

Color = tuple[int, int, int]

BLUE: Color = (0, 114, 178)
VERMILION: Color = (213, 94, 0)
GREEN: Color = (0, 158, 115)
PURPLE: Color = (204, 121, 167)
ORANGE: Color = (230, 159, 0)
SKY: Color = (86, 180, 233)
LIGHT_BLUE: Color = (46, 141, 204)
"""Blue for thin lines, which must stand out from white and from black."""
VIOLET: Color = (142, 98, 218)
OLIVE: Color = (140, 138, 20)
ROSE: Color = (214, 84, 120)
GRAY: Color = (128, 134, 142)

ARMS: tuple[Color, Color] = (BLUE, VERMILION)
"""Left arm, right arm."""
BEAM: Color = (20, 232, 150)
"""Green as well, and the brightest colour of the picture."""
CURVES: tuple[Color, Color, Color] = (VIOLET, OLIVE, ROSE)
"""Curves of a plot: none of them is an arm's."""
DESIRED = PURPLE
INTERNAL_FORCE = ORANGE
MOVING_FORCE = SKY


def css(color: Color) -> str:
    """The colour as a page or plot wants it, "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def for_instances(palette: Sequence[Color]) -> np.ndarray:
    """Colours (N, 3) as viser's batched meshes want them: it shows their numbers as linear light, all else as sRGB."""
    return np.round(255 * (np.asarray(palette) / 255) ** 2.2).astype(np.uint8)
