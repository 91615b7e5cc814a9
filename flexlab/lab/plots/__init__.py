"""Plots while the simulation runs, fed from the runner's recent samples."""

import viser

from flexlab.lab.plots.chart import Chart
from flexlab.lab.plots.signals import PLOTS
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import TICK, Snapshot

OVERLAP = 0.05
"""Extra samples asked for at each update, s: covers what arrives between the snapshot and the request."""


class Plots:
    """All charts of one server. `update` may be called from one thread only."""

    def __init__(self, gui: viser.GuiApi, window: float):
        self._window = window
        self._run_number = -1
        self._charts = [Chart(gui, plot, window) for plot in PLOTS]

    def update(self, runner: Runner, snapshot: Snapshot, window: float) -> None:
        """Take in what the runner computed since the last update and redraw; `window` in s."""
        newest = self._charts[0].newest
        now = round(float(snapshot.latest.time[0]) / TICK)
        if snapshot.run_number != self._run_number or window != self._window or now < newest:
            for chart in self._charts:
                chart.restart(window)
            self._run_number, self._window, newest = snapshot.run_number, window, -1
        missing = (now - newest) * TICK if newest >= 0 else window
        if missing > 0:
            samples = runner.recent(min(missing + OVERLAP, window))
            for chart in self._charts:
                chart.append(samples)
                chart.show()
