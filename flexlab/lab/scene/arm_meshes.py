"""The arms: bases, links, joints and grippers, one batch of instances per kind of part for all arms together."""

import numpy as np
import viser

from flexlab.lab import colors
from flexlab.lab.scene import arm_models
from flexlab.lab.scene.solids import bar
from flexlab.scenario import Scenario
from flexlab.sim.geometry import arm_points
from flexlab.sim.samples import Samples

PAPER_REACH = 1.5
"""Sum of the paper's link lengths, m: the arm that the parts are drawn for."""
JOINTS = 3
GRAB_WIDTH, GRAB_HEIGHT = 0.11, 0.06
"""Cross-section of the unseen bar that a hand takes hold of, for the first link, m: as wide as its joint."""


def scene_size(scenario: Scenario) -> float:
    """How large the parts are drawn, 1 for the paper's arms: from the mean length of the arms."""
    return float(np.mean([sum(arm.link_length) for arm in scenario.arms])) / PAPER_REACH


def turn_about_z(angle: np.ndarray) -> np.ndarray:
    """Unit quaternions (w, x, y, z) of rotations by `angle` (any shape) rad about z, shape angle.shape + (4,)."""
    half = 0.5 * np.asarray(angle)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


class Arms:
    """Draws every arm of a scenario; `update` moves them. `grab`: unseen bars around the links, to be touched, arm by arm."""

    def __init__(self, scene: viser.SceneApi, scenario: Scenario):
        self._size = scene_size(scenario)
        self._count = len(scenario.arms)
        still = np.zeros((self._count * JOINTS, 3))
        upright = turn_about_z(np.zeros(self._count * JOINTS))
        widths = np.tile(arm_models.LINK_WIDTHS, self._count) * self._size
        lengths = np.array([arm.link_length for arm in scenario.arms])
        lengths[:, -1] = np.maximum(lengths[:, -1] - arm_models.GRIPPER_LENGTH * self._size, 1e-3)
        joint_scales = np.tile(arm_models.JOINT_SCALES, self._count) * self._size
        base = np.array([(*arm.base, 0.0) for arm in scenario.arms])

        def batch(name: str, positions: np.ndarray, scales: np.ndarray) -> viser.BatchedGlbHandle:
            return scene.add_batched_glb(
                f"/arms/{name}",
                arm_models.load_model(name),
                batched_wxyzs=upright[: len(positions)],
                batched_positions=positions,
                batched_scales=scales,
                lod="off",
                receive_shadow=False,
            )

        self._root = scene.add_frame("/arms", show_axes=False)
        self._bases = batch("base", base, np.full(self._count, self._size))
        self._links = batch("link", still, np.column_stack([lengths.ravel(), widths, widths]))
        self._joints = batch("joint", still, joint_scales)
        self._grippers = batch("gripper", still[: self._count], np.full(self._count, self._size))
        ring = arm_models.accent_ring()
        self._rings = scene.add_batched_meshes_simple(
            "/arms/rings",
            ring.vertices,
            ring.faces,
            batched_wxyzs=upright,
            batched_positions=still,
            batched_scales=joint_scales,
            batched_colors=np.repeat(colors.for_instances(colors.ARMS[: self._count]), JOINTS, axis=0),
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

        # viser's page breaks when instances of GLB files are to be touched; those of plain meshes may be.
        length = np.array([arm.link_length for arm in scenario.arms]).ravel()
        handle = bar(0.0, 1.0, GRAB_WIDTH, GRAB_HEIGHT, GRAB_HEIGHT / 4)
        self.grab = scene.add_batched_meshes_simple(
            "/arms/grab",
            handle.vertices,
            handle.faces,
            batched_wxyzs=upright,
            batched_positions=still,
            batched_scales=np.column_stack([length, widths, widths]),
            opacity=0.0,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

    def update(self, scenario: Scenario, sample: Samples) -> None:
        """Move all parts to where `sample` (N = 1) has them."""
        points = arm_points(scenario, sample)[0]
        angle = np.cumsum(sample.joint_angle[0], axis=1)
        heights = np.tile(np.array(arm_models.LINK_HEIGHTS) * self._size, (self._count, 1))
        joints = np.concatenate([points[:, :JOINTS], heights[:, :, None]], axis=2).reshape(-1, 3).astype(np.float32)
        height = np.full(self._count, arm_models.BEAM_HEIGHT * self._size)
        grips = np.column_stack([points[:, JOINTS], height]).astype(np.float32)
        self._links.batched_positions = joints
        self._links.batched_wxyzs = turn_about_z(angle.ravel())
        self._joints.batched_positions = joints
        self.grab.batched_positions = joints
        self.grab.batched_wxyzs = self._links.batched_wxyzs
        self._rings.batched_positions = joints
        self._grippers.batched_positions = grips
        self._grippers.batched_wxyzs = turn_about_z(angle[:, -1])

    def remove(self) -> None:
        """Take the arms out of the scene."""
        self._root.remove()
