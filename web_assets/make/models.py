"""Makes the parts of the arms as binary glTF files (GLB): simple solids as triangle meshes with crisp edges.

    .venv/bin/python web_assets/make/models.py

They fit arms of any size: a link's bar has length 1 and is stretched to the link, joints and gripper keep their proportions.
All lengths are in m, for the paper's arm (0.7, 0.6, 0.2 m links).
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from trimesh import Scene, Trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.util import concatenate
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from flexlab.lab.scene.arms import GRIPPER_LENGTH, JOINT_RADIUS

CORNER_STEPS = 3
"""Facets per rounded corner of a bar: enough to catch the light, few enough to draw fast without a graphics card."""


def solid(vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> Trimesh:
    """A mesh of `vertices` (V, 3) m, `normals` (V, 3) unit, `faces` (F, 3) indices, outside counter-clockwise."""
    return Trimesh(vertices, faces, vertex_normals=normals, process=False)


def joined(*meshes: Trimesh) -> Trimesh:
    """All meshes as one."""
    whole = concatenate(meshes)
    assert isinstance(whole, Trimesh)
    return whole


def moved(mesh: Trimesh, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Trimesh:
    """The mesh shifted by (x, y, z) m."""
    return solid(mesh.vertices + [x, y, z], mesh.vertex_normals, mesh.faces)


def turned(profile: list[tuple[float, float]], sections: int = 32) -> Trimesh:
    """A body of revolution about z; `profile` lists (radius, height) in m from bottom to top, edges stay crisp."""
    angle = np.linspace(0, 2 * np.pi, sections + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    strips = []
    for (r0, z0), (r1, z1) in zip(profile[:-1], profile[1:], strict=True):
        slant = np.hypot(r1 - r0, z1 - z0)
        outward, upward = (z1 - z0) / slant, (r0 - r1) / slant
        normals = np.column_stack([circle * outward, np.full(sections + 1, upward)])
        rings = [np.column_stack([circle * r, np.full(sections + 1, z)]) for r, z in ((r0, z0), (r1, z1))]
        strips.append(solid(np.concatenate(rings), np.concatenate([normals, normals]), _strip_faces(sections + 1)))
    return joined(*strips)


def drum(radius: float, bottom: float, top: float, chamfer: float, sections: int = 32) -> Trimesh:
    """A closed cylinder about z with chamfered rims, m."""
    return turned(
        [
            (0.0, bottom),
            (radius - chamfer, bottom),
            (radius, bottom + chamfer),
            (radius, top - chamfer),
            (radius - chamfer, top),
            (0.0, top),
        ],
        sections,
    )


def bar(start: float, end: float, width: float, height: float, corner: float) -> Trimesh:
    """A bar along x from `start` to `end` with a rounded cross-section `width` (y) by `height` (z), closed ends, m."""
    outline, normals = _rounded_rectangle(width, height, corner)
    count = len(outline)
    sides = solid(
        np.concatenate([np.insert(outline, 0, x, axis=1) for x in (start, end)]),
        np.tile(np.insert(normals, 0, 0.0, axis=1), (2, 1)),
        _strip_faces(count),
    )
    return joined(sides, _cap(outline, end, 1.0), _cap(outline[::-1], start, -1.0))


def _cap(outline: np.ndarray, x: float, side: float) -> Trimesh:
    vertices = np.insert(outline, 0, x, axis=1)
    corners = np.arange(1, len(outline) - 1)
    faces = np.column_stack([np.zeros_like(corners), corners, corners + 1])
    return solid(vertices, np.tile([side, 0.0, 0.0], (len(outline), 1)), faces)


def _rounded_rectangle(width: float, height: float, corner: float) -> tuple[np.ndarray, np.ndarray]:
    """Closed outline (first point repeated) in (y, z), counter-clockwise, and its outward normals, (count, 2) each."""
    points, normals = [], []
    for quarter, (y_sign, z_sign) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = np.pi / 2 * (quarter + np.linspace(0, 1, CORNER_STEPS + 1))
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        center = np.array([y_sign * (width / 2 - corner), z_sign * (height / 2 - corner)])
        points.append(center + corner * direction)
        normals.append(direction)
    points.append(points[0][:1])
    normals.append(normals[0][:1])
    return np.concatenate(points), np.concatenate(normals)


def _strip_faces(count: int) -> np.ndarray:
    """Triangles between two rows of `count` points each, (2 (count - 1), 3)."""
    near = np.arange(count - 1)
    far = near + count
    return np.concatenate([np.column_stack([near, near + 1, far + 1]), np.column_stack([near, far + 1, far])])


class Material(NamedTuple):
    """`color`: sRGB 0..255; `metallic` and `roughness` 0..1 as in glTF."""

    color: tuple[int, int, int]
    metallic: float = 0.1
    roughness: float = 0.6


def encode_glb(parts: list[tuple[Trimesh, Material]]) -> bytes:
    """A GLB file with one mesh per (mesh, material) pair, positions in m, z up as in flexlab and viser."""
    scene = Scene()
    for mesh, (color, metallic, roughness) in parts:
        look = PBRMaterial(baseColorFactor=[*color, 255], metallicFactor=metallic, roughnessFactor=roughness)
        mesh.visual = TextureVisuals(material=look)
        scene.add_geometry(mesh)

    def brighten(document: dict) -> None:
        for material in document["materials"]:
            *color, opacity = material["pbrMetallicRoughness"]["baseColorFactor"]
            material["pbrMetallicRoughness"]["baseColorFactor"] = [*map(_linear, color), opacity]

    return export_glb(scene, include_normals=True, tree_postprocessor=brighten)


def _linear(channel: float) -> float:
    """Convert sRGB to linear light, both 0..1, as glTF factors are linear."""
    value = channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
    return round(value, 6)


SHELL = Material((118, 126, 138), metallic=0.05, roughness=0.6)
"""Material of links and joints: darker than the payload, which should be seen first."""
DARK = Material((62, 68, 78), metallic=0.2, roughness=0.55)
STEEL = Material((132, 140, 152), metallic=0.2, roughness=0.4)
BRIGHT = Material((246, 247, 249), metallic=0.0, roughness=0.35)
"""Material of the grips."""


def link_parts() -> list[tuple[Trimesh, Material]]:
    """A bar from x = 0 to x = 1 (stretched to the link's length), and a dark keel under it."""
    return [(bar(0.0, 1.0, 0.062, 0.034, 0.012), SHELL), (moved(bar(0.0, 1.0, 0.03, 0.012, 0.004), z=-0.02), DARK)]


def joint_parts() -> list[tuple[Trimesh, Material]]:
    """A housing about z with a dark foot and cap, its middle at z = 0."""
    housing = drum(JOINT_RADIUS, -0.024, 0.024, 0.006)
    foot = drum(0.8 * JOINT_RADIUS, -0.05, -0.02, 0.003)
    cap = drum(0.5 * JOINT_RADIUS, 0.02, 0.033, 0.004, 24)
    return [(housing, SHELL), (joined(foot, cap), DARK)]


def base_parts() -> list[tuple[Trimesh, Material]]:
    """A pedestal on the floor, under joint 1."""
    plate = drum(0.115, 0.0, 0.014, 0.004, 40)
    column = turned([(0.088, 0.012), (0.066, 0.03), (0.06, 0.062), (0.0, 0.062)])
    bolts = [moved(drum(0.009, 0.012, 0.02, 0.002, 8), x=x, y=y) for x in (-0.07, 0.07) for y in (-0.07, 0.07)]
    return [(joined(plate, *bolts), DARK), (column, STEEL)]


def gripper_parts() -> list[tuple[Trimesh, Material]]:
    """A fork along x with the grip at the origin: two prongs above and below the beam, and the pin that it turns on."""
    palm = bar(-GRIPPER_LENGTH - 0.012, -GRIPPER_LENGTH + 0.012, 0.05, 0.05, 0.006)
    prongs = [moved(bar(-GRIPPER_LENGTH, 0.012, 0.03, 0.007, 0.003), z=z) for z in (-0.0205, 0.0205)]
    pin = drum(0.008, -0.03, 0.03, 0.002, 16)
    return [(palm, BRIGHT), (joined(*prongs), BRIGHT), (pin, DARK)]


MODELS = {"link": link_parts, "joint": joint_parts, "base": base_parts, "gripper": gripper_parts}


def write_models(folder: Path) -> None:
    """Write every part as a GLB file into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, parts in MODELS.items():
        (folder / f"{name}.glb").write_bytes(encode_glb(parts()))


if __name__ == "__main__":
    write_models(Path(__file__).resolve().parent.parent / "models")
