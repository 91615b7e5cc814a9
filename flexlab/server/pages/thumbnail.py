"""A small drawing of a scenario: arms, beam and path, for presets without a picture."""

import numpy as np
from markupsafe import Markup

from flexlab.control.motion import poses
from flexlab.errors import FlexlabError
from flexlab.scenario import Scenario
from flexlab.server.pages.templating import render
from flexlab.sim.geometry import arm_points, beam_points
from flexlab.sim.target import build_trajectory
from flexlab.sim.world import World

PATH_POINTS, BEAM_POINTS = 96, 24
PATH_TIME = 4.0
"""s: two periods of the slowest preset."""
MARGIN = 0.12
"""Share of the drawing's width around what is drawn."""
ASPECT = 16 / 10


def thumbnail(scenario: Scenario) -> Markup:
    """The arrangement at the start, as SVG; empty for a scenario that cannot start."""
    try:
        world = World(scenario)
        start = world.observe()
    except FlexlabError:
        return Markup("")
    arms, beam = arm_points(scenario, start)[0], beam_points(scenario, start, BEAM_POINTS)[0]
    path = poses(build_trajectory(scenario), np.linspace(0.0, PATH_TIME, PATH_POINTS))[:, 0, :2]
    everything = np.concatenate([arms.reshape(-1, 2), beam, path])
    if not np.isfinite(everything).all():
        return Markup("")
    return render(
        "drawing.svg",
        box=_box(everything),
        path=_points(path),
        arms=[{"points": _points(arm), "x": f"{arm[0, 0]:.3f}", "y": f"{-arm[0, 1]:.3f}"} for arm in arms],
        beam=_points(beam),
    )


def _box(points: np.ndarray) -> str:
    """The part of the plane to show, y downwards as in SVG."""
    low, high = points.min(axis=0), points.max(axis=0)
    center, size = (low + high) / 2, (high - low) * (1 + 2 * MARGIN)
    width = max(size[0], size[1] * ASPECT)
    return f"{center[0] - width / 2:.3f} {-center[1] - width / ASPECT / 2:.3f} {width:.3f} {width / ASPECT:.3f}"


def _points(points: np.ndarray) -> str:
    return " ".join(f"{x:.3f},{-y:.3f}" for x, y in points)
