"""Writes solids as a binary glTF file (GLB), byte for byte the same for the same input."""

import json
import struct
from typing import NamedTuple

import numpy as np

from flexlab.lab.scene.solids import Solid

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
