"""One uPlot chart that follows one plot's signals.

Drawing every twentieth sample of a 44 Hz ring would show a slow wave that does not exist (aliasing), and drawing extremes at
fixed places would make smooth signals look like stairs. So each stretch of time is drawn by the samples at which a signal is
least and greatest: a ring keeps its width, and a slow signal stays smooth. Stretches begin at multiples of their length, so
that nothing shimmers while the window moves on. Where a browser has zoomed in, stretches are shorter.
"""

import re
from collections.abc import Sequence
from typing import cast

import numpy as np
import viser
from viser import uplot

from flexlab.lab.plots import Limit, Plot
from flexlab.lab.ranges import Span
from flexlab.lab.reference_run import ReferenceRun
from flexlab.lab.viser_internals import send_plot_data, widget_uuid
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK
from flexlab.text import escaped
from flexlab.views import Color, css

STRETCHES = 140
"""Stretches per window, or per zoomed part of it: one per two screen pixels of a plot."""
WHOLE = (0.0, 1.0)
"""The visible part of a window without zoom, as fractions of it."""
HEIGHT = 140
"""Height of a chart without its legend, px."""
X_AXIS_SIZE, Y_AXIS_SIZE, UNIT_SIZE = 34, 50, 18
"""Room below the x axis (numbers, the legend's first line), beside the y axis ("50,000") and for its unit, px."""
TICK_SPACE = 16
"""Least px between two numbers at the y axis, a line's height: then a chart of 100 px has three ticks or more."""
UNNAMED = "fl-unnamed"
"""Style class of series that the legend leaves out."""
# An invisible last series, which goes from end to end at every point, sets the vertical range at any zoom: a changed scale
# option would make the browser rebuild the chart and lose its zoom. No other series may set the range: one that begins with
# a gap would leave the axis without numbers.
RANGE_HOLDER = cast(
    uplot.Series, {"label": "range", "class": UNNAMED, "stroke": "rgba(0,0,0,0)", "width": 0, "points": {"show": False}}
)
EXACTLY_THE_DATA = {"min": {"pad": 0, "mode": 0}, "max": {"pad": 0, "mode": 0}}
INCREMENTS = tuple(digit * 10.0**power for power in range(-3, 10) for digit in (1, 2, 5))
"""Distances of ticks, in plot units: the chart writes at most three decimals, so that 0.0025 would read 0.003."""
DASHES = ((), (9, 4), (12, 3, 3, 3))
"""Dashes of the first, second and third curve, px, for people who cannot tell the colours apart; then they repeat."""
SMOOTH = {"pxAlign": 0}
"""Draws a series where it is: rounded to whole pixels, a curve that rises slowly has steps and kinks."""
LARGEST = float(np.finfo(np.float32).max)
"""Largest number of a chart; runs that reach it have stopped."""


class Curve:
    """The newest samples of `signals` signals in a window of `seconds` s; `append` adds them in time order.

    `keep_all`: keep the samples that leave the window.
    """

    def __init__(self, signals: int, seconds: float, keep_all: bool = False):
        self._signals, self._keep_all = signals, keep_all
        self.stretch = max(1, round(seconds / TICK / STRETCHES))
        """Ticks of one stretch."""
        self.window = self.stretch * STRETCHES + 1
        """Ticks of the window, both ends included."""
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._values = np.empty((self._signals, 0))
        self._first = self._origin = 0
        self.newest = -1
        """Tick of the newest sample, -1 if empty."""

    def append(self, time: np.ndarray, values: np.ndarray) -> None:
        """Add samples at `time` (N,) s with `values` (signals, N); those not newer than the newest are skipped."""
        ticks = np.rint(time / TICK).astype(int)
        fresh = ticks > self.newest
        if not fresh.any():
            return
        ticks, values = ticks[fresh], values[:, fresh]
        if self.newest < 0:
            self._first = self._origin = int(ticks[0])
        elif ticks[0] - self.newest > self.window and not self._keep_all:
            # The plots were held, or nobody watched, perhaps for hours: room for all that time would fill the memory.
            self._values, self._first = self._values[:, :0], int(ticks[0])
        end = self._first + self._values.shape[1]
        block = np.full((self._signals, int(ticks[-1]) + 1 - end), np.nan)
        block[:, ticks - end] = values
        self.newest = int(ticks[-1])
        self._values = np.concatenate([self._values, block], axis=1)
        surplus = self._values.shape[1] - 2 * self.window
        if surplus > 0 and not self._keep_all:
            self._values, self._first = self._values[:, surplus:], self._first + surplus

    @property
    def start(self) -> int:
        """First tick of the window, which does not move until it is full."""
        return self.stretch * max(self._origin // self.stretch, self.newest // self.stretch - STRETCHES + 1)

    def block(self, start: int) -> np.ndarray:
        """All samples of the window that begins at tick `start`, (signals, window); NaN for missing ones."""
        found = np.full((self._signals, self.window), np.nan)
        first, last = max(start, self._first), min(start + self.window, self._first + self._values.shape[1])
        if first < last:
            found[:, first - start : last - start] = self._values[:, first - self._first : last - self._first]
        return found


def drawn_points(block: np.ndarray, seen: Sequence[float] = WHOLE) -> np.ndarray:
    """Indices (P,) of the samples of `block` (signals, N) to draw: its ends, the borders of gaps, and all signals' extremes.

    `seen`: the part of the block that is zoomed into, as fractions of it.
    """
    last = block.shape[1] - 1
    drawn = np.zeros(last + 1, bool)
    drawn[[0, last]] = True
    missing = np.asarray(np.isnan(block).any(axis=0), bool)
    borders = np.flatnonzero(missing[1:] != missing[:-1])
    drawn[borders] = drawn[borders + 1] = True
    coarse = max(1, last // STRETCHES)
    low, high = (min(max(share, 0.0), 1.0) * last for share in seen)
    fine = max(1, min(coarse, round((high - low) / STRETCHES)))
    first, end = int(low) // coarse * coarse, min(-(-int(high) // coarse) * coarse, last)
    _mark_extremes(drawn[: first + 1], block[:, : first + 1], coarse)
    _mark_extremes(drawn[first : end + 1], block[:, first : end + 1], fine)
    _mark_extremes(drawn[end:], block[:, end:], coarse)
    return np.flatnonzero(drawn)


def _mark_extremes(drawn: np.ndarray, block: np.ndarray, stretch: int) -> None:
    """Mark where each signal is least and greatest within each stretch; neighbouring stretches share a sample."""
    count = (block.shape[1] - 1) // stretch
    if stretch == 1 or count < 1:
        drawn[:] = True
        return
    end = count * stretch
    pieces = np.lib.stride_tricks.sliding_window_view(block[:, : end + 1], stretch + 1, axis=1)[:, ::stretch]
    begin = np.arange(count) * stretch
    empty = np.isnan(pieces)
    known = ~empty.all(axis=2)
    silent = np.asarray(empty.all(axis=(0, 2)), bool)
    drawn[begin[silent]] = True  # Points without a value hold the axes.
    for places in (np.where(empty, np.inf, pieces).argmin(axis=2), np.where(empty, -np.inf, pieces).argmax(axis=2)):
        drawn[(begin + places)[known]] = True
    if end + 1 < block.shape[1]:
        _mark_extremes(drawn[end:], block[:, end:], block.shape[1] - 1 - end)


def axis(size: int, unit: str | None = None) -> uplot.Axis:
    """An axis with short ticks and `size` px of room; a vertical one names its unit, or none by an empty text."""
    made = uplot.Axis(
        size=size, gap=2, incrs=INCREMENTS, ticks=uplot.Axis_Ticks(size=4, width=1), grid=uplot.Axis_Grid(width=1)
    )
    if unit is None:
        return made
    named = {"label": unit, "labelSize": UNIT_SIZE, "labelGap": 0} if unit else {}
    return cast(uplot.Axis, made | named | {"space": TICK_SPACE})


def units_of(labels: Sequence[str]) -> str:
    """The units in brackets at the ends of the labels, each once."""
    found = (re.search(r"\(([^()]+)\)$", label) for label in labels)
    return ", ".join(dict.fromkeys(each[1] for each in found if each))


def signal_series(label: str, tone: Color, place: int = 0) -> uplot.Series:
    """The style of a signal, by its place in its chart."""
    dash = DASHES[place % len(DASHES)]
    style = {"label": label, "stroke": css(tone), "width": 1.25, "spanGaps": False, "auto": False, "dash": dash}
    return cast(uplot.Series, style | SMOOTH)


def kept_series(tone: Color) -> uplot.Series:
    """The style of a signal of the kept run: dotted, in the signal's colour, not in the legend."""
    style = {"label": "kept", "class": UNNAMED, "auto": False, **SMOOTH}
    style |= {"stroke": f"rgba{(*tone, 0.75)}", "width": 1.25, "dash": (2, 3)}
    return cast(uplot.Series, style)


def limit_series(limit: Limit) -> list[uplot.Series]:
    """The two dashed lines of a limit, of which only the first is in the legend."""
    style = {"stroke": css(limit.tone), "width": 1, "dash": (3, 6), "points": {"show": False}, "auto": False}
    second = {**style, "label": limit.label, "class": UNNAMED}
    return [cast(uplot.Series, {**style, "label": limit.label}), cast(uplot.Series, second)]


def compact(time: np.ndarray, lines: Sequence[np.ndarray], spacing: float) -> tuple[np.ndarray, ...]:
    """The columns of a chart in single precision; `time` only while that is exact to a tenth of its `spacing`, s."""
    narrow = np.spacing(np.float32(np.abs(time).max())) < 0.1 * spacing
    return (
        time.astype(np.float32) if narrow else time,
        *(np.clip(line, -LARGEST, LARGEST).astype(np.float32) for line in lines),
    )


class Chart:
    """A chart, made in the open GUI container."""

    def __init__(self, gui: viser.GuiApi, plot: Plot, window: float, kept: ReferenceRun | None, group: str):
        """Charts of one `group` share their cursor and their zoom."""
        self._plot, self._kept, self._limits = plot, kept, plot.limits
        self._span = Span(plot.least)
        self._seen: Sequence[float] = WHOLE
        self.restart(window)
        series = [uplot.Series(label="t (s)")]
        signals = zip(plot.labels, plot.tones, strict=True)
        series += [signal_series(label, tone, place) for place, (label, tone) in enumerate(signals)]
        if kept is not None:
            series += [kept_series(tone) for tone in plot.tones]
        for limit in plot.limits:
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
        self.uuid = widget_uuid(self._handle)
        note = f'<div class="fl fl-dim">{escaped(plot.note)}</div>' if plot.note else ""
        self._note = gui.add_html(note, visible=bool(note))

    @property
    def newest(self) -> int:
        """Tick of the newest sample, -1 if none."""
        return self._curve.newest

    def restart(self, window: float) -> None:
        """Forget all samples and continue with a window of `window` s."""
        self._curve = Curve(len(self._plot.labels), window)
        self._kept_curve = None
        if self._kept is not None:
            self._kept_curve = Curve(len(self._plot.labels), window, keep_all=True)
            samples = self._kept.samples
            self._kept_curve.append(samples.time, self._plot.values(self._kept.scenario, samples))

    def set_limits(self, limits: tuple[Limit, ...]) -> bool:
        """Move the lines of the limits, as many as before; returns whether any has moved."""
        before, self._limits = self._limits, limits
        return limits != before

    def append(self, scenario: Scenario, samples: Samples) -> None:
        """Add samples; those already known are skipped."""
        self._curve.append(samples.time, self._plot.values(scenario, samples))

    def hide(self) -> None:
        """Take the chart off the screen; `remove` it once pages have drawn what was sent to it."""
        self._handle.visible = self._note.visible = False

    def remove(self) -> None:
        """Remove the hidden chart."""
        self._handle.remove()
        self._note.remove()

    def forget_range(self) -> None:
        """Let the next picture choose the vertical range anew: nobody has seen the present one."""
        self._span = Span(self._plot.least)

    def show(self, seen: Sequence[float] = WHOLE) -> None:
        """Send the present data; `seen`: the part of the window that is zoomed into, as fractions of it."""
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
        levels = [np.full(len(drawn), sign * limit.value) for limit in self._limits for sign in (1, -1)]
        ends = np.full(len(drawn), high)
        ends[::2] = low
        return compact((start + drawn) * TICK, [*lines, *levels, ends], TICK)
