"""The arms: one batch of instances per kind of part, for all arms together.

`web_assets/make/models.py` makes the parts. All lengths in m, for the paper's arm (0.7, 0.6, 0.2 m links).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from flexlab.assets import web_assets_folder
from flexlab.scenario import Scenario
from flexlab.sim.geometry import arm_points
from flexlab.sim.samples import Samples
from flexlab.views import BLUE, VERMILION, Color

ARM_COLORS = BLUE, VERMILION
LINK_HEIGHTS = (0.085, 0.135, 0.185)
"""Heights of the links' centres above the floor: stacked, so that they pass over one another."""
BEAM_HEIGHT = 0.185
"""Height of the payload above the floor: level with the last link, which holds it."""
JOINT_SCALES = (1.0, 0.85, 0.65)
"""Size of each joint relative to the first."""
LINK_WIDTHS = (1.0, 0.85, 0.62)
"""Cross-section of each link relative to the first."""
JOINT_RADIUS = 0.058
RING_TOP, RING_SECTIONS = 0.031, 28
"""Height of the coloured ring above the joint's centre, at a joint scale of 1; and its facets."""
GRIPPER_LENGTH = 0.055
"""Distance from the gripper's palm to the grip; the last link's bar is shorter by it."""
PAPER_REACH = 1.5
"""Sum of the paper's link lengths, m: the arm that the parts are drawn for."""
JOINTS = 3
GRAB_WIDTH, GRAB_HEIGHT = 0.11, 0.06
"""Width and height of the invisible bar that can be dragged, for the first link, m: as wide as its joint."""


def accent_ring() -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) m and faces (F, 3) of the ring about z, in the arm's colour, on a joint of scale 1.

    Its outside and its top have separate vertices, so that the edge between them is sharp; its inside is never seen.
    """
    angle = np.linspace(0, 2 * np.pi, RING_SECTIONS + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inner, outer, bottom = 0.55 * JOINT_RADIUS, 0.86 * JOINT_RADIUS, 0.02
    top = RING_TOP - 0.004
    rims = ((outer, bottom), (outer, top), (outer, top), (inner, top))
    near = np.arange(RING_SECTIONS)
    far = near + RING_SECTIONS + 1
    side = np.concatenate([np.column_stack([near, near + 1, far + 1]), np.column_stack([near, far + 1, far])])
    vertices = np.concatenate([np.column_stack([r * circle, np.full(len(angle), z)]) for r, z in rims])
    return vertices, np.concatenate([side, side + 2 * (RING_SECTIONS + 1)])


def grab_bar() -> tuple[np.ndarray, np.ndarray]:
    """Vertices (8, 3) m and faces (12, 3) of the invisible bar around a link, from x = 0 to 1."""
    half = np.array([1.0, GRAB_WIDTH / 2, GRAB_HEIGHT / 2])
    vertices = half * [(x, y, z) for x in (0, 1) for y in (-1, 1) for z in (-1, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertices, np.array([corners for a, b, c, d in sides for corners in ((a, b, c), (a, c, d))])


def for_instances(palette: Sequence[Color] | np.ndarray) -> np.ndarray:
    """Colours (N, 3) for viser's batched meshes: viser shows their numbers as linear light, all others as sRGB."""
    return np.round(255 * (np.asarray(palette) / 255) ** 2.2).astype(np.uint8)


def load_model(name: str) -> bytes:
    """The GLB file of a part: base, link, joint or gripper."""
    return (web_assets_folder() / "models" / f"{name}.glb").read_bytes()


def scene_size(scenario: Scenario) -> float:
    """Scale of the drawn parts, 1 for the paper's arms: the mean length of the arms over that of the paper's."""
    return float(np.mean([sum(arm.link_length) for arm in scenario.arms])) / PAPER_REACH


def turn_about_z(angle: np.ndarray) -> np.ndarray:
    """Unit quaternions (w, x, y, z) of rotations by `angle` (any shape) rad about z, shape angle.shape + (4,)."""
    half = 0.5 * np.asarray(angle)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


class Arms:
    """Draws every arm of a scenario; `update` moves them. `grab`: invisible bars around the links, arm by arm, for dragging."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        self._count = len(scenario.arms)
        still = np.zeros((self._count * JOINTS, 3))
        upright = turn_about_z(np.zeros(self._count * JOINTS))
        widths = np.tile(LINK_WIDTHS, self._count) * self._size
        lengths = np.array([arm.link_length for arm in scenario.arms])
        bars = lengths.copy()
        bars[:, -1] = np.maximum(bars[:, -1] - GRIPPER_LENGTH * self._size, 1e-3)
        joint_scales = np.tile(JOINT_SCALES, self._count) * self._size
        base = np.array([(*arm.base, 0.0) for arm in scenario.arms])

        def batch(name: str, positions: np.ndarray, scales: np.ndarray, *solid: np.ndarray, **look: Any) -> Any:
            """Instances of a model, or of a solid with vertices and faces, which casts no shadow."""
            look |= {
                "batched_wxyzs": upright[: len(positions)],
                "batched_positions": positions,
                "batched_scales": scales,
            }
            look |= {"lod": "off", "receive_shadow": False}
            if solid:
                return scene.add_batched_meshes_simple(f"/arms/{name}", *solid, cast_shadow=False, **look)
            return scene.add_batched_glb(f"/arms/{name}", load_model(name), **look)

        self._bases = batch("base", base, np.full(self._count, self._size))
        self._links = batch("link", still, np.column_stack([bars.ravel(), widths, widths]))
        self._joints = batch("joint", still, joint_scales)
        self._grippers = batch("gripper", still[: self._count], np.full(self._count, self._size))
        tones = np.repeat(for_instances(ARM_COLORS[: self._count]), JOINTS, axis=0)
        self._rings = batch("rings", still, joint_scales, *accent_ring(), batched_colors=tones)
        # viser's page breaks if instances of GLB files react to the pointer; instances of plain meshes may.
        around = np.column_stack([lengths.ravel(), widths, widths])
        self.grab = batch("grab", still, around, *grab_bar(), opacity=0.0)

    def update(self, scenario: Scenario, sample: Samples) -> None:
        """Move all parts to their places in `sample` (N = 1)."""
        points = arm_points(scenario, sample)[0]
        angle = np.cumsum(sample.joint_angle[0], axis=1)
        heights = np.tile(np.array(LINK_HEIGHTS) * self._size, (self._count, 1))
        joints = np.concatenate([points[:, :JOINTS], heights[:, :, None]], axis=2).reshape(-1, 3).astype(np.float32)
        height = np.full(self._count, BEAM_HEIGHT * self._size)
        grips = np.column_stack([points[:, JOINTS], height]).astype(np.float32)
        self._links.batched_positions = joints
        self._links.batched_wxyzs = turn_about_z(angle.ravel())
        self._joints.batched_positions = joints
        self.grab.batched_positions = joints
        self.grab.batched_wxyzs = self._links.batched_wxyzs
        self._rings.batched_positions = joints
        self._grippers.batched_positions = grips
        self._grippers.batched_wxyzs = turn_about_z(angle[:, -1])
