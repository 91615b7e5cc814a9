"""The trade-off among what a tuning tried."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from flexlab.analysis.figures import BLUE, GRAY, RESOLUTION, STYLE, VERMILION
from flexlab.analysis.sweep.figures import SIZE, metric_column, pareto_front
from flexlab.analysis.tuning.cost import numbers_of
from flexlab.analysis.tuning.search import Tuning
from flexlab.errors import StudyError
from flexlab.recording.store.notes import replacing


def draw_trade_off(tuning: Tuning, first: str, second: str) -> Figure:
    """Two metrics of every candidate: what less of one costs in the other, where the scenario stood, what was chosen."""
    one, other = metric_column(first), metric_column(second)
    ran = [candidate for candidate in tuning.candidates if candidate.metrics is not None]
    numbers = [numbers_of(candidate.metrics) for candidate in ran if candidate.metrics is not None]
    x = np.array([values[one.field] for values in numbers])
    y = np.array([values[other.field] for values in numbers])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout="constrained")
        axes = figure.add_subplot()
        axes.plot(x, y, "o", color=GRAY, markersize=3, alpha=0.6, label="tried")
        best = pareto_front(x, y)
        axes.step(x[best], y[best], "-", where="post", color=GRAY, linewidth=1)
        for candidate, color, words in ((tuning.before, VERMILION, "before"), (tuning.best, BLUE, "chosen")):
            if candidate.metrics is not None:
                values = numbers_of(candidate.metrics)
                axes.plot(values[one.field], values[other.field], "o", color=color, markersize=8, label=words)
        axes.set_xlabel(f"{one.title} ({one.unit})")
        axes.set_ylabel(f"{other.title} ({other.unit})")
        for name, draw in ((one.field, axes.axvline), (other.field, axes.axhline)):
            if name in tuning.cost.limits:
                draw(tuning.cost.limits[name], color=VERMILION, linestyle=":", linewidth=1)
        axes.legend(frameon=False)
    return figure


def write_trade_off(tuning: Tuning, path: Path, first: str, second: str) -> None:
    """Write the figure (.svg or .png). Raises `StudyError`."""
    kind = path.suffix.lstrip(".").lower()
    if kind not in ("svg", "png"):
        raise StudyError(f"{path} is no name for a figure: let it end in .svg or .png.")
    try:
        with replacing(path) as draft, mpl.rc_context(STYLE):
            metadata = {"Date": None} if kind == "svg" else None
            draw_trade_off(tuning, first, second).savefig(draft, dpi=RESOLUTION, format=kind, metadata=metadata)
    except OSError as error:
        raise StudyError(f"{path} cannot be written ({error.strerror}): choose another file.") from None
