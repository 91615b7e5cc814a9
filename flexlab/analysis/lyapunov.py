"""The tracking part of the proof's Lyapunov function, from samples.

The other part, ½ Σ k_j (b_j - b̂_j)², contains the true bounds b_j, which are unknown.
"""

import numpy as np

from flexlab.scenario import Arm, Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.samples import Samples

MASS = "payload_mass"
"""Signal of a payload whose mass changes."""


def tracking_energy(scenario: Scenario, samples: Samples) -> np.ndarray:
    """½ sᵀ(M̄1 + M̄2 + A11 - A12 A22⁻¹A21)s with A at q = 0, J (N,)."""
    s, angle = samples.sliding_variable, samples.pose[:, 2]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    beam = build_beam(scenario.payload)
    m, inertia, (hh, hg, gg) = beam.matrices.m, beam.matrices.I, map(float, beam.kappa)
    lateral = np.einsum("ni,ni->n", s[:, :2], across)
    rigid = m * (s[:, 0] ** 2 + s[:, 1] ** 2) + inertia * s[:, 2] ** 2
    total = 0.5 * (rigid - hh * lateral**2 - 2 * hg * lateral * s[:, 2] - gg * s[:, 2] ** 2)
    if MASS in samples.own:  # The payload's whole part is proportional to its mass.
        total *= samples.own[MASS] / m
    half = 0.5 * scenario.payload.length
    for index, arm in enumerate(scenario.arms):
        side = -1 if index == 0 else 1
        grip_rate = s[:, :2] + side * half * s[:, 2:] * across
        total += _arm(arm, samples.joint_angle[:, index], grip_rate, s[:, 2])
    return total


def _arm(arm: Arm, joint_angle: np.ndarray, grip_rate: np.ndarray, turn_rate: np.ndarray) -> np.ndarray:
    """½ θ̇ᵀMθ̇ of one arm whose grip moves with `grip_rate` (N, 2) m/s and turns with `turn_rate` (N,) rad/s."""
    angle = np.cumsum(joint_angle, axis=1)
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=2)
    l1, l2, l3 = arm.link_length
    wrist = grip_rate - l3 * turn_rate[:, None] * normal[:, 2]
    # wrist = l1 φ̇1 n1 + l2 φ̇2 n2, solved by hand: the library's solver would wake all cores.
    elbow = normal[:, 0, 0] * normal[:, 1, 1] - normal[:, 0, 1] * normal[:, 1, 0]
    first = (wrist[:, 0] * normal[:, 1, 1] - wrist[:, 1] * normal[:, 1, 0]) / (l1 * elbow)
    second = (normal[:, 0, 0] * wrist[:, 1] - normal[:, 0, 1] * wrist[:, 0]) / (l2 * elbow)
    rate = np.column_stack([first, second, turn_rate])
    joint = np.zeros_like(wrist)
    energy = np.zeros(len(wrist))
    for link in range(3):
        center = joint + arm.link_center[link] * rate[:, link, None] * normal[:, link]
        energy += arm.link_mass[link] * np.einsum("ni,ni->n", center, center)
        energy += arm.inertia[link] * rate[:, link] ** 2
        joint = joint + arm.link_length[link] * rate[:, link, None] * normal[:, link]
    return 0.5 * energy
