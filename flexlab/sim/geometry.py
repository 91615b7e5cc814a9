"""Positions of arms and beam from samples, by forward kinematics and Hermite interpolation, for drawing only.

Pure NumPy on whole blocks of samples; the equations of motion do not use this file.
"""

import numpy as np

from flexlab.boundaries import held_coordinates
from flexlab.errors import ScenarioError
from flexlab.physics.beam import shape_functions as element_functions
from flexlab.scenario import Payload, Scenario
from flexlab.sim.samples import Samples
from flexlab.text import number_text


def arm_points(scenario: Scenario, samples: Samples) -> np.ndarray:
    """Base, second joint, third joint and grip of every arm, m, (N, arms, 4, 2), from the joint angles."""
    angle = np.cumsum(samples.joint_angle, axis=2)
    length = np.array([arm.link_length for arm in scenario.arms])
    base = np.array([arm.base for arm in scenario.arms])
    link = length[None, :, :, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = np.empty((len(samples), len(scenario.arms), 4, 2))
    points[:, :, 0] = base
    points[:, :, 1:] = base[None, :, None, :] + np.cumsum(link, axis=2)
    return points


def beam_points(scenario: Scenario, samples: Samples, count: int, exaggeration: float = 1.0) -> np.ndarray:
    """`count` points along the beam from s = -L/2 to L/2, deflection times `exaggeration`, m, (N, count, 2)."""
    position = np.linspace(-0.5, 0.5, count) * scenario.payload.length
    deflection = exaggeration * deflection_at(scenario.payload, samples.beam_coordinates, position)
    angle = samples.pose[:, 2:3]
    x = samples.pose[:, 0:1] + position * np.cos(angle) - deflection * np.sin(angle)
    y = samples.pose[:, 1:2] + position * np.sin(angle) + deflection * np.cos(angle)
    return np.stack([x, y], axis=-1)


def link_points(scenario: Scenario, pose: np.ndarray) -> np.ndarray:
    """Both ends of the virtual link at each pose (N, 3), m, (N, 2, 2): left grip, right grip."""
    half = 0.5 * scenario.payload.length * np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=-1)
    return np.stack([pose[:, :2] - half, pose[:, :2] + half], axis=1)


def deflection_at(payload: Payload, beam_coordinates: np.ndarray, position: np.ndarray) -> np.ndarray:
    """w(s) in m at material coordinates `position` (count,) in m, for free coordinates (N, n_q): (N, count)."""
    return beam_coordinates @ shape_functions(payload, position).T


def shape_functions(payload: Payload, position: np.ndarray) -> np.ndarray:
    """N(s) over the free coordinates at `position` (count,), m, (count, n_q); raises `ScenarioError` outside the beam."""
    half = 0.5 * payload.length
    if np.any(np.abs(position) > half * (1 + 1e-9)):
        worst = float(position[np.argmax(np.abs(position))])
        text = f"beam position = {number_text(worst)} m is not on the beam: choose −{number_text(half)} to {number_text(half)} m."
        raise ScenarioError([("beam_position", text)])
    nodes = payload.element_count + 1
    width = payload.length / payload.element_count
    along = (np.asarray(position, float) + half) / width
    element = np.clip(along.astype(int), 0, payload.element_count - 1)
    z = along - element
    rows = np.arange(len(z))
    full = np.zeros((len(z), 2 * nodes))
    for column, share in enumerate(element_functions(z, width)):
        full[rows, 2 * element + column] = share
    return np.delete(full, held_coordinates(payload.element_count, payload.boundary), axis=1)
