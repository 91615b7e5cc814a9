"""Sensors: encoders measure the pose by joint angles in whole counts, strain gauges the load moments hᵀq and gᵀq."""

import numpy as np

from flexlab.compiled import compiled, inlined
from flexlab.numerics.elementary import sin_cos
from flexlab.numerics.linear_algebra import product, solve
from flexlab.physics.arm import joint_angles
from flexlab.physics.beam import BeamMatrices, gauss_rule, shape_row
from flexlab.physics.dynamics import configure_arms, find_velocities
from flexlab.physics.grips import own_pose, place_each, place_rigidly
from flexlab.physics.plant import grips_start, joints_start

GAUGES_PER_HALF = 2
"""Gauges on each half of the beam: exact for products of two linear functions on it, and so for hᵀq of one or two elements."""


def gauge_places(length: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions s of the gauges, m, (4,), and the weights of their quadrature over the beam, m, (4,)."""
    points, weights = gauss_rule(GAUGES_PER_HALF)
    half = length / 2
    places = np.concatenate([(points - 1) * half / 2, (points + 1) * half / 2])
    return places, np.tile(weights * half / 2, 2)


def strain_rows(places: np.ndarray, length: float, thickness: float, element_count: int, boundary: str) -> np.ndarray:
    """Rows R with strains R q = -½ t w''(s_j), 1, for gauges at s_j = `places`, m; (gauges, n_q)."""
    rows = [shape_row(s, length, element_count, boundary, derivative=2) for s in places]
    return -thickness / 2 * np.array(rows)


def load_moments(beam: BeamMatrices, EI: float, thickness: float, weights: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Weights W, kg·m and kg·m², (2, gauges), for the load moments from strains: W (R q) = (hᵀq, gᵀq).

    hᵀq = (K_F⁻¹h)ᵀ K_F q = ∫ EI b''(s) w''(s) ds, where b = N K_F⁻¹h is the beam bent by the load h; the integral is the
    quadrature with `weights` over the gauges, and strains stand for the curvatures b'' and w''.
    """
    bent = solve(beam.K_F, np.stack([beam.h, beam.g], axis=1))
    return (4 * EI / (thickness * thickness)) * product(rows, bent).T * weights


def encoder_counts(counts: tuple[float, ...]) -> np.ndarray:
    """`Joints.count` for these counts per turn (3,)."""
    return np.array([2 * np.pi / number if number > 0 else 0.0 for number in counts])


@inlined
def counted(angle, count):
    """Reading of an encoder, rad, at an angle, rad; `count`: angle of one count, 0: exact."""
    return count * np.floor(angle / count + 0.5) if count > 0 else angle


@inlined
def pose_of_counts(count, grips, arms, at, ws, pose):
    """Fill pose (3,) with the encoders' reading at the payload's pose `at` (3,), after `configure_arms`.

    With compliant grips it is the mean of the arms' poses.
    """
    terms, angle = ws.arm, ws.tau
    share = 1.0 / len(arms)
    pose[0] = pose[1] = pose[2] = 0.0
    for i in range(len(arms)):
        arm = arms[i]
        _, _, theta = own_pose(grips, at, ws, i)
        joint_angles(theta, arm, terms.direction[i], angle)
        first = counted(angle[0], count[0])
        second = first + counted(angle[1], count[1])
        link = second + counted(angle[2], count[2]) - (np.pi if arm.tip < 0 else 0.0)
        s1, c1 = sin_cos(first)
        s2, c2 = sin_cos(second)
        s, c = sin_cos(link)
        pose[0] += share * (arm.base_x + arm.l1 * c1 + arm.l2 * c2 - arm.reach * c)
        pose[1] += share * (arm.base_y + arm.l1 * s1 + arm.l2 * s2 - arm.reach * s)
        pose[2] += share * link


@inlined
def read_encoders(joints, grips, arms, period, states, ws, now):
    """Replace the exact now.x and now.v by encoder readings, if there are encoders, after `configure_arms`.

    period: T_c, s; states: the joints' states in y, which keep the reading.
    """
    if joints is None:
        return
    if joints.reading >= 0:
        reading, before = ws.momentum, states[joints.reading : joints.reading + 3]
        pose_of_counts(joints.count, grips, arms, now.x, ws, reading)
        for a in range(3):
            now.x[a], now.v[a] = reading[a], (reading[a] - before[a]) / period
            before[a] = reading[a]


@compiled
def begin_reading(plant, period, y, ws):
    """Store in y the encoder reading of one control period, s, ago, for a pose that moved at its present rate.

    If the arms cannot have been there, store the present reading.
    """
    find_velocities(plant, y, ws)
    _begin_reading(plant.joints, plant, period, y, ws)


@inlined
def _begin_reading(joints, plant, period, y, ws):
    if joints is None:
        return
    if joints.reading >= 0:
        before, first = ws.momentum, joints_start(plant) + joints.reading
        _go_back(plant.grips, plant, period, y, ws, before)
        pose_of_counts(joints.count, plant.grips, plant.arms, before, ws, y[first : first + 3])


@inlined
def _go_back(grips, plant, period, y, ws, before):
    """Configure the arms where they were one `period`, s, ago, or else where they are, and fill before (3,) with that pose."""
    if grips is None:
        for a in range(3):
            before[a] = y[a] - period * ws.velocity[a]
        if configure_arms(plant, before, ws.arm, ws.fault) != 0:
            configure_arms(plant, y[0:3], ws.arm, ws.fault)
            before[2] = y[2]
    else:
        states = y[grips_start(plant) :]
        if place_each(grips, plant.arms, plant.gravity, y[0:3], states, -period, ws) != 0:
            place_each(grips, plant.arms, plant.gravity, y[0:3], states, 0.0, ws)


@compiled
def encoder_pose(plant, pose, ws, reading):
    """Fill reading (3,) with the encoders' reading at a pose (3,) that the arms can take; returns a fault code."""
    code = configure_arms(plant, pose, ws.arm, ws.fault)
    if code == 0:
        place_rigidly(plant.grips, pose, ws)
        pose_of_counts(plant.joints.count, plant.grips, plant.arms, pose, ws, reading)
    return code
