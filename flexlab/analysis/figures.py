"""Figures 2 to 5 of the paper for any run, as files or as elements of pages, and figures of signals and of other studies.

Figure 2: trajectory of the payload. 3: vibration. 4: error of the trajectory. 5: internal force. The same run gives the
same bytes of SVG, so that a figure can be kept under version control.
"""

import io
import os
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexlab import views as palette
from flexlab.errors import RecordingError, StudyError
from flexlab.files import make_folder, writing
from flexlab.recording.table_columns import signal_columns
from flexlab.signal import Signal
from flexlab.sim.samples import Run, Samples
from flexlab.sim.signals import DERIVED, known_signals
from flexlab.text import in_mathtext, number_text, visible
from flexlab.views import DEFLECTION, ERROR, View, css, views

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

FORMATS = ("png", "svg")
WIDTH = 6.0
"""Width of a figure, inches: a text column."""
ROW_HEIGHT = 1.7
"""Height of a plot, inches; a figure of one plot is twice as high."""
RESOLUTION = 200
"""Resolution of PNG, dots per inch."""
POINTS = 4000
"""Largest number of points of a curve; a longer signal is drawn by the minimum and maximum of each interval."""
LARGEST = 1e100
"""Largest magnitude that is drawn: a longer axis has no ticks."""
BLUE, VERMILION, GREEN, GRAY, PURPLE = map(
    css, (palette.BLUE, palette.VERMILION, palette.GREEN, palette.GRAY, palette.PURPLE)
)
"""The lab's colours of left arm, right arm, payload, background of a curve, and desired motion."""
LINES = ("-", "--", "-.", ":")
"""Line styles of the first to fourth curve, which tell them apart without colours."""
LONGEST_EPOCH = 60
"""Most characters of an environment variable's value in a sentence."""
MILLI = 1e3
AXES = ("x", "y", "θ")
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.0,
    "svg.hashsalt": "flexlab",
    "svg.fonttype": "none",
}
_GROUND = re.compile(r'(<path [^>]*style="fill: )#ffffff("|; opacity)')
_PAGE_STYLE = (
    "<style>svg text { fill: currentColor } @media (prefers-color-scheme: dark) { svg:root { color: #e6eaf0 } }</style>"
)
"""An SVG element takes its colour from the page; an SVG image has to ask for the colour scheme itself."""


def style(salt: str = STYLE["svg.hashsalt"]) -> "AbstractContextManager[None]":
    """The context in which figures are made and written; `salt` as for `svg_text`.

    Raises `StudyError` for a SOURCE_DATE_EPOCH that matplotlib cannot read: it does so whenever it lays out an SVG.
    """
    import matplotlib as mpl  # Loading takes half a second, which a lab without figures saves.

    built = os.environ.get("SOURCE_DATE_EPOCH") or "0"
    try:
        datetime.fromtimestamp(int(built), UTC)
    except (ValueError, OverflowError, OSError):
        raise StudyError(
            f"matplotlib cannot draw with SOURCE_DATE_EPOCH = {visible(built, LONGEST_EPOCH)} in the environment: give a number "
            "of seconds since 1970, or unset it."
        ) from None
    return mpl.rc_context(STYLE | {"svg.hashsalt": salt})


def empty_figure(width: float, height: float) -> "Figure":
    """An empty figure of this size, inches."""
    from matplotlib.figure import Figure  # As in `style`.

    return Figure(figsize=(width, height), layout="constrained")


def number_plainly(*axes: "Axis") -> None:
    """Let those axes that are logarithmic say 0.1 and 0.2 where matplotlib would say 10⁻¹ and 2 × 10⁻¹."""
    from matplotlib.ticker import LogFormatter  # As in `style`.

    class Plain(LogFormatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return super().__call__(x, pos) and number_text(x)

    for axis in axes:
        if axis.get_scale() == "log":
            axis.set_major_formatter(Plain())
            axis.set_minor_formatter(Plain())


def svg_text(figure: "Figure", salt: str = STYLE["svg.hashsalt"]) -> str:
    """A figure as an SVG element. The same figure and `salt` give the same text; figures on one page need different salts."""
    with style(salt):
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    svg = drawn.getvalue()
    return svg[svg.index("<svg") :]


def page_svg(figure: "Figure", salt: str = STYLE["svg.hashsalt"]) -> str:
    """A figure as an SVG element without a background, whose lines and text take the page's colour, light or dark."""
    head, end, rest = svg_text(figure, salt).partition(">")
    shown = _GROUND.sub(r"\1none\2", rest).replace("stroke: #000000", "stroke: currentColor")
    return head + end + _PAGE_STYLE + shown


def paper_figures(run: Samples, folder: Path, formats: Sequence[str] = FORMATS, name: str = "run") -> list[Path]:
    """Write Figures 2-5 of a run as `folder/<name>-figure-<number>.<format>` and return those paths.

    Raises `StudyError` for an unknown format or a folder that cannot be written, `RecordingError` for a run without samples.
    """
    unknown = [kind for kind in formats if kind not in FORMATS]
    if unknown:
        raise StudyError(f"format = {unknown[0]} is not a format of figures: choose {' or '.join(FORMATS)}.")
    if len(run) == 0:
        raise RecordingError("The run has no samples.")
    make_folder(folder)
    figures = {number: draw_figure(number, run) for number in FIGURES}
    return [
        save_figure(figure, folder / f"{name}-figure-{number}.{kind}")
        for number, figure in figures.items()
        for kind in formats
    ]


def figure_kind(path: Path) -> str:
    """The format that a figure's file name asks for. Raises `StudyError`."""
    kind = path.suffix.lstrip(".").lower()
    if kind not in FORMATS:
        raise StudyError(f"{path} is not the name of a figure: let it end in .svg or .png.")
    return kind


def save_figure(figure: "Figure", path: Path) -> Path:
    """Write a figure, whole or not at all, in the format of its file name, and return the path. Raises `StudyError`."""
    kind = figure_kind(path)
    with writing(path) as draft, style():
        # A date would make two files of the same run differ.
        figure.savefig(draft, format=kind, dpi=RESOLUTION, metadata={"Date": None} if kind == "svg" else None)
    return path


class Curve(NamedTuple):
    """A curve over time."""

    name: str
    values: np.ndarray
    """(N,)."""
    color: str | None
    """None: matplotlib's next colour."""
    line: str


class Plot(NamedTuple):
    """Curves over time that share an axis."""

    label: str
    """Label of the axis, with its unit."""
    curves: list[Curve]
    title: str = ""


def draw_figure(number: int, samples: Samples) -> "Figure":
    """Figure 2, 3, 4 or 5 of the paper for these samples (N >= 1)."""
    with style(), np.errstate(over="ignore"):  # What exceeds `LARGEST` becomes a gap.
        figure, (first, *_) = _stacked(samples.time, FIGURES[number](samples))
        if first.get_legend_handles_labels()[1]:  # Above the plot, where no curve is.
            first.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, frameon=False)
    return figure


def _stacked(time: np.ndarray, plots: Sequence[Plot]) -> "tuple[Figure, list[Axes]]":
    """A figure with the plots below one another, and their axes."""
    figure = empty_figure(WIDTH, ROW_HEIGHT * max(len(plots), 2))
    parts = list(figure.subplots(len(plots), 1, sharex=True, squeeze=False)[:, 0])
    for part, plot in zip(parts, plots, strict=True):
        for curve in plot.curves:
            part.plot(*thin_out(time, curve.values), color=curve.color, label=curve.name, linestyle=curve.line)
        part.set_ylabel(plot.label)
        part.set_title(plot.title, fontsize="medium", loc="left")
    parts[-1].set_xlabel("t (s)")
    parts[-1].set_xlim(time[0], max(time[-1], time[0] + 1e-9))
    figure.align_ylabels()
    return figure, parts


def _trajectory(samples: Samples) -> list[Plot]:
    desired, pose = samples.desired_pose.T, samples.pose.T
    return [
        Plot(f"{axis} ({unit})", [Curve("desired", desired[k], PURPLE, "--"), Curve("payload", pose[k], GREEN, "-")])
        for k, (axis, unit) in enumerate(zip(AXES, ("m", "m", "rad"), strict=True))
    ]


def _vibration(samples: Samples) -> list[Plot]:
    _, whole, bending = map(css, DEFLECTION.colors)
    bent, held = MILLI * samples.midspan_deflection, MILLI * samples.quasi_static_deflection
    curves = [Curve("deflection at mid-span", bent, whole, "-"), Curve("its quasi-static part", held, bending, "--")]
    return [Plot("w(0, t) (mm)", curves)]


def _error(samples: Samples) -> list[Plot]:
    about = zip(AXES, ("mm", "mm", "mrad"), MILLI * samples.tracking_error.T, map(css, ERROR.colors), strict=True)
    return [Plot(f"error {axis} ({unit})", [Curve("", values, color, "-")]) for axis, unit, values, color in about]


def _internal_force(samples: Samples) -> list[Plot]:
    force, arms = samples.internal_force, (("left arm", BLUE, LINES[0]), ("right arm", VERMILION, LINES[1]))
    return [
        Plot(f"F {axis} ({unit})", [Curve(arms[i][0], force[:, i, k], *arms[i][1:]) for i in range(force.shape[1])])
        for k, (axis, unit) in enumerate(zip(AXES, ("N", "N", "N·m"), strict=True))
    ]


FIGURES = {2: _trajectory, 3: _vibration, 4: _error, 5: _internal_force}
"""Number in the paper → the plots of the figure."""


def drawable(values: np.ndarray) -> np.ndarray:
    """Values with gaps (NaN) in place of magnitudes above `LARGEST`."""
    return np.where(np.abs(values) <= LARGEST, values, np.nan)


def thin_out(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most about `POINTS` points that look like the whole curve: the minimum and maximum of each interval."""
    values = drawable(values)
    if len(values) <= POINTS:
        return time, values
    edges = np.linspace(0, len(values), POINTS // 2 + 1).astype(int)
    rows = np.concatenate([[a + np.argmin(values[a:b]), a + np.argmax(values[a:b])] for a, b in pairwise(edges)])
    rows = np.unique(np.concatenate([[0], rows, [len(values) - 1]]))
    return time[rows], values[rows]


MOST_LOOKED_AT = 3
"""Number of the lab's views, from the first, that are drawn if no signal is named."""
MOST_CURVES = 12
"""Largest number of curves in a plot with a legend."""


def draw_signals(run: Run, names: Sequence[str] = ()) -> "Figure":
    """Plot each named signal over time, in SI units; a signal whose entries have different units gets a plot for each unit.

    Without names, draw the lab's first views in its units and colours. Raises `StudyError` for an unknown signal or a run
    without samples.
    """
    known = {**known_signals(), **DERIVED}
    for name in names:
        if not isinstance(name, str) or name not in known or (name in run.absent and name not in DERIVED):
            there = [name for name in known if name in DERIVED or name in run.signals()]
            raise StudyError(f"{name!r:.60} is not a signal of this run: choose from {', '.join(there)}.")
    if len(run) == 0:
        raise StudyError("There is nothing to draw: the run has no samples.")
    with style(), np.errstate(over="ignore"):  # As in `draw_figure`.
        seen = [plot for view in views(run.scenario)[:MOST_LOOKED_AT] for plot in _of_view(run, view)]
        plots = [plot for name in names for plot in _of_signal(run, known[name])] or seen
        figure, parts = _stacked(run.time, plots)
        for part, plot in zip(parts, plots, strict=True):
            if any(curve.name for curve in plot.curves) and len(plot.curves) <= MOST_CURVES:
                part.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")
    return figure


def _of_view(run: Run, view: View) -> list[Plot]:
    plots = {unit: Plot(unit, [], view.title) for unit in view.units}
    for name, unit, color, values in zip(view.curves, view.units, view.colors, view.values(run).T, strict=True):
        _add(plots[unit], name, values, css(color))
    return list(plots.values())


def _of_signal(run: Run, signal: Signal) -> list[Plot]:
    symbol = in_mathtext(signal.symbol)
    labels = {unit: f"{symbol} ({unit})" if unit != "1" else symbol for unit in signal.units}
    plots = {unit: Plot(label, [], signal.name.replace("_", " ")) for unit, label in labels.items()}
    for column in signal_columns(signal, run.scenario):
        name = column.part.removeprefix(signal.name).strip("_").replace("_", " ")
        _add(plots[column.unit], name, run[signal.name][(slice(None), *column.index)], None)
    return list(plots.values())


def _add(plot: Plot, name: str, values: np.ndarray, color: str | None) -> None:
    plot.curves.append(Curve(name, values, color, LINES[len(plot.curves) % len(LINES)]))


def draw_bars(labels: Sequence[str], shown: Mapping[str, tuple[np.ndarray, str]]) -> "Figure":
    """A bar chart per title, with a bar for each run; `shown`: title → values (runs,), and the word in place of NaN."""
    with style():
        figure, places = panels(len(shown), WIDTH / min(len(shown), 2), ROW_HEIGHT)
        for axes, (title, (values, missing)) in zip(places, shown.items(), strict=True):
            axes.bar(labels, np.where(np.isnan(values), 0.0, values), color=BLUE)
            for place in np.flatnonzero(np.isnan(values)):
                axes.text(place, 0.0, missing, ha="center", va="bottom", rotation="vertical", fontsize="small")
            axes.set_title(title, fontsize="small")
    return figure


def panels(count: int, width: float, height: float) -> "tuple[Figure, list[Axes]]":
    """A figure of `count` panels in rows of two, each `width` × `height` inches, and their axes."""
    rows, columns = -(-count // 2), min(count, 2)
    figure = empty_figure(width * columns, height * rows)
    places = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for spare in places[count:]:
        spare.set_axis_off()
    return figure, places[:count]


def draw_fit(time: np.ndarray, signal: np.ndarray, background: np.ndarray, unit: str) -> "Figure":
    """Draw a measured signal (N,) at `time` (N,), s, and the background (N,) about which it rings."""
    curves = [Curve("samples", signal, BLUE, "-"), Curve("rings about", background, GRAY, "-")]
    with style():
        figure, (axes,) = _stacked(time, [Plot(f"signal ({unit})" if unit else "signal", curves)])
        axes.legend(frameon=False)
    return figure
