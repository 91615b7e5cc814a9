"""Plots while the simulation runs, on tabs, fed from the runner's recent samples."""

from collections.abc import Mapping

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
SPECTRUM_EVERY = 5
"""Updates of the other charts per spectrum (2 Hz)."""


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
        """The tabs."""
        self._charts: list[list[Chart]] = []
        self._plotted: object = None
        self._build(scenario, None)

    def update(
        self,
        runner: Runner,
        snapshot: Snapshot,
        view: ViewSettings,
        kept: ReferenceRun | None,
        opened: Mapping[str, tuple[float, float]] | None,
    ) -> None:
        """Take in what the runner computed since the last update and redraw, `kept` behind the present run.

        `opened`: the charts that somebody has on the screen, and the part of the window that is seen; None: perhaps all.
        """
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
            self._spectrum.clear()
            self._run_number, self._window, newest = snapshot.run_number, window, -1
        missing = (now - newest) * TICK if newest >= 0 else window
        if missing > 0:
            samples = unbroken(runner, newest, missing, window)
            if samples.joint_torque.shape[1] != len(scenario.arms):
                return  # A run with other arms has begun since the snapshot: the next picture shows it.
            for chart in self._every():
                chart.append(scenario, samples)
        if missing > 0 or opened != self._opened:
            just_opened = self._spectrum_is_open(opened) and not self._spectrum_is_open(self._opened)
            self._opened = opened
            self._show(runner, scenario, window, just_opened)

    def _spectrum_is_open(self, opened: Mapping[str, tuple[float, float]] | None) -> bool:
        return opened is None or self._spectrum.uuid in opened

    def _show(self, runner: Runner, scenario: Scenario, window: float, spectrum: bool) -> None:
        """Send what somebody sees: most of the page's traffic would else be charts that nobody looks at."""
        self._count += 1
        for chart in self._every():
            if self._opened is None:
                chart.show()
            elif chart.uuid in self._opened:
                chart.show(self._opened[chart.uuid])
        if spectrum or (self._count % SPECTRUM_EVERY == 0 and self._spectrum_is_open(self._opened)):
            self._spectrum.update(scenario, runner.recent(window))

    def _every(self) -> list[Chart]:
        return [chart for charts in self._charts for chart in charts]

    def _build(self, scenario: Scenario, kept: ReferenceRun | None) -> None:
        for chart in self._every():
            chart.remove()
        self._charts = []
        for name, plots in tabs(scenario).items():
            with self._homes[name]:
                self._charts.append([Chart(self._gui, plot, scenario, self._window, kept, name) for plot in plots])
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
