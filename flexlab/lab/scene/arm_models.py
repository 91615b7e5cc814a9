"""The arms' parts: how they look and where they stand above the floor. `python -m flexlab.lab.scene.arm_models` writes them.

The parts fit arms of any size: a link's bar is one unit long and stretched to the link, joints and gripper keep their
proportions. All lengths in m, for the paper's arm (0.7, 0.6, 0.2 m links).
"""

from pathlib import Path

from flexlab.assets import web_assets_folder
from flexlab.lab.scene.glb import Material, encode_glb
from flexlab.lab.scene.solids import Solid, bar, drum, joined, moved, ring, turned

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


if __name__ == "__main__":
    write_models(web_assets_folder() / "models")
