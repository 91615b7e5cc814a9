"""The payload: a tube along the beam's centre line, or short pieces coloured by strain or axial force.

Its deflection is exaggerated by a factor that the screen shows. The beam of a kept run is drawn behind the present one, at the
same simulation time.
"""

from typing import Any

import numpy as np
import viser

from flexlab.lab.ranges import AFTER_PICTURES, Range
from flexlab.lab.reference_run import ReferenceRun
from flexlab.lab.scene.arms import BEAM_HEIGHT, for_instances, scene_size, turn_about_z
from flexlab.lab.view_settings import ViewSettings
from flexlab.physics.beam import shape_row
from flexlab.scenario import Payload, Scenario
from flexlab.sim.geometry import beam_points
from flexlab.sim.samples import Samples
from flexlab.sim.signals import PLACES
from flexlab.text import number_text
from flexlab.views import BLUE, GRAY, VERMILION, css

STATIONS = 33
"""Points along the beam: smooth up to its eighth mode, at 4 kB per picture."""
SIDES = 10
GRAB_RADIUS = 0.035
"""Radius of the invisible tube that can be dragged, for the paper's arms, m: wide enough for a finger on a phone."""
GRAB_EVERY, GRAB_SIDES = 8, 6
"""Stations of the drawn tube per station of the invisible one, and the sides of that, which may be coarse."""
BEAM_COLOR = (20, 232, 150)
"""RGB: the brightest colour of the picture."""
TUBE_RADIUS = 0.015
"""Drawn radius for the paper's arms, m; the model's beam has no thickness."""
OPACITY = 0.45
SHARE = 0.9
"""Thickness of the kept beam relative to the present one, which must stay in front."""
PIECES = 48
OVERLAP = 1.15
"""Length of a piece relative to its section of the beam: closes the gaps on the outside of a bend."""
FIBRE = 1e-3
"""Distance from the neutral axis at which strain is shown, m; the model's beam has no thickness."""
MICRO = 1e6
LEAST_STRAIN = 1.0
"""Least range of the colours, µm/m or N."""
NEUTRAL = (225, 225, 225)
NEGATIVE, POSITIVE = BLUE, VERMILION
COLORED = {
    "strain": ("strain, 1 mm off the axis", "µm/m"),
    "axial": ("force along the beam, compression to tension", "N"),
}
"""Setting of the view → what the colours show, and its unit."""


def tube_vertices(line: np.ndarray, radius: float, height: float, sides: int = SIDES) -> np.ndarray:
    """Vertices ((count + 2) · sides, 3) of a closed tube around `line` (count, 2) m at `height` m above the floor."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    plane = line[:, None, :] + radius * np.cos(angle)[None, :, None] * across[:, None, :]
    up = np.broadcast_to(height + radius * np.sin(angle), plane.shape[:2])
    rings = np.concatenate([plane, up[:, :, None]], axis=2)
    caps = [np.broadcast_to([*line[end], height], (1, sides, 3)) for end in (0, -1)]
    return np.concatenate([caps[0], rings, caps[1]]).reshape(-1, 3).astype(np.float32)


def tube_faces(count: int, sides: int = SIDES) -> np.ndarray:
    """Triangles of `tube_vertices` for `count` points, counter-clockwise as seen from outside."""
    rows = np.arange(count + 1)[:, None] * sides
    here, next_ = np.arange(sides), (np.arange(sides) + 1) % sides
    near, near_next, far, far_next = rows + here, rows + next_, rows + sides + here, rows + sides + next_
    first = np.stack([near, far_next, far], axis=-1)
    second = np.stack([near, near_next, far_next], axis=-1)
    return np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


class Tube:
    """A tube at the beam's height around a line of `count` points; `radius` for the paper's arms, m."""

    def __init__(
        self,
        scene: viser.SceneApi,
        scenario: Scenario,
        name: str,
        count: int,
        radius: float,
        sides: int = SIDES,
        **look: Any,
    ):
        self._size, self._radius, self._sides = scene_size(scenario), radius, sides
        nowhere, faces = np.zeros(((count + 2) * sides, 3)), tube_faces(count, sides)
        self.mesh = scene.add_mesh_simple(name, nowhere, faces, receive_shadow=False, **look)

    def draw(self, line: np.ndarray) -> None:
        """Bend the tube along a line (count, 2) m."""
        self.mesh.vertices = tube_vertices(line, self._radius * self._size, BEAM_HEIGHT * self._size, self._sides)


class Beam:
    """Draws the payload; `update` bends it. `grab`: a thicker, invisible tube around it, for dragging and clicking."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._tube = Tube(scene, scenario, "/beam", STATIONS, TUBE_RADIUS, color=BEAM_COLOR)
        count = len(range(0, STATIONS, GRAB_EVERY))
        self._around = Tube(scene, scenario, "/grab", count, GRAB_RADIUS, GRAB_SIDES, opacity=0.0, cast_shadow=False)
        self.mesh, self.grab = self._tube.mesh, self._around.mesh

    def update(self, scenario: Scenario, sample: Samples, view: ViewSettings) -> None:
        """Bend the tube as in `sample` (N = 1), exaggerated as in `view`; hide it while `StrainBeam` is shown."""
        line = beam_points(scenario, sample, STATIONS, view.exaggeration)[0]
        self.mesh.visible = not (view.strain or view.axial)
        if not (view.strain or view.axial):
            self._tube.draw(line)
        self._around.draw(line[::GRAB_EVERY])


class ReferenceBeam:
    """The beam of the kept run, drawn while that run has a sample for the present time."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        look = {"color": GRAY, "opacity": OPACITY, "cast_shadow": False, "visible": False}
        self._tube = Tube(scene, scenario, "/kept", STATIONS, SHARE * TUBE_RADIUS, **look)

    def update(self, sample: Samples, view: ViewSettings, kept: ReferenceRun | None) -> None:
        """Draw `kept` at the time of `sample` (N = 1)."""
        past = kept.at(float(sample.time[0])) if kept is not None else None
        self._tube.mesh.visible = past is not None
        if kept is not None and past is not None:
            self._tube.draw(beam_points(kept.scenario, past, STATIONS, view.exaggeration)[0])


def curvature_functions(payload: Payload, count: int) -> np.ndarray:
    """Contribution of each free coordinate to w''(s) at the centres of `count` equal pieces, (count, n_q)."""
    middle = ((np.arange(count) + 0.5) / count - 0.5) * payload.length
    rows = [shape_row(s, payload.length, payload.element_count, payload.boundary, derivative=2) for s in middle]
    return np.array(rows)


def strain_colors(share: np.ndarray) -> np.ndarray:
    """Colours (N, 3) for strain as a fraction -1..1 of the range: blue below, grey at zero, vermilion above."""
    share = np.clip(share, -1, 1)[:, None]
    end = np.where(share < 0, NEGATIVE, POSITIVE)
    mixed = NEUTRAL + np.abs(share) * (end - np.array(NEUTRAL))
    return for_instances(mixed)


def axial_loads(sample: Samples, count: int) -> np.ndarray:
    """N(s) of a sample (N = 1) at the centres of `count` equal pieces, N, (count,): the parabola through its places.

    Exact unless somebody pulls the beam: N jumps at that point.
    """
    middle = (np.arange(count) + 0.5) / count - 0.5
    load = sample.axial_load[0]
    if not np.isfinite(load).all():
        return np.zeros(count)
    return np.polyval(np.polyfit(PLACES, load, 2), middle)


class StrainBeam:
    """Draws the payload coloured by strain or by axial force, if the view asks for it."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        self._payload: Payload | None = None
        self._shown = ""
        self._curvature = np.zeros((PIECES, 0))
        self._range = Range(LEAST_STRAIN, AFTER_PICTURES)
        radius = TUBE_RADIUS * self._size
        closed = tube_vertices(np.array([[-0.5, 0.0], [0.5, 0.0]]), radius, 0.0)
        self._pieces = scene.add_batched_meshes_simple(
            "/strain",
            closed[SIDES:-SIDES],
            tube_faces(0),  # Open at its ends: a disc between two pieces would look like a dark line.
            batched_wxyzs=turn_about_z(np.zeros(PIECES)),
            batched_positions=np.zeros((PIECES, 3)),
            batched_scales=np.ones((PIECES, 3)),
            batched_colors=np.tile(np.array(NEUTRAL, np.uint8), (PIECES, 1)),
            lod="off",
            side="double",
            receive_shadow=False,
            visible=False,
        )

    def scales(self) -> list[tuple[str, str]]:
        """(quantity, colour bar with the values at its ends as HTML) of the present colours."""
        if not self._shown:
            return []
        what, unit = COLORED[self._shown]
        ends = ", ".join(map(css, (NEGATIVE, NEUTRAL, POSITIVE)))
        strip = f'<span class="fl-strip" style="background: linear-gradient(90deg, {ends})"></span>'
        limit = number_text(self._range.limit)
        return [(what, f"−{limit} {strip} +{limit} {unit}")]

    def update(self, scenario: Scenario, sample: Samples, view: ViewSettings) -> None:
        """Colour and bend the pieces as in `sample` (N = 1)."""
        shown = "strain" if view.strain else "axial" if view.axial else ""
        self._pieces.visible = bool(shown)
        if shown != self._shown:
            self._shown, self._range = shown, Range(LEAST_STRAIN, AFTER_PICTURES)
        if not shown:
            return
        if scenario.payload != self._payload:
            self._payload = scenario.payload
            self._curvature = curvature_functions(scenario.payload, PIECES)
        if shown == "strain":
            strain = -MICRO * FIBRE * self._curvature @ sample.beam_coordinates[0]
        else:
            strain = axial_loads(sample, PIECES)
        self._range.fit(float(np.abs(strain).max()))
        line = beam_points(scenario, sample, PIECES + 1, view.exaggeration)[0]
        along = np.diff(line, axis=0)
        middle = np.column_stack([(line[:-1] + line[1:]) / 2, np.full(PIECES, BEAM_HEIGHT * self._size)])
        length = OVERLAP * np.linalg.norm(along, axis=1)
        self._pieces.batched_positions = middle.astype(np.float32)
        self._pieces.batched_wxyzs = turn_about_z(np.arctan2(along[:, 1], along[:, 0])).astype(np.float32)
        self._pieces.batched_scales = np.column_stack([length, np.ones((PIECES, 2))]).astype(np.float32)
        self._pieces.batched_colors = strain_colors(strain / self._range.limit)
