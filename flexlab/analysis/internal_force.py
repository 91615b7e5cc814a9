"""The internal force of a run by Eq. (26), from x, q and u alone, without ẍ."""

import numpy as np

from flexlab.arguments import whole_number
from flexlab.errors import StudyError
from flexlab.physics.arm import arm_velocity_terms
from flexlab.physics.dynamics import configure_arms
from flexlab.physics.internal_force import internal_force_by_eq_26
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import make_workspace
from flexlab.sim.build import build_beam, build_plant, nodal_damping_matrix
from flexlab.sim.samples import Run


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
        configure_arms(plant, pose, terms, workspace.fault)
        c, s = terms.trig
        for i in range(2):
            arm_velocity_terms(plant.arms[i], c, s, *map(float, rate), terms.J[i], terms.direction[i], terms.C[i])
        own = beam.matrices.with_mass(find_mass_at(plant, run.time[k], workspace))
        motion = (run.arm_input[k], pose, rate, run.beam_coordinates[k], run.beam_rates[k])
        found.append(internal_force_by_eq_26(own, D, terms.M, terms.C, terms.G, *motion, scenario.gravity))
    return np.array(found)
