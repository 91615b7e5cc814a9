"""The arms: their parts, one batch of instances per kind of part for all arms together.

`python -m flexlab.lab.scene.arms` writes the parts as files. They fit arms of any size: a link's bar is one unit long and
stretched to the link, joints and gripper keep their proportions. All lengths in m, for the paper's arm (0.7, 0.6, 0.2 m links).
"""

from pathlib import Path

import numpy as np
import viser

from flexlab.assets import web_assets_folder
from flexlab.lab import colors
from flexlab.lab.scene.solids import Material, Solid, bar, drum, encode_glb, joined, moved, ring, turned
from flexlab.scenario import Scenario
from flexlab.sim.geometry import arm_points
from flexlab.sim.samples import Samples

SHELL = Material((118, 126, 138), metallic=0.05, roughness=0.6)
"""Of links and joints: darker than what they carry, which is to be seen first."""
DARK = Material((62, 68, 78), metallic=0.2, roughness=0.55)
STEEL = Material((132, 140, 152), metallic=0.2, roughness=0.4)
BRIGHT = Material((246, 247, 249), metallic=0.0, roughness=0.35)
"""Of the grips."""

LINK_HEIGHTS = (0.085, 0.135, 0.185)
"""Heights of the links' middles above the floor: stacked, so that they pass over one another."""
BEAM_HEIGHT = 0.185
"""Height of the payload above the floor: level with the last link that holds it."""
JOINT_SCALES = (1.0, 0.85, 0.65)
"""Size of each joint relative to the first."""
LINK_WIDTHS = (1.0, 0.85, 0.62)
"""Cross-section of each link relative to the first."""
JOINT_RADIUS = 0.058
RING_TOP = 0.031
"""Height of the coloured ring above the joint's middle, before the joint's scale."""
GRIPPER_LENGTH = 0.055
"""From the gripper's palm to the grip: what the last link's bar is shortened by."""


def link_parts() -> list[tuple[Solid, Material]]:
    """A bar from x = 0 to x = 1 (stretched to the link's length), and a dark keel under it."""
    return [(bar(0.0, 1.0, 0.062, 0.034, 0.012), SHELL), (moved(bar(0.0, 1.0, 0.03, 0.012, 0.004), z=-0.02), DARK)]


def joint_parts() -> list[tuple[Solid, Material]]:
    """A housing about z with a dark foot and cap, its middle at z = 0."""
    housing = drum(JOINT_RADIUS, -0.024, 0.024, 0.006)
    foot = drum(0.8 * JOINT_RADIUS, -0.05, -0.02, 0.003)
    cap = drum(0.5 * JOINT_RADIUS, 0.02, 0.033, 0.004, 24)
    return [(housing, SHELL), (joined(foot, cap), DARK)]


def base_parts() -> list[tuple[Solid, Material]]:
    """A pedestal on the floor, under joint 1."""
    plate = drum(0.115, 0.0, 0.014, 0.004, 40)
    column = turned([(0.088, 0.012), (0.066, 0.03), (0.06, 0.062), (0.0, 0.062)])
    bolts = [moved(drum(0.009, 0.012, 0.02, 0.002, 8), x=x, y=y) for x in (-0.07, 0.07) for y in (-0.07, 0.07)]
    return [(joined(plate, *bolts), DARK), (column, STEEL)]


def gripper_parts() -> list[tuple[Solid, Material]]:
    """A fork along x with the grip at the origin: two prongs above and below the beam, and the pin that it turns on."""
    palm = bar(-GRIPPER_LENGTH - 0.012, -GRIPPER_LENGTH + 0.012, 0.05, 0.05, 0.006)
    prongs = [moved(bar(-GRIPPER_LENGTH, 0.012, 0.03, 0.007, 0.003), z=z) for z in (-0.0205, 0.0205)]
    pin = drum(0.008, -0.03, 0.03, 0.002, 16)
    return [(palm, BRIGHT), (joined(*prongs), BRIGHT), (pin, DARK)]


def accent_ring() -> Solid:
    """The ring on a joint that carries the arm's colour, about z, for a joint of scale 1."""
    return ring(0.55 * JOINT_RADIUS, 0.86 * JOINT_RADIUS, 0.02, RING_TOP - 0.004, 28)


MODELS = {"link": link_parts, "joint": joint_parts, "base": base_parts, "gripper": gripper_parts}


def load_model(name: str) -> bytes:
    """The GLB file of a part in `MODELS`, from web_assets."""
    return (web_assets_folder() / "models" / f"{name}.glb").read_bytes()


def write_models(folder: Path) -> None:
    """Write every part as a GLB file into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, parts in MODELS.items():
        (folder / f"{name}.glb").write_bytes(encode_glb(parts()))


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
        widths = np.tile(LINK_WIDTHS, self._count) * self._size
        lengths = np.array([arm.link_length for arm in scenario.arms])
        lengths[:, -1] = np.maximum(lengths[:, -1] - GRIPPER_LENGTH * self._size, 1e-3)
        joint_scales = np.tile(JOINT_SCALES, self._count) * self._size
        base = np.array([(*arm.base, 0.0) for arm in scenario.arms])

        def batch(name: str, positions: np.ndarray, scales: np.ndarray) -> viser.BatchedGlbHandle:
            return scene.add_batched_glb(
                f"/arms/{name}",
                load_model(name),
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
        ring = accent_ring()
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

    def remove(self) -> None:
        """Take the arms out of the scene."""
        self._root.remove()


if __name__ == "__main__":
    write_models(web_assets_folder() / "models")
