"""The figure of a case: the score that ranks the laws, a dot per law and scenario, or a map if there are many scenarios."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.figures import BLUE, GREEN, VERMILION, drawable, empty_figure, number_plainly, style
from flexlab.analysis.leaderboard.case import Case
from flexlab.text import number_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, LINE, AROUND = 6.5, 0.26, 1.1
"""Width of a figure, height of a law's line, and height above and below all lines, in inches."""
BESIDE = 0.15
"""Margin left and right, in inches, for names of laws that are longer in the page's language."""
ABOVE_LEGEND = 20
"""Distance between axes and title above a legend, in points."""
MARKS = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"))
"""Colour and shape of each scenario's dots."""
INK = "#1c2430"
"""Colour of digits on light shades, in dark mode too."""
DARK = 0.45
"""Share of the colour scale, from its dark end, with white digits."""


def draw_case(case: Case, laws: Sequence[str], values: np.ndarray) -> "Figure":
    """Draw the main scores (laws, variants) in the shown unit, on a logarithmic scale; NaN: no score. Less is better."""
    values = drawable(values)
    with style():
        figure = empty_figure(WIDTH, AROUND + LINE * max(len(laws), 2))
        figure.set_layout_engine("constrained", w_pad=BESIDE)
        axes = figure.add_subplot()
        if len(case.variants) <= len(MARKS):
            _draw_dots(axes, case, values)
        else:
            _draw_map(figure, axes, case, values)
        axes.set_yticks(range(len(laws)), laws)
        axes.set_ylim(len(laws) - 0.5, -0.5)
        above = ABOVE_LEGEND if 1 < len(case.variants) <= len(MARKS) else None
        axes.set_title(f"{case.name}  {case.title}", loc="left", fontsize="medium", pad=above)
    return figure


def _draw_dots(axes: "Axes", case: Case, values: np.ndarray) -> None:
    for place, variant in enumerate(case.variants):
        color, mark = MARKS[place]
        axes.plot(values[:, place], range(len(values)), mark, color=color, markersize=5, label=variant.name)
    for line in np.flatnonzero(np.isnan(values).all(axis=1)):
        place = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "center"}
        axes.annotate("no score", (0.99, line), **place, fontsize="small")
    if np.isfinite(values).any():
        axes.set_xscale("log")
        number_plainly(axes.xaxis)
    else:
        axes.set_xticks([])
    axes.grid(axis="x", which="both", alpha=0.2)
    axes.set_xlabel(case.main.column.label)
    if len(case.variants) > 1:
        look = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "frameon": False, "fontsize": "small"}
        axes.legend(ncols=len(case.variants), **look)


def _draw_map(figure: "Figure", axes: "Axes", case: Case, values: np.ndarray) -> None:
    known = values[np.isfinite(values)]
    least, most = (known.min(), max(known.max(), known.min() * 1.001)) if len(known) else (1.0, 10.0)
    drawn = axes.imshow(values, norm="log", vmin=least, vmax=most, cmap="cividis_r", aspect="auto")
    axes.grid(False)
    axes.set_xticks(range(len(case.variants)), [variant.name for variant in case.variants], rotation=30, ha="right")
    for line, place in np.ndindex(*values.shape):
        value = values[line, place]
        text, color = "–", "black"  # The page replaces black by its own colour.
        if np.isfinite(value):
            text, color = number_text(value, 2), "white" if np.greater(drawn.norm(value), 1 - DARK) else INK
        axes.text(place, line, text, ha="center", va="center", fontsize="x-small", color=color)
    number_plainly(figure.colorbar(drawn, ax=axes, label=case.main.column.label).ax.yaxis)
