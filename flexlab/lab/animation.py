"""A run as a moving 3D picture in one HTML page, which opens from disk without network: viser's own page and serializer."""

import numpy as np

from flexlab.errors import StudyError
from flexlab.lab.input_guard import InputGuard
from flexlab.lab.scene.arm_meshes import Arms
from flexlab.lab.scene.beam_mesh import Beam
from flexlab.lab.scene.camera_views import FIELD_OF_VIEW, Window, overview
from flexlab.lab.scene.forces import Forces
from flexlab.lab.scene.overlays import Overlays
from flexlab.lab.scene.stage import Stage, set_light
from flexlab.lab.view_settings import ViewSettings, fitting_exaggeration
from flexlab.lab.viser_server import open_server
from flexlab.sim.samples import Run

FRAMES_PER_SECOND = 30
"""Of the recorded picture: smooth to the eye, and ten seconds of it still a small file."""
WINDOW = Window(2.0)
"""The picture's shape: twice as wide as high."""
MOST_FRAMES = 3000
"""Beyond this a file grows too large to send; longer runs get fewer frames a second."""


def frame_times(run: Run, frames_per_second: float = FRAMES_PER_SECOND) -> np.ndarray:
    """Instants of a run that are drawn, s; at most `MOST_FRAMES`."""
    start, end = float(run.time[0]), float(run.time[-1])
    count = min(int((end - start) * frames_per_second) + 1, MOST_FRAMES)
    return start + np.linspace(0, end - start, count) if count > 1 else np.array([start])


def animation_html(run: Run, dark: bool = False) -> str:
    """The page: arms, beam, forces and paths, with a bar to play and scrub. Raises `StudyError` for a run without samples."""
    if len(run) == 0:
        raise StudyError("The run has no samples: there is nothing to draw.")
    scenario, times = run.scenario, frame_times(run)
    view = ViewSettings(exaggeration=fitting_exaggeration(scenario))
    caption = f"beam deflection drawn × {view.exaggeration:g}"
    server = open_server("127.0.0.1", 0, "flexlab", InputGuard())
    try:
        scene = server.scene
        set_light(scene, shadows=False)
        shot = overview(scenario, WINDOW)
        server.initial_camera.fov = FIELD_OF_VIEW
        server.initial_camera.look_at, server.initial_camera.position = shot.look_at, shot.position
        _ = Stage(scene, scenario)
        arms, beam = Arms(scene, scenario), Beam(scene, scenario)
        overlays, forces = Overlays(scene, scenario), Forces(scene, scenario)
        rows = np.searchsorted(run.time, times - 1e-9).clip(0, len(run) - 1)

        def draw(row: int) -> None:
            sample = run.slice(row, row + 1)
            arms.update(scenario, sample)
            beam.update(scenario, sample, view)
            overlays.update(scenario, sample, view, caption)
            forces.update(scenario, sample, view)

        draw(int(rows[0]))
        serializer = server.get_scene_serializer()
        for row, pause in zip(rows[1:], np.diff(times), strict=True):
            serializer.insert_sleep(float(pause))
            draw(int(row))
        return serializer.as_html(dark_mode=dark)
    finally:
        server.stop()
