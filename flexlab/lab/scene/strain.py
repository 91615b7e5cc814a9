"""The beam coloured by its bending strain, or by the force along it: short pieces in place of the tube, one batch."""

import numpy as np
import viser

from flexlab.lab import colors
from flexlab.lab.ranges import Range
from flexlab.lab.scene import arms
from flexlab.lab.scene.arms import scene_size, turn_about_z
from flexlab.lab.scene.beam_mesh import SIDES, TUBE_RADIUS, tube_faces, tube_vertices
from flexlab.lab.view_settings import ViewSettings
from flexlab.physics.beam import shape_row
from flexlab.scenario import Payload, Scenario
from flexlab.sim.geometry import beam_points
from flexlab.sim.samples import Samples
from flexlab.sim.signals import PLACES

PIECES = 48
OVERLAP = 1.15
"""Length of a piece relative to its share of the beam: closes the gaps on the outside of a bend."""
FIBRE = 1e-3
"""Distance from the neutral axis at which strain is stated, m; the model's beam has no thickness of its own."""
MICRO = 1e6
LEAST_STRAIN = 1.0
"""The colour range never falls below this, µm/m or N."""
FRAMES_BEFORE_SHRINKING = 75
"""Pictures without a large strain before the colours are spread anew (2.5 s)."""
NEUTRAL = (225, 225, 225)
NEGATIVE, POSITIVE = colors.BLUE, colors.VERMILION


def curvature_functions(payload: Payload, count: int) -> np.ndarray:
    """w''(s)'s share of each free coordinate at the middles of `count` equal pieces, (count, n_q)."""
    middle = ((np.arange(count) + 0.5) / count - 0.5) * payload.length
    rows = [shape_row(s, payload.length, payload.element_count, payload.boundary, derivative=2) for s in middle]
    return np.array(rows)


def strain_colors(share: np.ndarray) -> np.ndarray:
    """Colours (N, 3) for strain as a share -1..1 of the range: blue below, grey at zero, vermilion above."""
    share = np.clip(share, -1, 1)[:, None]
    end = np.where(share < 0, NEGATIVE, POSITIVE)
    mixed = NEUTRAL + np.abs(share) * (end - np.array(NEUTRAL))
    return np.round(255 * (mixed / 255) ** 2.2).astype(np.uint8)


def axial_loads(scenario: Scenario, sample: Samples, count: int) -> np.ndarray:
    """N(s) of a sample (N = 1) at the middles of `count` equal pieces, N, (count,): the parabola through its places.

    Exact but for a hand at the beam, at which N jumps.
    """
    middle = (np.arange(count) + 0.5) / count - 0.5
    load = sample.axial_load[0]
    if not np.isfinite(load).all():
        return np.zeros(count)
    return np.polyval(np.polyfit(PLACES, load, 2), middle)


class StrainBeam:
    """Draws the payload in colours of its strain, or of the force along it, when the view asks for it."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        self._payload: Payload | None = None
        self._shown = ""
        self._curvature = np.zeros((PIECES, 0))
        self._range = Range(LEAST_STRAIN, FRAMES_BEFORE_SHRINKING)
        radius = TUBE_RADIUS * self._size
        closed = tube_vertices(np.array([[-0.5, 0.0], [0.5, 0.0]]), radius, 0.0)
        self._pieces = scene.add_batched_meshes_simple(
            "/strain",
            closed[SIDES:-SIDES],
            tube_faces(0),  # Open at its ends: a disc between two pieces would be seen as a dark stroke.
            batched_wxyzs=turn_about_z(np.zeros(PIECES)),
            batched_positions=np.zeros((PIECES, 3)),
            batched_scales=np.ones((PIECES, 3)),
            batched_colors=np.tile(np.array(NEUTRAL, np.uint8), (PIECES, 1)),
            lod="off",
            side="double",
            receive_shadow=False,
            visible=False,
        )

    @property
    def limit(self) -> float:
        """At the ends of the colour range: strain, µm/m at `FIBRE` from the neutral axis, or the force along the beam, N."""
        return self._range.limit

    def update(self, scenario: Scenario, sample: Samples, view: ViewSettings) -> None:
        """Colour and bend as `sample` (N = 1) has it."""
        shown = "strain" if view.strain else "axial" if view.axial else ""
        self._pieces.visible = bool(shown)
        if shown != self._shown:
            self._shown, self._range = shown, Range(LEAST_STRAIN, FRAMES_BEFORE_SHRINKING)
        if not shown:
            return
        if scenario.payload != self._payload:
            self._payload = scenario.payload
            self._curvature = curvature_functions(scenario.payload, PIECES)
        if shown == "strain":
            strain = -MICRO * FIBRE * self._curvature @ sample.beam_coordinates[0]
        else:
            strain = axial_loads(scenario, sample, PIECES)
        self._range.fit(float(np.abs(strain).max()))
        line = beam_points(scenario, sample, PIECES + 1, view.exaggeration)[0]
        along = np.diff(line, axis=0)
        middle = np.column_stack([(line[:-1] + line[1:]) / 2, np.full(PIECES, arms.BEAM_HEIGHT * self._size)])
        length = OVERLAP * np.linalg.norm(along, axis=1)
        self._pieces.batched_positions = middle.astype(np.float32)
        self._pieces.batched_wxyzs = turn_about_z(np.arctan2(along[:, 1], along[:, 0])).astype(np.float32)
        self._pieces.batched_scales = np.column_stack([length, np.ones((PIECES, 2))]).astype(np.float32)
        self._pieces.batched_colors = strain_colors(strain / self._range.limit)

    def remove(self) -> None:
        """Take the beam out of the scene."""
        self._pieces.remove()
