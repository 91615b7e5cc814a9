"""A run in one HTML file: animation, synchronised plots, metrics and scenario; it opens from disk without a network."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markupsafe import Markup, escape

from flexlab import __version__
from flexlab.analysis.explanations.explanation import explain_run
from flexlab.analysis.figures import draw_signals, page_svg
from flexlab.analysis.metrics import run_metrics
from flexlab.analysis.result import result_hash
from flexlab.errors import StudyError
from flexlab.files import filled
from flexlab.guide import LessonProgress
from flexlab.lab.scene.arms import Arms
from flexlab.lab.scene.beam import Beam
from flexlab.lab.scene.cameras import FIELD_OF_VIEW, Window, draw_stage, floor_extent, overview
from flexlab.lab.scene.forces import Forces
from flexlab.lab.scene.overlays import Overlays
from flexlab.lab.view_settings import ViewSettings
from flexlab.lab.viser_internals import in_the_systems_colors
from flexlab.lab.viser_server import InputGuard, open_server
from flexlab.presets import scenario_text
from flexlab.sim.samples import MEASURED, Run
from flexlab.sim.snapshot import Event
from flexlab.text import number_text, with_subscripts, with_units
from flexlab.views import fitting_exaggeration

FRAMES_PER_SECOND = 30
"""Pictures per second of the recording: smooth to the eye, and ten seconds still make a small file."""
WINDOW = Window(2.0)
"""The picture's shape: twice as wide as high."""
CAPTION_OFFSET = 0.05
"""Distance from the floor's far edge to the caption above the picture, m."""
MOST_FRAMES = 3000
"""Most frames, so that a file stays small enough to send; longer runs get fewer frames a second."""


class Noted(NamedTuple):
    """Notes on a run."""

    heading: str = ""
    """Date, owner and tags."""
    note: str = ""
    lessons: tuple[LessonProgress, ...] = ()
    changes: tuple[str, ...] = ()
    """Differences from the preset, one line each."""


NOTHING = Noted()


def frame_times(run: Run) -> np.ndarray:
    """Instants of a run that are drawn, s; at most `MOST_FRAMES`."""
    start, end = float(run.time[0]), float(run.time[-1])
    count = min(int((end - start) * FRAMES_PER_SECOND) + 1, MOST_FRAMES)
    return start + np.linspace(0, end - start, count) if count > 1 else np.array([start])


@np.errstate(over="ignore", invalid="ignore")  # Imported values may be of any size.
def animation_html(run: Run) -> str:
    """The animation: arms, beam, forces and paths, with a playback bar. Raises `StudyError` for a run without samples."""
    if len(run) == 0:
        raise StudyError("The run has no samples: there is nothing to draw.")
    scenario, times = run.scenario, frame_times(run)
    view = ViewSettings(exaggeration=fitting_exaggeration(scenario))
    server = open_server(0, InputGuard())
    try:
        scene = server.scene
        shot = overview(scenario, WINDOW)
        server.initial_camera.fov = FIELD_OF_VIEW
        server.initial_camera.look_at, server.initial_camera.position = shot.look_at, shot.position
        draw_stage(scene, scenario, shadows=False)
        arms, beam = Arms(scene, scenario), Beam(scene, scenario)
        overlays, forces = Overlays(scene, scenario), Forces(scene, scenario)
        x_min, x_max, _, y_max = floor_extent(scenario)
        place, caption = ((x_min + x_max) / 2, y_max + CAPTION_OFFSET, 0.0), number_text(view.exaggeration)
        scene.add_label("/caption", f"beam deflection drawn × {caption}", position=place, anchor="bottom-center")
        rows = np.searchsorted(run.time, times - 1e-9).clip(0, len(run) - 1)

        def draw(row: int) -> None:
            sample = run.slice(row, row + 1)
            arms.update(scenario, sample)
            beam.update(scenario, sample, view)
            overlays.update(scenario, sample, view)
            forces.update(scenario, sample, view)

        draw(int(rows[0]))
        serializer = server.get_scene_serializer()
        for row, pause in zip(rows[1:], np.diff(times), strict=True):
            serializer.insert_sleep(float(pause))
            draw(int(row))
        return in_the_systems_colors(serializer.as_html())
    finally:
        server.stop()


def run_page(run: Run, name: str, noted: Noted = NOTHING, events: Sequence[Event] = ()) -> str:
    """The page of a run; with its notes, a lab sheet. Raises `StudyError` for a run without samples, or without motion."""
    if run.status == MEASURED:
        raise StudyError("This run was measured, which tells no motion to show: export it as a table, or compare it.")
    animation = animation_html(run)
    figure = draw_signals(run)
    plots = page_svg(figure)  # This also lays out the figure.
    axis = figure.axes[0].get_position()
    return filled(
        Path(__file__).with_name("run_page.html"),
        name=name,
        title=run.scenario.title or name,
        status=run.status.text,
        exaggeration=number_text(fitting_exaggeration(run.scenario)),
        animation=animation,
        plots=Markup(plots),
        left=100 * axis.x0,
        right=100 * axis.x1,
        start=float(run.time[0]),
        end=float(run.time[-1]),
        metrics=Markup(run_metrics(run, finished=not run.status.failed)._repr_html_()),
        result=result_hash(run),
        version=__version__,
        noted=noted,
        why=explain_run(run, run.scenario, events=events),
        scenario=scenario_text(run.scenario),
        subscripts=lambda text: Markup(with_subscripts(str(escape(with_units(text))))),
    )
