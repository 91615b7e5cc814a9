"""Simple solids as triangle meshes with crisp edges, and as binary glTF files (GLB): what arms and beam are made of."""

import json
import struct
from typing import NamedTuple

import numpy as np

CORNER_STEPS = 3
"""Facets per rounded corner of a bar: enough to catch the light, few enough to draw fast without a graphics card."""


class Solid(NamedTuple):
    """A triangle mesh: `vertices` (V, 3) m, `normals` (V, 3) unit, `faces` (F, 3) indices, outside counter-clockwise."""

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray


def joined(*solids: Solid) -> Solid:
    """All solids as one mesh."""
    starts = np.cumsum([0] + [len(solid.vertices) for solid in solids])
    return Solid(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.normals for solid in solids]),
        np.concatenate([solid.faces + start for solid, start in zip(solids, starts, strict=False)]),
    )


def moved(solid: Solid, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
    """The solid shifted by (x, y, z) m."""
    return solid._replace(vertices=solid.vertices + np.array([x, y, z]))


def turned(profile: list[tuple[float, float]], sections: int = 32) -> Solid:
    """A body of revolution about z; `profile` lists (radius, height) in m from bottom to top, edges stay crisp."""
    angle = np.linspace(0, 2 * np.pi, sections + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    strips = []
    for (r0, z0), (r1, z1) in zip(profile[:-1], profile[1:], strict=True):
        slant = np.hypot(r1 - r0, z1 - z0)
        outward, upward = (z1 - z0) / slant, (r0 - r1) / slant
        normals = np.column_stack([circle * outward, np.full(sections + 1, upward)])
        rings = [np.column_stack([circle * r, np.full(sections + 1, z)]) for r, z in ((r0, z0), (r1, z1))]
        strips.append(Solid(np.concatenate(rings), np.concatenate([normals, normals]), _strip_faces(sections + 1)))
    return joined(*strips)


def drum(radius: float, bottom: float, top: float, chamfer: float, sections: int = 32) -> Solid:
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


def ring(inner: float, outer: float, bottom: float, top: float, sections: int = 32) -> Solid:
    """A flat ring about z, m, closed on top and outside (its inside is never seen)."""
    return turned([(outer, bottom), (outer, top), (inner, top)], sections)


def bar(start: float, end: float, width: float, height: float, corner: float) -> Solid:
    """A bar along x from `start` to `end` with a rounded cross-section `width` (y) by `height` (z), closed ends, m."""
    outline, normals = _rounded_rectangle(width, height, corner)
    count = len(outline)
    sides = Solid(
        np.concatenate([np.insert(outline, 0, x, axis=1) for x in (start, end)]),
        np.tile(np.insert(normals, 0, 0.0, axis=1), (2, 1)),
        _strip_faces(count),
    )
    return joined(sides, _cap(outline, end, 1.0), _cap(outline[::-1], start, -1.0))


def _cap(outline: np.ndarray, x: float, side: float) -> Solid:
    vertices = np.insert(outline, 0, x, axis=1)
    corners = np.arange(1, len(outline) - 1)
    faces = np.column_stack([np.zeros_like(corners), corners, corners + 1])
    return Solid(vertices, np.tile([side, 0.0, 0.0], (len(outline), 1)), faces)


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


MAGIC, VERSION = 0x46546C67, 2
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
FLOAT, UNSIGNED_INT = 5126, 5125
VERTEX_BUFFER, INDEX_BUFFER = 34962, 34963


class Material(NamedTuple):
    """`color`: sRGB 0..255; `metallic` and `roughness` 0..1 as in glTF."""

    color: tuple[int, int, int]
    metallic: float = 0.1
    roughness: float = 0.6


def encode_glb(parts: list[tuple[Solid, Material]]) -> bytes:
    """A GLB file with one mesh per (solid, material) pair, positions in m, z up as flexlab and viser have it."""
    binary = bytearray()
    document: dict = {
        "asset": {"version": "2.0", "generator": "flexlab"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(parts)))}],
        "nodes": [{"mesh": index} for index in range(len(parts))],
        "meshes": [],
        "materials": [_material(material) for _, material in parts],
        "accessors": [],
        "bufferViews": [],
    }
    for index, (solid, _) in enumerate(parts):
        position = _append(document, binary, solid.vertices.astype("<f4"), FLOAT, VERTEX_BUFFER)
        normal = _append(document, binary, solid.normals.astype("<f4"), FLOAT, VERTEX_BUFFER)
        faces = _append(document, binary, solid.faces.astype("<u4").reshape(-1), UNSIGNED_INT, INDEX_BUFFER)
        primitive = {"attributes": {"POSITION": position, "NORMAL": normal}, "indices": faces, "material": index}
        document["meshes"].append({"primitives": [primitive]})
    document["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
    chunks += struct.pack("<II", len(binary), BINARY_CHUNK) + bytes(binary)
    return struct.pack("<III", MAGIC, VERSION, 12 + len(chunks)) + chunks


def _append(document: dict, binary: bytearray, data: np.ndarray, kind: int, target: int) -> int:
    """Adds an array to the buffer; returns its accessor's number. float32 and uint32 keep the buffer 4-byte aligned."""
    view = {"buffer": 0, "byteOffset": len(binary), "byteLength": data.nbytes, "target": target}
    accessor = {
        "bufferView": len(document["bufferViews"]),
        "componentType": kind,
        "count": len(data),
        "type": "SCALAR" if data.ndim == 1 else "VEC3",
    }
    if data.ndim == 2:
        accessor["min"], accessor["max"] = data.min(axis=0).tolist(), data.max(axis=0).tolist()
    binary += data.tobytes()
    document["bufferViews"].append(view)
    document["accessors"].append(accessor)
    return len(document["accessors"]) - 1


def _material(material: Material) -> dict:
    linear = [_linear(channel / 255) for channel in material.color]
    return {
        "pbrMetallicRoughness": {
            "baseColorFactor": [*linear, 1.0],
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        }
    }


def _linear(channel: float) -> float:
    """sRGB to linear light, both 0..1: glTF factors are linear."""
    value = channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
    return round(value, 6)
