"""Drawing geometry against closed forms: a cubic is exact, a folded arm is where trigonometry puts it."""

from dataclasses import fields

import numpy as np
import pytest

from flexlab.boundaries import HELD_COORDINATES, held_coordinates
from flexlab.errors import ScenarioError
from flexlab.scenario import Payload, Scenario
from flexlab.scenario.payload import FIXED_COORDINATES
from flexlab.sim.geometry import (
    arm_points,
    beam_points,
    deflection_at,
    link_points,
    shape_functions,
)
from flexlab.sim.samples import Samples


def block(**given: np.ndarray) -> Samples:
    """Samples in which only the `given` signals matter."""
    count = len(next(iter(given.values())))
    return Samples(**{field.name: given.get(field.name, np.zeros(count)) for field in fields(Samples)})


@pytest.mark.parametrize("boundary", FIXED_COORDINATES)
def test_held_coordinates_agree_with_the_scenario(boundary: str) -> None:
    assert len(HELD_COORDINATES[boundary]) == FIXED_COORDINATES[boundary]


@pytest.mark.parametrize(
    ("boundary", "cubic"),
    [
        ("pinned-pinned", [1.0, -1.5, 0.5, 0.0]),
        ("clamped-pinned", [-1.0, 1.0, 0.0, 0.0]),
        ("pinned-clamped", [1.0, -2.0, 1.0, 0.0]),
        ("clamped-free", [0.3, 0.7, 0.0, 0.0]),
    ],
)
@pytest.mark.parametrize("elements", [2, 3, 8])
def test_a_cubic_that_meets_the_boundary_is_interpolated_exactly(boundary, cubic, elements) -> None:
    payload = Payload(length=0.8, element_count=elements, boundary=boundary)
    node = np.linspace(0, 1, elements + 1)
    nodal = np.stack([np.polyval(cubic, node), np.polyval(np.polyder(cubic), node) / payload.length], axis=1).ravel()
    position = np.linspace(-0.4, 0.4, 37)
    found = deflection_at(payload, np.delete(nodal, held_coordinates(elements, boundary))[None], position)[0]
    np.testing.assert_allclose(found, np.polyval(cubic, position / 0.8 + 0.5), rtol=0, atol=1e-14)


@pytest.mark.parametrize("boundary", FIXED_COORDINATES)
def test_free_coordinates_are_deflections_and_slopes_of_nodes_and_held_ones_are_zero(boundary) -> None:
    payload = Payload(length=0.8, element_count=3, boundary=boundary)
    free = np.random.default_rng(1).normal(size=(1, payload.coordinate_count))
    nodal = np.zeros(8)
    nodal[[i for i in range(8) if i not in held_coordinates(3, boundary)]] = free[0]
    node = np.linspace(-0.4, 0.4, 4)
    np.testing.assert_allclose(deflection_at(payload, free, node)[0], nodal[0::2], rtol=0, atol=1e-14)
    step = 1e-6
    left, right = np.maximum(node - step, -0.4), np.minimum(node + step, 0.4)
    rise = deflection_at(payload, free, right)[0] - deflection_at(payload, free, left)[0]
    np.testing.assert_allclose(rise / (right - left), nodal[1::2], atol=1e-4)


def test_the_papers_second_coordinate_is_the_midspan_deflection() -> None:
    row = shape_functions(Payload(), np.array([0.0]))[0]
    np.testing.assert_allclose(row, [0, 1, 0, 0], rtol=0, atol=1e-15)


def test_a_point_off_the_beam_is_refused_by_name() -> None:
    with pytest.raises(ScenarioError, match=r"beam position = 0\.3 m .* −0\.25 to 0\.25 m"):
        shape_functions(Payload(), np.array([0.3]))


def test_arm_points_add_relative_angles() -> None:
    angle = np.array([[[0.5 * np.pi, -0.5 * np.pi, 0.0], [np.pi, 0.5 * np.pi, -np.pi]]])
    points = arm_points(Scenario(), block(joint_angle=angle))
    np.testing.assert_allclose(points[0, 0], [[-0.5, 0], [-0.5, 0.7], [0.1, 0.7], [0.3, 0.7]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(points[0, 1], [[0.5, 0], [-0.2, 0], [-0.2, -0.6], [-0.2, -0.4]], rtol=0, atol=1e-15)


def test_beam_points_run_from_grip_to_grip_and_bend_along_e2() -> None:
    pose = np.array([[0.1, 0.8, 0.3], [0.0, 0.75, 0.0]])
    bent = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 0.002, 0.0, 0.0]])
    points = beam_points(Scenario(), block(pose=pose, beam_coordinates=bent), count=5, exaggeration=10)
    np.testing.assert_allclose(points[:, [0, -1]], link_points(Scenario(), pose), rtol=0, atol=1e-15)
    np.testing.assert_allclose(points[0, 2], pose[0, :2], rtol=0, atol=1e-15)
    np.testing.assert_allclose(points[1, 2], [0.0, 0.77], rtol=0, atol=1e-15)


def test_an_empty_block_has_no_points() -> None:
    empty = block(
        time=np.empty(0), pose=np.empty((0, 3)), beam_coordinates=np.empty((0, 4)), joint_angle=np.empty((0, 2, 3))
    )
    assert arm_points(Scenario(), empty).shape == (0, 2, 4, 2)
    assert beam_points(Scenario(), empty, 9).shape == (0, 9, 2)
