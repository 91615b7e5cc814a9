"""One uPlot chart that follows one plot's signals."""

import re
from collections.abc import Sequence
from typing import cast

import numpy as np
import viser
from viser import uplot

from flexlab.lab import colors
from flexlab.lab.panel.text import escaped
from flexlab.lab.plots.curve import WHOLE, Curve, drawn_points
from flexlab.lab.plots.plot_signals import Limit, Plot
from flexlab.lab.ranges import Span
from flexlab.lab.reference_run import ReferenceRun
from flexlab.lab.viser_internals import send_plot_data, widget_uuid
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK

HEIGHT = 190
"""Of a chart, px; its legend comes on top."""
X_AXIS_SIZE, Y_AXIS_SIZE, UNIT_SIZE = 34, 50, 18
"""Room for the numbers at the axes, px: "50,000" upright, and the legend's first line below; and for the unit beside them."""

UNNAMED = "fl-unnamed"
"""Style class of series that the legend leaves out."""

# The vertical range is held by an unseen last series that goes from end to end at every point, whatever is zoomed into: a
# changed scale option would make the browser build the chart anew and lose its place. No other series may have a say: one
# that begins with a gap would leave the axis without numbers.
RANGE_HOLDER = cast(
    uplot.Series, {"label": "range", "class": UNNAMED, "stroke": "rgba(0,0,0,0)", "width": 0, "points": {"show": False}}
)
EXACTLY_THE_DATA = {"min": {"pad": 0, "mode": 0}, "max": {"pad": 0, "mode": 0}}


def axis(size: int, label: str = "") -> uplot.Axis:
    """An axis with short ticks and `size` px of room."""
    made = uplot.Axis(size=size, gap=2, ticks=uplot.Axis_Ticks(size=4, width=1), grid=uplot.Axis_Grid(width=1))
    return cast(uplot.Axis, made | {"label": label, "labelSize": UNIT_SIZE, "labelGap": 0}) if label else made


def units_of(labels: Sequence[str]) -> str:
    """The units in brackets at the ends of labels, each once."""
    found = (re.search(r"\(([^()]+)\)$", label) for label in labels)
    return ", ".join(dict.fromkeys(each[1] for each in found if each))


def signal_series(label: str, tone: colors.Color) -> uplot.Series:
    """How a signal is drawn."""
    return uplot.Series(label=label, stroke=colors.css(tone), width=1.25, spanGaps=False, auto=False)


def kept_series(tone: colors.Color) -> uplot.Series:
    """How a signal of the kept run is drawn: dotted, in its signal's colour, not in the legend."""
    style = {"label": "kept", "class": UNNAMED, "auto": False}
    style |= {"stroke": f"rgba{(*tone, 0.75)}", "width": 1.25, "dash": (2, 3)}
    return cast(uplot.Series, style)


def limit_series(limit: Limit) -> list[uplot.Series]:
    """Two dashed lines; only the first one is named."""
    style = {"stroke": colors.css(limit.tone), "width": 1, "dash": (6, 5), "points": {"show": False}, "auto": False}
    second = {**style, "label": limit.label, "class": UNNAMED}
    return [cast(uplot.Series, {**style, "label": limit.label}), cast(uplot.Series, second)]


def compact(time: np.ndarray, lines: Sequence[np.ndarray], spacing: float) -> tuple[np.ndarray, ...]:
    """The columns of a chart in half the bytes; `time`, `spacing` s apart, only while that leaves it exact to a tenth."""
    narrow = np.spacing(np.float32(np.abs(time).max())) < 0.1 * spacing
    return (time.astype(np.float32) if narrow else time, *(line.astype(np.float32) for line in lines))


class Chart:
    """A chart in the GUI container that is open while it is made."""

    def __init__(
        self, gui: viser.GuiApi, plot: Plot, scenario: Scenario, window: float, kept: ReferenceRun | None, group: str
    ):
        """Charts of one `group` have their cursor, and what is zoomed into, in common."""
        self._plot, self._limits, self._kept = plot, plot.limits(scenario), kept
        self._span = Span(plot.least)
        self._seen: Sequence[float] = WHOLE
        self.restart(window)
        series = [uplot.Series(label="t (s)")]
        series += [signal_series(label, tone) for label, tone in zip(plot.labels, plot.tones, strict=True)]
        if kept is not None:
            series += [kept_series(tone) for tone in plot.tones]
        for limit in self._limits:
            series += limit_series(limit)
        self._handle = gui.add_uplot(
            self._data(),
            (*series, RANGE_HOLDER),
            title=plot.title,
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(range=EXACTLY_THE_DATA)},
            axes=(axis(X_AXIS_SIZE), axis(Y_AXIS_SIZE, units_of(plot.labels))),
            legend=uplot.Legend(live=True),
            cursor=uplot.Cursor(drag=uplot.Cursor_Drag(x=True, y=False), sync=uplot.Cursor_Sync(key=group)),
            height=HEIGHT,
            padding=(6, 12, 0, 0),
        )
        note = f'<div class="fl fl-dim">{escaped(plot.note)}</div>' if plot.note else ""
        self._note = gui.add_html(note, visible=bool(note))

    @property
    def newest(self) -> int:
        """Tick of the newest sample taken in, -1 if none."""
        return self._curve.newest

    @property
    def uuid(self) -> str:
        """How the page calls it."""
        return widget_uuid(self._handle)

    def restart(self, window: float) -> None:
        """Forget everything and go on with a window of `window` s."""
        self._curve = Curve(len(self._plot.labels), window)
        self._kept_curve = None
        if self._kept is not None:
            self._kept_curve = Curve(len(self._plot.labels), window, keep_all=True)
            samples = self._kept.samples
            self._kept_curve.append(samples.time, self._plot.values(self._kept.scenario, samples))

    def append(self, scenario: Scenario, samples: Samples) -> None:
        """Take in samples; those already seen are passed over."""
        self._curve.append(samples.time, self._plot.values(scenario, samples))

    def remove(self) -> None:
        """Take the chart off the screen."""
        self._handle.remove()
        self._note.remove()

    def show(self, seen: Sequence[float] = WHOLE) -> None:
        """Send the chart as it now is; `seen`: the part of the window that is zoomed into, as shares of it."""
        self._seen = seen
        send_plot_data(self._handle, self._data())

    def _data(self) -> tuple[np.ndarray, ...]:
        start = self._curve.start
        block = self._curve.block(start)
        if self._kept_curve is not None:
            block = np.concatenate([block, self._kept_curve.block(start)])
        drawn = drawn_points(block, self._seen)
        lines = block[:, drawn]
        if np.isfinite(lines).any():
            self._span.fit(float(np.nanmin(lines)), float(np.nanmax(lines)))
        low, high = self._span.ends
        levels = [self._level(len(drawn), sign * limit.value) for limit in self._limits for sign in (1, -1)]
        ends = np.full(len(drawn), high)
        ends[::2] = low
        return compact((start + drawn) * TICK, [*lines, *levels, ends], TICK)

    def _level(self, count: int, value: float) -> np.ndarray:
        """A horizontal line, empty outside the range."""
        low, high = self._span.ends
        return np.full(count, value if low <= value <= high else np.nan)
