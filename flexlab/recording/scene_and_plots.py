"""What rerun's viewer shows of a run: arms and beam as moving shapes in space, and the views and plots around them.

The plane of the arms is z = 0, seen from above.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flexlab.control.motion import poses
from flexlab.control.path import build_motion
from flexlab.recording.rerun_internals.chunks import TIMELINE, Column, line_strips, vectors
from flexlab.scenario import Scenario
from flexlab.sim.geometry import arm_points, beam_points, link_points
from flexlab.sim.samples import Samples
from flexlab.text import number_text
from flexlab.views import BLUE, GRAY, GREEN, ORANGE, PURPLE, REAL_TIME_FACTOR, VERMILION, View, views

FRAMES_PER_SECOND = 60
"""Drawn states per simulated second, or per wall second in slow motion: what a screen can show."""
BEAM_POINTS = 33
"""Points of the drawn beam: smooth to the eighth mode."""
LINK_RADIUS = (0.035, 0.028, 0.02)
"""Radii of the drawn links, from the base link to the last, m."""
BEAM_RADIUS, THIN_RADIUS = 0.009, 0.003
"""Radii of the drawn beam and of helper lines, m."""
BASE_SIZE = (0.09, 0.09, 0.05)
"""Half edges of a base block, m."""
FORCE_SCALE = 1e-3
"""Length of an internal-force arrow, m per N: the paper's 300 N at the start is 0.3 m long."""


def fixed_shapes(scenario: Scenario) -> Iterator[tuple[str, rr.AsComponents]]:
    """The static parts, (entity, archetype): links' sizes, bases, colours, curves' widths."""
    arms = scenario.arms
    colors = [color for color, _ in zip((BLUE, VERMILION), arms, strict=False)]
    links = rr.Capsules3D(
        lengths=[length for arm in arms for length in arm.link_length],
        radii=[radius for _ in arms for radius in LINK_RADIUS],
        colors=[color for color in colors for _ in range(3)],
        fill_mode="solid",
    )
    yield "scene/links", links
    centers, sizes = [(*arm.base, -BASE_SIZE[2]) for arm in arms], [BASE_SIZE] * len(arms)
    yield "scene/bases", rr.Boxes3D(centers=centers, half_sizes=sizes, colors=[GRAY] * len(arms), fill_mode="solid")
    yield "scene/beam", rr.LineStrips3D.from_fields(radii=BEAM_RADIUS, colors=[GREEN])
    yield "scene/chords", rr.LineStrips3D.from_fields(radii=[THIN_RADIUS, 2 * THIN_RADIUS], colors=[GRAY, PURPLE])
    yield "scene/path", rr.LineStrips3D.from_fields(radii=THIN_RADIUS / 2, colors=[PURPLE])
    yield "scene/internal_force", rr.Arrows3D.from_fields(radii=2 * THIN_RADIUS, colors=[ORANGE])


def moving_shapes(scenario: Scenario, samples: Samples, factor: float) -> Iterator[tuple[str, list[Column]]]:
    """The drawn states of a block of samples, (entity, columns), with the deflection times `factor`."""
    arms = arm_points(scenario, samples)
    yield "scene/links", _links(arms, samples.joint_angle)
    yield "scene/beam", [line_strips(_in_space(beam_points(scenario, samples, BEAM_POINTS, factor))[:, None])]
    # The virtual link and its desired place.
    chords = [link_points(scenario, samples.pose), link_points(scenario, samples.desired_pose)]
    yield "scene/chords", [line_strips(_in_space(np.stack(chords, axis=1), height=-2 * BEAM_RADIUS))]
    force = FORCE_SCALE * _in_space(samples.internal_force[:, :, :2])
    origins = vectors("Arrows3D", "origins", "Position3D", _in_space(arms[:, :, 3]))
    yield "scene/internal_force", [vectors("Arrows3D", "vectors", "Vector3D", force), origins]


PATH_POINTS = 256
"""Points of the drawn desired path."""


def desired_path(scenario: Scenario) -> np.ndarray:
    """One pass of the desired path of the payload's origin, (1, 1, points, 3) for `line_strips`."""
    times = np.linspace(*scenario.trajectory.window, PATH_POINTS)
    return _in_space(poses(build_motion(scenario.trajectory), times)[:, 0, :2])[None, None]


def _links(points: np.ndarray, joint_angle: np.ndarray) -> list[Column]:
    """Poses of the capsules, which extend from their start along z: laid into the plane and turned about z."""
    half = 0.5 * np.cumsum(joint_angle, axis=2).reshape(len(points), -1)
    # Quaternion (x, y, z, w) of a quarter turn about y followed by `angle` about z.
    quaternion = np.stack([-np.sin(half), np.cos(half), np.sin(half), np.cos(half)], axis=-1) / np.sqrt(2)
    start = _in_space(points[:, :, :3].reshape(len(points), -1, 2))
    return [
        vectors("InstancePoses3D", "translations", "Translation3D", start),
        vectors("InstancePoses3D", "quaternions", "RotationQuat", quaternion),
    ]


def _in_space(plane: np.ndarray, height: float = 0.0) -> np.ndarray:
    """Points (…, 2) of the plane as points (…, 3) in space, `height` m above it."""
    return np.concatenate([plane, np.full((*plane.shape[:-1], 1), height)], axis=-1)


VIEW_MARGIN = 0.55
"""Margin for elbows beyond bases and payload, m."""
VIEW_SHAPE = 1.6
"""Approximate width of the view over its height."""
EYE_ANGLE = np.radians(55)
"""Rerun's field of view from top to bottom."""


def eye(scenario: Scenario, shape: float = VIEW_SHAPE) -> tuple[tuple[float, float, float], float]:
    """(point to look at, height above it in m) from which the whole motion is seen, in a view `shape` times as wide as high."""
    path = scenario.trajectory
    center, reach = np.array(path.middle[:2]), np.array(path.reach[:2]) + 0.5 * scenario.payload.length
    points = np.array([*(arm.base for arm in scenario.arms), center - reach, center + reach])
    low, high = points.min(axis=0) - VIEW_MARGIN / 2, points.max(axis=0) + VIEW_MARGIN / 2
    x, y = 0.5 * (low + high)
    half = 0.5 * max((high[0] - low[0] + VIEW_MARGIN) / shape, high[1] - low[1])
    return (float(x), float(y), 0.0), float(half / np.tan(EYE_ANGLE / 2))


MAIN_PLOTS = ("error", "vibration", "internal_force", "joint_torque")
"""Plots that are always visible; the others are tabs."""
MEASURED_PLOT = "vibration"
"""The plot of a measured beam's deflection."""


def run_blueprint(scenario: Scenario, factor: float, title: str, follow: bool = False) -> rrb.Blueprint:
    """The layout of one run. `factor`: exaggeration of the drawn deflection, which the view's name states.

    `follow`: whether to show the newest instant as it comes.
    """
    signals = views(scenario)
    left = rrb.Vertical(
        scene_view(f"{title}: deflection drawn × {number_text(factor)}", scenario),
        rrb.Tabs(
            rrb.TextDocumentView(origin="parameters", name="Parameters"),
            rrb.TextLogView(origin="events", name="Events"),
            rrb.TextDocumentView(origin="signals", name="Signals"),
            *(plot_view(signal) for signal in (*signals, REAL_TIME_FACTOR) if signal.entity not in MAIN_PLOTS),
            active_tab=0,
        ),
        row_shares=[3, 2],
    )
    right = rrb.Vertical(*(plot_view(signal) for signal in signals if signal.entity in MAIN_PLOTS))
    return side_by_side(left, right, follow)


def measurement_blueprint(scenario: Scenario) -> rrb.Blueprint:
    """The layout of a measured run: its curves, without a drawing."""
    texts = rrb.Tabs(
        rrb.TextDocumentView(origin="parameters", name="Measurement"),
        rrb.TextLogView(origin="events", name="Events"),
        active_tab=0,
    )
    (measured,) = (signal for signal in views(scenario) if signal.entity == MEASURED_PLOT)
    return side_by_side(texts, plot_view(measured))


def side_by_side(left: rrb.Container, right: rrb.Container | rrb.View, follow: bool = False) -> rrb.Blueprint:
    """Two halves and a folded time panel, nothing else."""
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1, 1]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if follow else None),
        auto_views=False,
        auto_layout=False,
    )


def scene_view(name: str, scenario: Scenario, contents: str = "/scene/**", shape: float = VIEW_SHAPE) -> rrb.View:
    """The plane from above; `shape`: approximate width of the view over its height."""
    (x, y, z), height = eye(scenario, shape)
    return rrb.Spatial3DView(
        origin="/",
        contents=contents,
        name=name,
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.1, stroke_width=0.5, color=(128, 128, 128, 60)),
        background=rrb.Background(color=(28, 30, 34)),
        eye_controls=rrb.EyeControls3D(
            # Slightly off the vertical: looking straight down leaves "up" undefined.
            kind=rrb.Eye3DKind.Orbital,
            position=(x, y - 0.01, z + height),
            look_target=(x, y, z),
            eye_up=(0.0, 1.0, 0.0),
        ),
    )


def plot_view(signal: View, contents: Sequence[str] = ()) -> rrb.TimeSeriesView:
    """One plot, which shares its time axis with all others. `contents`: entities to draw instead of the signal's own."""
    return rrb.TimeSeriesView(
        origin="/" if contents else f"/{signal.entity}",
        contents=list(contents) or "$origin/**",
        name=f"{signal.title} ({', '.join(sorted(set(signal.units)))})",
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
