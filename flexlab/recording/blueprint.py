"""What a recording shows when it is opened: the moving arms, the plots that matter, parameters and events. No clicking."""

from collections.abc import Sequence

import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flexlab.recording.rerun_internals.chunks import TIMELINE
from flexlab.recording.scene_log import VIEW_SHAPE, eye
from flexlab.scenario import Scenario
from flexlab.views import REAL_TIME_FACTOR, View, views

MAIN_PLOTS = ("error", "vibration", "internal_force", "joint_torque")
"""Seen at once; the other plots are tabs."""
MEASURED_PLOT = "vibration"
"""The plot of what is measured at a beam: its deflection."""


def run_blueprint(scenario: Scenario, factor: float, title: str, follow: bool = False) -> rrb.Blueprint:
    """The layout of one run. `factor`: exaggeration of the drawn deflection, which the view's name states.

    `follow`: show the newest instant, as it comes.
    """
    signals = views(scenario)
    left = rrb.Vertical(
        scene_view(f"{title}: deflection drawn × {factor:g}", scenario),
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
    """The layout of what was measured at a beam: its curves, and nothing in space."""
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


def scene_view(
    name: str, scenario: Scenario, contents: str = "/scene/**", shape: float = VIEW_SHAPE
) -> rrb.Spatial3DView:
    """The plane from above; `shape`: the view's width over its height, about."""
    (x, y, z), height = eye(scenario, shape)
    return rrb.Spatial3DView(
        origin="/",
        contents=contents,
        name=name,
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.1, stroke_width=0.5, color=(128, 128, 128, 60)),
        background=rrb.Background(color=(28, 30, 34)),
        eye_controls=rrb.EyeControls3D(
            # A hair off the vertical: looking straight down leaves "up" undefined.
            kind=rrb.Eye3DKind.Orbital,
            position=(x, y - 0.01, z + height),
            look_target=(x, y, z),
            eye_up=(0.0, 1.0, 0.0),
        ),
    )


def plot_view(signal: View, contents: Sequence[str] = ()) -> rrb.TimeSeriesView:
    """One plot, its time axis shared with all others. `contents`: other entities to draw in it than the signal's own."""
    units = sorted({name[name.rindex("[") + 1 : -1] for name in signal.names})
    return rrb.TimeSeriesView(
        origin="/" if contents else f"/{signal.entity}",
        contents=list(contents) or "$origin/**",
        name=f"{signal.title} [{', '.join(units)}]",
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
