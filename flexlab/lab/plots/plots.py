"""Plots of the running simulation, on tabs: signals over time, and the spectrum with the beam's own frequencies marked.

Beside them, a few sentences explain the run; they are found once a second and do not flicker.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import cast

import numpy as np
import viser
from viser import uplot

from flexlab.analysis.explanations.explanation import EXPLANATIONS, LONGEST_LOOK, Evidence, Explained, explain
from flexlab.analysis.lesson_measures import amplitude_spectrum
from flexlab.lab.mode_computation import ModeStudy
from flexlab.lab.plots import Plot, tabs
from flexlab.lab.plots.chart import HEIGHT, X_AXIS_SIZE, Chart, axis, compact, signal_series
from flexlab.lab.ranges import Range
from flexlab.lab.reference_run import ReferenceRun
from flexlab.lab.view_settings import ViewSettings
from flexlab.lab.viser_internals import send_plot_data, widget_uuid
from flexlab.lab.widgets import LAST, put
from flexlab.lapack import one_blas_thread
from flexlab.scenario import Payload, Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK, Snapshot
from flexlab.text import escaped, with_units
from flexlab.views import GRAY, VIOLET, css

MICRO = 1e6
"""m to µm."""
POINTS = 300
"""Number of drawn frequencies; each shows the largest amplitude of its stretch, so that no line of the spectrum is lost."""
SHOWN_MODES = 3
"""The axis reaches just past this mode, if sampling lets it."""
LOWEST_TOP = 10.0
"""Least upper end of the logarithmic axis, µm: its lower end, written with three decimals, is then not 0."""
DECADES = 4
"""Decades of the axis below the largest amplitude."""
SHORTEST = 64
"""Least number of samples for a spectrum."""
PATIENCE = 6
"""Consecutive spectra that must find the axis too high before it shrinks (3 s)."""
Y_AXIS_SIZE = 62
MOST = 3
"""Most sentences at once."""
SEEN, MISSED = 2, 2
"""Consecutive checks after which a sentence appears, and after which it disappears."""
REWORDED = 5
"""Checks for which a sentence keeps its numbers."""
Recent = Callable[[float], Samples]
"""Returns the samples of the last part of the run, of a length in s, at full rate."""
OVERLAP = 0.05
"""Extra time requested at each update, s: covers the samples that usually arrive between snapshot and request."""
HIDING_TIME = 2.0
"""Time for which a chart is hidden before it is removed, wall s: a page that draws seldom has data for it until then."""
SPECTRUM_EVERY = 5  # updates of the other charts: 2 Hz.


def thinned(frequency: np.ndarray, amplitude: np.ndarray, highest: float) -> tuple[np.ndarray, np.ndarray]:
    """`POINTS` evenly spaced frequencies up to `highest` and the largest amplitude around each; NaN if there is none."""
    edges = np.linspace(0, highest, POINTS + 1)
    grid = 0.5 * (edges[:-1] + edges[1:])
    index = np.searchsorted(edges, frequency, side="right") - 1
    inside = (index >= 0) & (index < POINTS)
    peaks = np.full(POINTS, -np.inf)
    np.maximum.at(peaks, index[inside], amplitude[inside])
    found = np.isfinite(peaks)
    if not found.any():
        return grid, np.full(POINTS, np.nan)
    return grid, np.interp(grid, grid[found], peaks[found])


class Spectrum:
    """A chart of amplitude over frequency, made in the open GUI container."""

    def __init__(self, gui: viser.GuiApi, scenario: Scenario):
        self._payload: Payload | None = None
        self._top = Range(LOWEST_TOP, PATIENCE)
        self._mark_modes(scenario.payload)
        series = (
            uplot.Series(label="f (Hz)"),
            signal_series("vibration (µm)", VIOLET) | {"spanGaps": True},
            _series_of_modes(scenario),
        )
        self._handle = gui.add_uplot(
            self._data(None),
            series,
            title="Spectrum of the mid-span vibration",
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(distr=3, log=10)},
            axes=(axis(X_AXIS_SIZE), axis(Y_AXIS_SIZE, "µm")),
            legend=uplot.Legend(live=True),
            height=HEIGHT,
            padding=(6, 12, 0, 0),
        )
        self.uuid = widget_uuid(self._handle)

    def clear(self) -> None:
        """Clear the chart for a new run."""
        send_plot_data(self._handle, self._data(None))

    def update(self, snapshot: Snapshot, samples: Samples) -> None:
        """Show the spectrum of `samples`, with the modes of the snapshot's beam at its present mass."""
        self._mark_modes(snapshot.scenario.payload, snapshot.first_frequency)
        modes = _series_of_modes(snapshot.scenario)
        if self._handle.series[-1] != modes:
            self._handle.series = (*self._handle.series[:-1], modes)
        send_plot_data(self._handle, self._data(samples))

    def _mark_modes(self, payload: Payload, first: float | None = None) -> None:
        """Mark the payload's modes; `first`: the first one's frequency at the present mass, Hz, which lowers all alike."""
        if payload != self._payload:
            self._payload = payload
            with one_blas_thread():
                omega = build_beam(payload).modes.omega
            self._modes = np.sort(omega)[:SHOWN_MODES] / (2 * np.pi)
        factor = 1.0 if first is None else first / self._modes[0]
        highest = 1.15 * max(1.0, factor) * self._modes[-1]
        self._highest = float(min(highest, 0.5 / TICK))
        self._marks = factor * self._modes[factor * self._modes < self._highest]

    def _data(self, samples: Samples | None) -> tuple[np.ndarray, ...]:
        grid, line = np.linspace(0, self._highest, POINTS), np.full(POINTS, np.nan)
        if samples is not None and len(samples) >= SHORTEST:
            frequency, amplitude = amplitude_spectrum(MICRO * samples.vibration, TICK)
            seen = amplitude[frequency <= self._highest]
            self._top.fit(float(seen.max()) if len(seen) else 0.0)
            grid, line = thinned(frequency, amplitude, self._highest)
        top = 10.0 ** math.ceil(math.log10(self._top.limit) - 1e-9)
        bottom = top / 10**DECADES
        line = np.where(np.isnan(line), np.nan, np.clip(line, bottom, top))
        # Every mark is a vertical line: two points at its frequency and a gap after them.
        marks = np.repeat(self._marks, 3)
        strokes = np.tile([bottom, top, np.nan], len(self._marks))
        order = np.argsort(np.concatenate([grid, marks]), kind="stable")
        blank, count = np.full(len(marks), np.nan), len(grid)
        columns = (
            np.concatenate([grid, marks]),
            np.concatenate([line, np.interp(marks, grid, line) if len(marks) else blank]),
            np.concatenate([np.full(count, np.nan), strokes]),
        )
        frequency, *lines = (column[order] for column in columns)
        return compact(frequency, lines, self._highest / POINTS)


def _series_of_modes(scenario: Scenario) -> uplot.Series:
    """How the marks of the modes are drawn: the peaks of a beam that is pressed or spun lie beside them."""
    label = "modes of the beam" if scenario.payload.axial_load == "none" else "modes without axial force"
    # Without dashes: the chart draws each mark twice, up and down, and the dashes of one way fill the gaps of the other.
    return cast(uplot.Series, {"label": label, "class": "fl-mark", "stroke": css(GRAY), "width": 1.5})


class Plots:
    """All charts of one server, on tabs of one panel. `update` may be called from one thread only."""

    def __init__(self, gui: viser.GuiApi, panel: viser.PanelHandle, scenario: Scenario, window: float):
        self._gui, self._window = gui, window
        self._run_number = -1
        self._count = 0
        self._opened: Mapping[str, tuple[float, float]] | None = None
        self._homes = {name: panel.add_tab(name) for name in tabs(scenario)}
        spectrum = panel.add_tab("Spectrum")
        with spectrum:
            self._spectrum = Spectrum(gui, scenario)
        self.homes = (*self._homes.values(), spectrum)
        self._charts: list[Chart] = []
        self._hidden, self._hidden_until = list[Chart](), 0.0
        self._plotted: object = None
        self._build(tabs(scenario), None)

    def update(
        self,
        recent: Recent,
        snapshot: Snapshot,
        view: ViewSettings,
        kept: ReferenceRun | None,
        opened: Mapping[str, tuple[float, float]] | None,
    ) -> None:
        """Add the samples since the last update and redraw, with `kept` behind the present run.

        `snapshot`: what the screen shows, the present or an earlier instant, up to which `recent` returns samples.
        `opened`: the charts on anybody's screen, with the visible part of the window; None if unknown, perhaps all.
        """
        if self._hidden and time.monotonic() > self._hidden_until:
            for chart in self._hidden:
                chart.remove()
            self._hidden = []
        if view.hold_plots:
            return
        scenario, window = snapshot.scenario, view.plot_window
        plots = tabs(scenario)
        if _plotted(plots, kept) != self._plotted:
            self._build(plots, kept)
        moved = [chart.set_limits(plot.limits) for chart, plot in zip(self._charts, _all(plots), strict=True)]
        newest = self._charts[0].newest
        now = round(float(snapshot.latest.time[0]) / TICK)
        if snapshot.run_number != self._run_number or window != self._window or now < newest:
            for chart in self._charts:
                chart.restart(window)
            self._spectrum.clear()
            self._run_number, self._window, newest = snapshot.run_number, window, -1
        missing = (now - newest) * TICK if newest >= 0 else window
        if missing > 0:
            samples = unbroken(recent, newest, missing, window)
            if samples.joint_torque.shape[1] != len(scenario.arms):
                return  # A run with another number of arms has begun since the snapshot: the next picture shows it.
            for chart in self._charts:
                chart.append(scenario, samples)
        if missing > 0 or any(moved) or opened != self._opened:
            before, self._opened = self._opened, opened
            self._show(recent, snapshot, window, before)

    def _spectrum_is_open(self, opened: Mapping[str, tuple[float, float]] | None) -> bool:
        return opened is None or self._spectrum.uuid in opened

    def _show(
        self, recent: Recent, snapshot: Snapshot, window: float, before: Mapping[str, tuple[float, float]] | None
    ) -> None:
        """Send only the charts that are on a screen: hidden ones would be most of the page's traffic.

        `before`: the charts that were on a screen at the last update.
        """
        self._count += 1
        for chart in self._charts:
            if self._opened is None:
                chart.show()
            elif chart.uuid in self._opened:
                if before is not None and chart.uuid not in before:
                    chart.forget_range()
                chart.show(self._opened[chart.uuid])
        just_opened = self._spectrum_is_open(self._opened) and not self._spectrum_is_open(before)
        if just_opened or (self._count % SPECTRUM_EVERY == 0 and self._spectrum_is_open(self._opened)):
            self._spectrum.update(snapshot, recent(window))

    def _build(self, plots: Mapping[str, Sequence[Plot]], kept: ReferenceRun | None) -> None:
        for chart in self._charts:
            chart.hide()
        self._hidden_until = time.monotonic() + HIDING_TIME
        self._hidden, self._charts = self._hidden + self._charts, []
        for name, on_tab in plots.items():
            with self._homes[name]:
                self._charts += [Chart(self._gui, plot, self._window, kept, name) for plot in on_tab]
        self._plotted = _plotted(plots, kept)


def unbroken(recent: Recent, newest: int, missing: float, window: float) -> Samples:
    """The samples after tick `newest`, about `missing` s of them, but no more than `window` s."""
    asked = missing + OVERLAP
    while True:
        samples = recent(min(asked, window))
        first = round(float(samples.time[0]) / TICK) if len(samples) else newest
        if newest < 0 or first <= newest + 1 or asked >= window:
            return samples
        # On a busy machine the engine may have run for longer than the overlap.
        asked *= 2


def _all(plots: Mapping[str, Sequence[Plot]]) -> list[Plot]:
    """The plots of all tabs."""
    return [plot for on_tab in plots.values() for plot in on_tab]


def _plotted(plots: Mapping[str, Sequence[Plot]], kept: ReferenceRun | None) -> list:
    """The key for which the charts are built: titles, names of limit lines, which may move, and the kept run."""
    return [id(kept), *((plot.title, [(limit.label, limit.tone) for limit in plot.limits]) for plot in _all(plots))]


class CalmList:
    """The shown sentences: one appears after it was found twice in a row, and disappears after it was missing twice."""

    def __init__(self) -> None:
        self._shown: dict[str, tuple[Explained, int, int]] = {}
        self._seen: dict[str, int] = {}

    def clear(self) -> None:
        """Forget everything for a new run."""
        self._shown, self._seen = {}, {}

    def look(self, found: Sequence[Explained]) -> list[Explained]:
        """The sentences to show after a check found the sentences `found`, the most important first."""
        now = {each.name: each for each in found}
        self._seen = {name: self._seen.get(name, 0) + 1 for name in now}
        for name in list(self._shown):
            text, missed, age = self._shown[name]
            if name in now:
                fresh = age + 1 >= REWORDED
                self._shown[name] = (now[name] if fresh else text, 0, 0 if fresh else age + 1)
            elif missed + 1 >= MISSED:
                del self._shown[name]
            else:
                self._shown[name] = (text, missed + 1, age)
        for name, each in now.items():
            if name not in self._shown and self._seen[name] >= SEEN:
                self._shown[name] = (each, 0, 0)
        return [self._shown[name][0] for name in EXPLANATIONS if name in self._shown][:MOST]


NONE_YET = '<div class="fl-why fl-dim">Explanations of the run appear here.</div>'
"""It keeps the plots beside it from growing with each new run, and shrinking a second later."""


class ExplanationList:
    """The sentences, the same on every tab of the plots."""

    def __init__(self, gui: viser.GuiApi, runner: Runner, study: ModeStudy, tabs: Sequence[viser.GuiTabHandle]):
        self._runner, self._study = runner, study
        self._calm = CalmList()
        self.sentences: Sequence[Explained] = ()
        self._run_number, self._time = -1, -1.0
        self._places = []
        for tab in tabs:
            with tab:
                self._places.append(gui.add_html(list_html(()), order=LAST))

    def update(self, snapshot: Snapshot) -> None:
        """Check again while the run plays; call once a second."""
        if snapshot.run_number != self._run_number:
            self._run_number = snapshot.run_number
            self._calm.clear()
            self._show([])
        now = float(snapshot.latest.time[0])
        if now != self._time:
            self._time = now
            self._show(self._calm.look(self._found(snapshot)))

    def _found(self, snapshot: Snapshot) -> Sequence[Explained]:
        background = self._study.background(snapshot.scenario)
        if background is None:
            return ()
        recent = self._runner.recent(LONGEST_LOOK)
        return explain(Evidence.of_run(recent, background, snapshot.start_time, snapshot.events))

    def _show(self, sentences: Sequence[Explained]) -> None:
        self.sentences = sentences
        for place in self._places:
            put(place, content=list_html(sentences))


def list_html(sentences: Sequence[Explained]) -> str:
    """Each sentence with the plot that shows it and its equation, as HTML; without any, the place that they will have."""
    items = "".join(
        f'<div class="fl-why"><b>{escaped(each.plot)}.</b> {escaped(with_units(each.sentence))} '
        f'<span class="fl-dim">{escaped(each.equation)}</span></div>'
        for each in sentences
    )
    return f'<div class="fl"><h2 class="fl-title">What the plots show</h2>{items or NONE_YET}</div>'
