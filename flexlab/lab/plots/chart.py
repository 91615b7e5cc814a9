"""One uPlot chart that follows one plot's signals."""

import numpy as np
import viser
from viser import uplot

from flexlab.lab import colors
from flexlab.lab.plots.envelope import Envelope
from flexlab.lab.plots.signals import Plot
from flexlab.lab.ranges import Range
from flexlab.sim.samples import Samples

HEIGHT = 190
"""Of a chart, px; its legend comes on top."""
X_AXIS_SIZE, Y_AXIS_SIZE = 34, 46
"""Room for the numbers at the axes, px: "-0.005" upright, and the legend's first line below."""


# The vertical range is held by an unseen last series at -limit and limit: a changed scale option would make the browser
# build the chart anew and lose its place.
_RANGE_HOLDER = uplot.Series(label="", stroke="rgba(0,0,0,0)", width=0, points=uplot.Series_Points(show=False))
_EXACTLY_THE_DATA = {"min": {"pad": 0, "mode": 0}, "max": {"pad": 0, "mode": 0}}


def _axis(size: int) -> uplot.Axis:
    return uplot.Axis(size=size, gap=2, ticks=uplot.Axis_Ticks(size=4, width=1), grid=uplot.Axis_Grid(width=1))


class Chart:
    """A chart in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, plot: Plot, window: float):
        self._plot = plot
        self._range = Range(plot.least)
        self._envelope = Envelope(len(plot.labels), window)
        time, lines = self._envelope.lines()
        series = [uplot.Series(label="t (s)")]
        for label, tone in zip(plot.labels, plot.tones, strict=True):
            series.append(uplot.Series(label=label, stroke=colors.css(tone), width=1.25, spanGaps=False))
        series.append(_RANGE_HOLDER)
        self._handle = gui.add_uplot(
            (time, *lines, self._range_line(len(time))),
            tuple(series),
            title=plot.title,
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(range=_EXACTLY_THE_DATA)},
            axes=(_axis(X_AXIS_SIZE), _axis(Y_AXIS_SIZE)),
            legend=uplot.Legend(live=True),
            cursor=uplot.Cursor(drag=uplot.Cursor_Drag(x=True, y=False)),
            height=HEIGHT,
            padding=(6, 12, 0, 0),
        )

    @property
    def newest(self) -> int:
        """Tick of the newest sample taken in, -1 if none."""
        return self._envelope.newest

    def restart(self, window: float) -> None:
        """Forget everything and go on with a window of `window` s."""
        self._envelope = Envelope(len(self._plot.labels), window)

    def append(self, samples: Samples) -> None:
        """Take in samples; those already seen are passed over."""
        self._envelope.append(samples.time, self._plot.values(samples))

    def show(self) -> None:
        """Send the chart as it now is."""
        self._range.fit(float(self._envelope.extent().max()))
        time, lines = self._envelope.lines()
        self._handle.data = (time, *lines, self._range_line(len(time)))

    def _range_line(self, count: int) -> np.ndarray:
        line = np.full(count, np.nan)
        line[0], line[-1] = -self._range.limit, self._range.limit
        return line
