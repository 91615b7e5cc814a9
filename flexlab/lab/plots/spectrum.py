"""The amplitude spectrum of the beam's vibration, with the beam's own frequencies marked."""

import math

import numpy as np
import viser
from viser import uplot

from flexlab.lab import colors
from flexlab.lab.plots.chart import HEIGHT, X_AXIS_SIZE, axis, compact, signal_series
from flexlab.lab.ranges import Range
from flexlab.lab.viser_internals import send_plot_data, widget_uuid
from flexlab.scenario import Scenario
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.build import build_beam
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK

MICRO = 1e6
"""m to µm."""
POINTS = 300
"""Frequencies drawn; each stands for the highest amplitude of its stretch, so that no line of the spectrum is lost."""
SHOWN_MODES = 3
"""The axis reaches just past this mode, if sampling lets it."""
LOWEST_TOP = 10.0
"""The logarithmic axis reaches up to this at least, µm: its lower end, written with three decimals, is then no 0."""
DECADES = 4
"""Of the axis, below the greatest amplitude."""
SHORTEST = 64
"""Samples below which a spectrum says nothing."""
PATIENCE = 6
"""Spectra in a row that must find the axis too high before it comes down (3 s)."""
Y_AXIS_SIZE = 62


def amplitude_spectrum(signal: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and amplitudes, in the signal's unit, of a Hann-windowed signal; a sine shows its own amplitude."""
    window = np.hanning(len(signal))
    amplitude = np.abs(np.fft.rfft(signal * window)) * 2 / window.sum()
    return np.fft.rfftfreq(len(signal), period), amplitude


def thinned(frequency: np.ndarray, amplitude: np.ndarray, highest: float) -> tuple[np.ndarray, np.ndarray]:
    """`POINTS` even frequencies up to `highest` with the greatest amplitude around each, NaN where there is none."""
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
    """A chart of amplitude over frequency, in the GUI container that is open while it is made."""

    def __init__(self, gui: viser.GuiApi, scenario: Scenario):
        self._scenario: Scenario | None = None
        self._marks = np.zeros(0)
        self._top = Range(LOWEST_TOP, PATIENCE)
        self._mark_modes(scenario)
        series = (
            uplot.Series(label="f (Hz)"),
            signal_series("vibration (µm)", colors.VIOLET) | {"spanGaps": True},
            uplot.Series(label="modes of the beam", stroke=colors.css(colors.GRAY), width=1.5, dash=(4, 4)),
        )
        self._handle = gui.add_uplot(
            self._data(None),
            series,
            title="Spectrum of the mid-span vibration",
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(distr=3, log=10)},
            axes=(axis(X_AXIS_SIZE), axis(Y_AXIS_SIZE)),
            legend=uplot.Legend(live=True),
            height=2 * HEIGHT,
            padding=(6, 12, 0, 0),
        )

    @property
    def uuid(self) -> str:
        """How the page calls it."""
        return widget_uuid(self._handle)

    def clear(self) -> None:
        """Show nothing: another run has begun."""
        send_plot_data(self._handle, self._data(None))

    def update(self, scenario: Scenario, samples: Samples) -> None:
        """Show the spectrum of `samples`."""
        self._mark_modes(scenario)
        send_plot_data(self._handle, self._data(samples))

    def _mark_modes(self, scenario: Scenario) -> None:
        if self._scenario is not None and self._scenario.payload == scenario.payload:
            return
        self._scenario = scenario
        with one_blas_thread():
            omega = build_beam(scenario.payload).modes.omega
        self._marks = np.sort(omega)[:SHOWN_MODES] / (2 * np.pi)
        highest = 1.15 * self._marks[-1] if len(self._marks) else np.inf
        self._highest = float(min(highest, 0.5 / TICK))
        self._marks = self._marks[self._marks < self._highest]

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
        # Every mark is a vertical stroke: two points at its frequency and a gap after them.
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
