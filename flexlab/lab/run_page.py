"""A run in one HTML file: moving picture, plots in step with it, metrics and scenario; opens from disk without network."""

import contextlib
import io
import os
from pathlib import Path

import matplotlib as mpl
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from flexlab.analysis.figures import STYLE
from flexlab.analysis.metrics import run_metrics
from flexlab.analysis.result_hash import result_hash
from flexlab.analysis.signal_plots import SHOWN, draw_signals
from flexlab.errors import StudyError
from flexlab.lab.animation import animation_html
from flexlab.lab.view_settings import fitting_exaggeration
from flexlab.presets import scenario_text
from flexlab.sim.samples import MEASURED, Run


def run_page(run: Run, name: str, version: str) -> str:
    """The page. Raises `StudyError` for a run without samples, or without motion."""
    if run.status == MEASURED:
        raise StudyError("This run was measured, which tells no motion to show: export it as a table, or compare it.")
    animation = animation_html(run)
    plots, left, right = _plots(run)
    pages = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return pages.get_template("run_page.html").render(
        name=name,
        title=run.scenario.title or name,
        status=run.status.text,
        exaggeration=fitting_exaggeration(run.scenario),
        animation=animation,
        plots=Markup(plots),
        left=left,
        right=right,
        start=float(run.time[0]),
        end=float(run.time[-1]),
        metrics=Markup(run_metrics(run, finished=not run.status.failed)._repr_html_()),
        result=result_hash(run),
        version=version,
        scenario=scenario_text(run.scenario),
    )


def write_run_page(run: Run, path: Path, name: str, version: str) -> None:
    """Write the page as one file, whole or not at all. Raises `StudyError`."""
    text = run_page(run, name, version)
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    except OSError as error:
        raise StudyError(f"{path} cannot be written ({error.strerror}): choose another file.") from None
    finally:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)


def _plots(run: Run) -> tuple[str, float, float]:
    """SVG of the usual signals, and where in its width the time axis begins and ends, per cent."""
    with mpl.rc_context(STYLE):
        figure = draw_signals(run, SHOWN)
        figure.draw_without_rendering()
        place = figure.axes[0].get_position()
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    svg = drawn.getvalue()
    return svg[svg.index("<svg") :], 100 * place.x0, 100 * place.x1
