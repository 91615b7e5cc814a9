"""The drawn solids are closed, face outwards and lie where they belong; their files in web_assets are up to date."""

import runpy
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from flexlab.assets import web_assets_folder
from flexlab.lab.scene.arms import GRAB_HEIGHT, GRAB_WIDTH, GRIPPER_LENGTH, accent_ring, grab_bar, load_model
from flexlab.lab.scene.beam import SIDES, STATIONS, tube_faces, tube_vertices

made = runpy.run_path(str(web_assets_folder() / "make" / "models.py"))
MODELS, bar, drum = made["MODELS"], made["bar"], made["drum"]


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume, positive when the faces are counter-clockwise from outside."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def drawn(content: bytes) -> list[tuple[Any, ...]]:
    """Vertices, faces, normals and material of each mesh in a GLB file."""
    found = []
    for mesh in trimesh.load_scene(BytesIO(content), "glb", process=False).geometry.values():
        look = mesh.visual.material
        seen = *look.baseColorFactor, look.metallicFactor, look.roughnessFactor
        found.append((mesh.vertices, mesh.faces, mesh.vertex_normals, seen))
    return found


@pytest.mark.parametrize("name", list(MODELS))
def test_the_files_of_the_models_are_what_the_script_makes(name: str, tmp_path: Path) -> None:
    made["write_models"](tmp_path)
    shipped, now = (drawn(content) for content in (load_model(name), (tmp_path / f"{name}.glb").read_bytes()))
    assert len(shipped) == len(MODELS[name]())
    for mesh, other in zip(shipped, now, strict=True):
        for array, same in zip(mesh, other, strict=True):
            np.testing.assert_array_equal(array, same)


@pytest.mark.parametrize("solid", [solid for parts in MODELS.values() for solid, _ in parts()])
def test_faces_and_normals_point_the_same_way(solid: Any) -> None:
    a, b, c = (solid.vertices[solid.faces[:, corner]] for corner in range(3))
    flat = np.cross(b - a, c - a)
    area = np.linalg.norm(flat, axis=1)
    real = area > 1e-12
    assert real.any()
    agreement = np.einsum("ij,ij->i", flat[real] / area[real, None], solid.vertex_normals[solid.faces[real, 0]])
    assert agreement.min() > 0.5
    np.testing.assert_allclose(np.linalg.norm(solid.vertex_normals, axis=1), 1, atol=1e-9)


def test_the_accent_ring_faces_outwards_and_upwards() -> None:
    vertices, faces = accent_ring()
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    middle, flat = (a + b + c) / 3, np.cross(b - a, c - a)
    upward = flat[:, 2] > 1e-12
    assert upward.sum() == len(faces) / 2
    outward = np.einsum("ij,ij->i", flat[~upward, :2], middle[~upward, :2])
    assert outward.min() > 0


def test_bars_and_drums_have_the_volume_of_their_shape() -> None:
    assert volume(*grab_bar()) == pytest.approx(GRAB_WIDTH * GRAB_HEIGHT)
    box = bar(0.0, 2.0, 0.1, 0.05, 1e-6)
    assert volume(box.vertices, box.faces) == pytest.approx(2 * 0.1 * 0.05, rel=1e-3)
    can = drum(0.1, -0.1, 0.3, 1e-6, sections=200)
    assert volume(can.vertices, can.faces) == pytest.approx(np.pi * 0.01 * 0.4, rel=1e-3)


def test_the_beams_tube_is_closed_and_follows_its_line() -> None:
    s = np.linspace(0, 0.5, STATIONS)
    line = np.column_stack([s, 0.02 * np.sin(np.pi * s / 0.5)])
    vertices = tube_vertices(line, 0.01, 0.2)
    rings = vertices.reshape(STATIONS + 2, -1, 3)
    np.testing.assert_allclose(rings[1:-1].mean(axis=1)[:, :2], line, atol=1e-6)
    np.testing.assert_allclose(rings[1:-1].mean(axis=1)[:, 2], 0.2, atol=1e-6)
    section = SIDES / 2 * np.sin(2 * np.pi / SIDES) * 0.01**2
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert volume(vertices, tube_faces(STATIONS)) == pytest.approx(section * length, rel=1e-3)


def test_the_gripper_reaches_back_from_the_grip_by_its_length() -> None:
    points = np.concatenate([solid.vertices for solid, _ in MODELS["gripper"]()])
    assert points[:, 0].min() == pytest.approx(-GRIPPER_LENGTH - 0.012)
    assert np.abs(points[:, 1]).max() < 0.03
