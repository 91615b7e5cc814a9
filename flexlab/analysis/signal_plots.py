"""Curves of any signals of a run, a plot each, with symbol and unit."""

from collections.abc import Sequence
from itertools import product

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexlab.analysis.figures import ROW_HEIGHT, STYLE, WIDTH, thin_out
from flexlab.errors import StudyError
from flexlab.signal import COORDINATE, Signal
from flexlab.sim.samples import Samples
from flexlab.sim.signals import DERIVED, known_signals

SHOWN = ("tracking_error", "midspan_deflection", "vibration", "internal_force")
"""What is drawn unless something else is asked for."""
MOST_CURVES = 12
"""Of one plot with a legend."""


def draw_signals(samples: Samples, names: Sequence[str] = SHOWN) -> Figure:
    """A plot for each named signal over time; a signal whose entries have different units gets one for each unit.

    Raises `StudyError` for a name that is no signal, or no samples.
    """
    known = {**known_signals(), **DERIVED}
    for name in names:
        if name not in known or (name in samples.absent and name not in DERIVED):
            there = [name for name in known if name in DERIVED or name in samples.signals()]
            raise StudyError(f"{name!r:.60} is no signal of this run: choose from {', '.join(there)}.")
    if len(samples) == 0 or not names:
        raise StudyError("There is nothing to draw: the run has no samples, or no signal was named.")
    plots = [(known[name], unit) for name in names for unit in dict.fromkeys(known[name].units)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, max(2, len(plots)) * ROW_HEIGHT), layout="constrained")
        parts = figure.subplots(len(plots), 1, sharex=True, squeeze=False)[:, 0]
        for part, (signal, unit) in zip(parts, plots, strict=True):
            _draw(part, samples, signal, unit)
        parts[-1].set_xlabel("t (s)")
        parts[-1].set_xlim(samples.time[0], max(samples.time[-1], samples.time[0] + 1e-9))
        figure.align_ylabels()
    return figure


def _draw(part: Axes, samples: Samples, signal: Signal, unit: str) -> None:
    values = np.asarray(samples[signal.name])
    curves = 0
    for index in product(*map(range, values.shape[1:])):
        if signal.units[(index[-1] if index else 0) % len(signal.units)] != unit:
            continue
        labels = [
            f"{axis.labels[place % 2]} {place}" if axis == COORDINATE else axis.labels[place]
            for axis, place in zip(signal.axes, index, strict=True)
        ]
        part.plot(*thin_out(samples.time, values[(slice(None), *index)]), label=" ".join(labels))
        curves += 1
    part.set_ylabel(f"{signal.symbol} ({unit})" if unit != "1" else signal.symbol)
    part.set_title(signal.name.replace("_", " "), fontsize="medium", loc="left")
    if 1 < curves <= MOST_CURVES:
        part.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")
