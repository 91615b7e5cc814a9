"""What the paper's equations make of a run's samples: the internal force by Eq. (26), and the proof's Lyapunov function."""

import numpy as np

from flexlab.arguments import whole_number
from flexlab.errors import StudyError
from flexlab.physics.arm import arm_velocity_terms
from flexlab.physics.dynamics import arms_at
from flexlab.physics.internal_force import internal_force_by_eq_26
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import make_workspace
from flexlab.scenario import Arm, Scenario
from flexlab.sim.build import build_beam, build_plant, nodal_damping_matrix
from flexlab.sim.samples import Run, Samples


def internal_force_eq_26(run: Run, every: int = 1) -> np.ndarray:
    """F_i by Eq. (26) at every `every`-th sample of a run with two arms, N, N, N·m, (samples, 2, 3).

    `run.internal_force` is the same force by Eqs. (13)-(15), from the grip forces and the simulated ẍ; Eq. (26) computes ẍ anew
    from dense matrices in nodal coordinates. Signs are as in `run.internal_force`, opposite to the paper's. A payload that is
    filled or emptied has its mass at each instant. Raises `StudyError` for a run that was changed or pulled, one arm, omitted
    modes, compliant grips, a beam that feels the force along it, or no samples.
    """
    if not isinstance(run, Run):
        raise StudyError(f"{run!r:.60} is not a run: give one from flexlab.simulate or flexlab.read.")
    scenario, step = run.scenario, whole_number("every", every, 1)
    course = getattr(run, "_course", None)
    if course is not None and course.is_changed:
        raise StudyError(
            "Eq. (26) holds for one scenario without outside forces, and this run was changed or pulled: "
            "use run.internal_force."
        )
    if len(scenario.arms) != 2:
        raise StudyError("Eq. (26) needs two arms: a single one has nothing to press against.")
    if scenario.payload.mode_count is not None:
        raise StudyError("Eq. (26) is in nodal coordinates: leave payload.mode_count out, so that all modes are kept.")
    if scenario.grips.active:
        raise StudyError(
            "Eq. (26) holds for rigid grips: for compliant ones run.internal_force gives the forces of springs and dampers."
        )
    if scenario.payload.axial_load != "none":
        raise StudyError(
            "Eq. (26) holds for the paper's beam, which feels no force along it (payload.axial_load): "
            "use run.internal_force for this one."
        )
    if len(run) == 0:
        raise StudyError("The run has no samples.")
    beam = build_beam(scenario.payload)
    plant, D = build_plant(scenario, beam), nodal_damping_matrix(beam)
    workspace = make_workspace(len(plant.arms), plant.modal.shape[1])
    terms = workspace.arm
    found = []
    for k in range(0, len(run), step):
        pose, rate = run.pose[k].copy(), run.pose_rate[k]
        arms_at(plant, pose, workspace)
        c, s = terms.trig
        for i in range(2):
            arm_velocity_terms(plant.arms[i], c, s, *map(float, rate), terms.J[i], terms.direction[i], terms.C[i])
        own = beam.matrices.with_mass(find_mass_at(plant, run.time[k], workspace))
        motion = (run.arm_input[k], pose, rate, run.beam_coordinates[k], run.beam_rates[k])
        found.append(internal_force_by_eq_26(own, D, terms.M, terms.C, terms.G, *motion, scenario.gravity))
    return np.array(found)


MASS = "payload_mass"
"""Signal of a payload whose mass changes."""


def tracking_energy(scenario: Scenario, samples: Samples) -> np.ndarray:
    """The tracking part of the Lyapunov function, ½ sᵀ(M̄1 + M̄2 + A11 - A12 A22⁻¹A21)s with A at q = 0, J (N,).

    The other part, ½ Σ k_j (b_j - b̂_j)², contains the true bounds b_j, which are unknown.
    """
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
