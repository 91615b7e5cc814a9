"""Plots while the simulation runs, on tabs, fed from the runner's recent samples."""

import viser

from flexlab.lab.plots.chart import Chart
from flexlab.lab.plots.plot_signals import tabs
from flexlab.lab.plots.spectrum import Spectrum
from flexlab.lab.reference_run import ReferenceRun
from flexlab.lab.view_settings import ViewSettings
from flexlab.scenario import Scenario
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK, Snapshot

OVERLAP = 0.05
"""Extra samples asked for at each update, s: covers what usually arrives between the snapshot and the request."""
BACKGROUND_EVERY = 2
"""Updates of the first tab per update of the others (5 Hz): most of the page's traffic is plots that nobody looks at."""
SPECTRUM_EVERY = 5
"""Updates of the first tab per spectrum (2 Hz)."""


class Plots:
    """All charts of one server, on tabs of one panel. `update` may be called from one thread only."""

    def __init__(self, gui: viser.GuiApi, panel: viser.PanelHandle, scenario: Scenario, window: float):
        self._gui, self._window = gui, window
        self._run_number = -1
        self._count = 0
        self._homes = {name: panel.add_tab(name) for name in tabs(scenario)}
        with panel.add_tab("Spectrum"):
            self._spectrum = Spectrum(gui, scenario)
        self._charts: list[list[Chart]] = []
        self._plotted: object = None
        self._build(scenario, None)

    def update(self, runner: Runner, snapshot: Snapshot, view: ViewSettings, kept: ReferenceRun | None) -> None:
        """Take in what the runner computed since the last update and redraw, `kept` behind the present run."""
        if view.hold_plots:
            return
        scenario, window = snapshot.scenario, view.plot_window
        if _plotted(scenario, kept) != self._plotted:
            self._build(scenario, kept)
        newest = self._charts[0][0].newest
        now = round(float(snapshot.latest.time[0]) / TICK)
        if snapshot.run_number != self._run_number or window != self._window or now < newest:
            for chart in self._every():
                chart.restart(window)
            self._run_number, self._window, newest = snapshot.run_number, window, -1
        missing = (now - newest) * TICK if newest >= 0 else window
        if missing <= 0:
            return
        samples = unbroken(runner, newest, missing, window)
        for chart in self._every():
            chart.append(scenario, samples)
        self._show(runner, scenario, window)

    def _show(self, runner: Runner, scenario: Scenario, window: float) -> None:
        self._count += 1
        for chart in self._charts[0]:
            chart.show()
        if self._count % BACKGROUND_EVERY == 0:
            for charts in self._charts[1:]:
                for chart in charts:
                    chart.show()
        if self._count % SPECTRUM_EVERY == 0:
            self._spectrum.update(scenario, runner.recent(window))

    def _every(self) -> list[Chart]:
        return [chart for charts in self._charts for chart in charts]

    def _build(self, scenario: Scenario, kept: ReferenceRun | None) -> None:
        for chart in self._every():
            chart.remove()
        self._charts = []
        for name, plots in tabs(scenario).items():
            with self._homes[name]:
                self._charts.append([Chart(self._gui, plot, scenario, self._window, kept) for plot in plots])
        self._plotted = _plotted(scenario, kept)


def unbroken(runner: Runner, newest: int, missing: float, window: float) -> Samples:
    """What the engine computed after tick `newest`, about `missing` s of it, but no more than `window` s."""
    asked = missing + OVERLAP
    while True:
        samples = runner.recent(min(asked, window))
        first = round(float(samples.time[0]) / TICK) if len(samples) else newest
        if newest < 0 or first <= newest + 1 or asked >= window:
            return samples
        # On a busy machine the engine may have gone on for longer than the overlap.
        asked *= 2


def _plotted(scenario: Scenario, kept: ReferenceRun | None) -> list:
    """What the charts were built for: titles, limit lines, and the kept run."""
    keys = [(plot.title, plot.limits(scenario)) for plots in tabs(scenario).values() for plot in plots]
    return [*keys, id(kept)]
