"""From a scenario to the constants of the kernels: beam, plant and control law."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexlab.control.controller import Controller
from flexlab.control.law import BOUND_ESTIMATES, law_of
from flexlab.control.law_kernels import BelievedPayload, Control
from flexlab.control.observers.believed_plant import arm_records
from flexlab.numerics.linear_algebra import product, solve
from flexlab.physics.axial_load import (
    FASTEST_FOLLOWED,
    axial_modes,
    buckling_load,
    followed_loads,
    geometric_matrices,
    in_axial_modes,
)
from flexlab.physics.beam import BeamMatrices, BeamModes, beam_matrices, beam_modes, shape_row, undamped_modes
from flexlab.physics.grips import build_grips
from flexlab.physics.joints import build_joints
from flexlab.physics.law_input import MOST_ARMS
from flexlab.physics.mass_change import build_mass_change
from flexlab.physics.plant import NO_HAND, Plant
from flexlab.scenario import Payload, Scenario


class Beam(NamedTuple):
    """Matrices and kept modes of a payload."""

    matrices: BeamMatrices
    modes: BeamModes
    kappa: np.ndarray
    """hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g over all modes, (3,)."""
    axial: np.ndarray
    """As `Plant.axial`, without a hand."""


KNOWN_BEAMS = 8
"""Number of beams that are cached: a scenario's beam is needed in many places."""


@lru_cache(KNOWN_BEAMS)
def build_beam(payload: Payload) -> Beam:
    """Matrices and modes of a payload, shared and read-only; modes in ascending frequency within each damping block."""
    matrices = _matrices(payload)
    omega, V = undamped_modes(matrices)
    loads = product(V.T, np.stack([matrices.h, matrices.g], axis=1))
    kept = slice(0, payload.mode_count)
    omega, V = omega[kept], V[:, kept]
    modes = beam_modes(omega, V, payload.damping.modal(omega, V))
    return Beam(matrices, modes, _load_forms(loads), _axial(payload, modes))


def _load_forms(loads: np.ndarray) -> np.ndarray:
    """hᵀh, hᵀg, gᵀg of loads (n, 2) on mass-normalised modes, (3,)."""
    return product(loads.T, loads)[[0, 0, 1], [0, 1, 1]]


def _axial(payload: Payload, modes: BeamModes) -> np.ndarray:
    """`Plant.axial` of a payload with these modes."""
    if payload.axial_load == "none":
        return np.zeros((4, 0, 0))
    matrices = geometric_matrices(payload.length, payload.linear_density, payload.element_count, payload.boundary)
    in_modes = [in_axial_modes(G, modes.omega, modes.V) for G in matrices]
    return np.stack([*in_modes, np.zeros_like(in_modes[0])])


def _matrices(payload: Payload, length: float = 1, density: float = 1) -> BeamMatrices:
    """Beam matrices with length and density scaled by factors."""
    return beam_matrices(
        payload.length * length,
        payload.linear_density * density,
        payload.bending_stiffness,
        payload.element_count,
        payload.boundary,
    )


def nodal_damping_matrix(beam: Beam) -> np.ndarray:
    """D over nodal coordinates, (n_q, n_q): M V (VᵀDV) Vᵀ M."""
    MV = product(beam.matrices.M_q, beam.modes.V)
    return product(product(MV, beam.modes.D), MV.T)


def build_plant(scenario: Scenario, beam: Beam, arms: np.ndarray | None = None) -> Plant:
    """Arms and payload of a scenario; `arms`: their records, if known."""
    payload, (matrices, modes, *_) = scenario.payload, beam
    loads = product(modes.V.T, np.stack([matrices.h, matrices.g], axis=1))
    middle = payload_row(payload, 0.0)
    bend = solve(matrices.K_F, np.stack([matrices.h, matrices.g], axis=1))
    loosest = middle if len(scenario.arms) == 2 else payload_row(payload, payload.length / 2)
    shapes = product(np.stack([middle, loosest]), modes.V)
    damped, stiffness = product(modes.D, loads), modes.omega * modes.omega
    followed = (modes.omega <= FASTEST_FOLLOWED) & (modes.D.diagonal() <= FASTEST_FOLLOWED)
    axial = (axial_modes(modes.omega), *followed_loads(followed, modes.D, loads))
    further = (stiffness, *shapes, np.zeros_like(stiffness), *axial)
    plant = Plant(
        arms=arm_records(scenario.arms, payload.length) if arms is None else arms,
        m=matrices.m,
        I=matrices.I,
        gravity=scenario.gravity,
        modal=np.concatenate([loads.T, damped.T, further]),
        damping=modes.D,
        block_start=modes.block_start,
        kappa=_load_forms(loads),
        shapes=np.ascontiguousarray(modes.V.T),
        compliance=-product(middle, bend),
        pull=np.array(NO_HAND),
        length=payload.length,
        buckling_load=buckling_load(payload.length, payload.bending_stiffness, payload.boundary),
        axial=None,
        joints=None,
        mass_change=None,
        grips=None,
    )
    return extended(plant, scenario, beam)


def extended(plant: Plant, scenario: Scenario, beam: Beam) -> Plant:
    """A plant with the extensions that a scenario of the same beam and arms adds to the paper's plant."""
    extensions = {
        "joints": build_joints(scenario.joints, scenario.controller.model, len(scenario.arms)),
        "mass_change": build_mass_change(scenario.payload.mass_change),
        "grips": build_grips(scenario.grips, len(scenario.arms)),
    }
    is_papers = scenario.payload.axial_load == "none" and all(part is None for part in extensions.values())
    known = beam.axial.copy() if plant.axial is None else plant.axial
    return plant._replace(axial=None if is_papers else known, **extensions)


def payload_row(payload: Payload, s: float) -> np.ndarray:
    """N(s) of a payload at the material coordinate s in [-L/2, L/2], m, (n_q,)."""
    return shape_row(s, payload.length, payload.element_count, payload.boundary)


def build_control(scenario: Scenario, beam: Beam) -> Control:
    """The control law of a scenario, with the payload that the controller believes in."""
    settings, law = scenario.controller, law_of(scenario.controller)
    factors = (settings.model.length_factor, settings.model.linear_density_factor)
    believed, kappa = beam.matrices, beam.kappa
    if factors != (1.0, 1.0):
        believed = _matrices(scenario.payload, *factors)
        loads = np.stack([believed.h, believed.g], axis=1)
        kappa = product(loads.T, solve(believed.M_q, loads))[[0, 0, 1], [0, 1, 1]]
    kernel, fastest_rate = law.addresses
    slices, arm_count = law.memory_slices(len(scenario.arms)), len(scenario.arms)
    return Control(
        law=kernel,
        fastest_rate=fastest_rate,
        gains=law.gains(scenario),
        memory_size=law.memory_size(arm_count),
        signal_count=law.signal_count,
        estimates=slices[BOUND_ESTIMATES.name].start if BOUND_ESTIMATES.name in slices else -1,
        sliding_slope=law.sliding_slope(settings),
        payload=BelievedPayload(believed.m, believed.I, kappa.copy(), settings.model.mass_change_factor),
        share=load_shares(settings, arm_count),
        internal_force=settings.wanted_internal_force if arm_count == MOST_ARMS and law.drives else 0.0,
        drives=law.drives,
        torque_limit=np.full(3, np.inf) if settings.torque_limit is None else np.array(settings.torque_limit),
        limited=settings.torque_limit is not None,
        sampled=settings.control_period is not None,
    )


def load_shares(settings: Controller, arm_count: int) -> np.ndarray:
    """Each arm's share of the common part, 1, (2,)."""
    return np.array([settings.load_share, 1 - settings.load_share]) if arm_count == MOST_ARMS else np.ones(MOST_ARMS)
