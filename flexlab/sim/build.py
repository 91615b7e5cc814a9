"""From a scenario's words to the kernels' symbols."""

from typing import NamedTuple

import numpy as np

from flexlab.control.adaptive_sliding_mode import AdaptiveGains
from flexlab.control.law import (
    ADAPTIVE_SLIDING_MODE,
    COMPUTED_TORQUE,
    NONE,
    PROPORTIONAL_DERIVATIVE,
    VIBRATION_DAMPING,
    Control,
)
from flexlab.control.load_sharing import BelievedPayload
from flexlab.control.proportional_derivative import FeedbackGains
from flexlab.control.trajectory import Sine, desired_motion
from flexlab.physics.arm import ARM, arm_constants
from flexlab.physics.beam import (
    BeamMatrices,
    BeamModes,
    beam_matrices,
    beam_modes,
    modal_damping,
    nodal_damping,
    shape_row,
    stiffness_damping,
    undamped_modes,
)
from flexlab.physics.plant import ON_BEAM, Plant
from flexlab.scenario import Payload, Scenario
from flexlab.sim.closed_loop import System


class Beam(NamedTuple):
    """The payload of a scenario with its kept modes."""

    matrices: BeamMatrices
    modes: BeamModes
    kappa: np.ndarray
    """hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g over all modes, (3,)."""


def build_beam(payload: Payload) -> Beam:
    """Matrices and modes of a payload; modes in ascending frequency within each damping block."""
    matrices = _matrices(payload)
    omega, V = undamped_modes(matrices)
    h, g = V.T @ matrices.h, V.T @ matrices.g
    kept = slice(0, payload.mode_count)
    omega, V = omega[kept], V[:, kept]
    damping = payload.damping
    if damping.kind == "nodal":
        D = nodal_damping(V, damping.coefficient)
    elif damping.kind == "stiffness":
        D = stiffness_damping(omega, damping.coefficient)
    else:
        D = modal_damping(omega, damping.ratio)
    return Beam(matrices, beam_modes(omega, V, D), np.array([h @ h, h @ g, g @ g]))


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
    MV = beam.matrices.M_q @ beam.modes.V
    return MV @ beam.modes.D @ MV.T


def build_plant(scenario: Scenario, beam: Beam) -> Plant:
    """Arms and payload of a scenario."""
    payload, (matrices, modes, _) = scenario.payload, beam
    h, g = modes.V.T @ matrices.h, modes.V.T @ matrices.g
    middle = payload_row(payload, 0.0)
    bend = np.linalg.solve(matrices.K_F, np.stack([matrices.h, matrices.g], axis=1))
    loosest = middle if len(scenario.arms) == 2 else payload_row(payload, payload.length / 2)
    modal = np.stack(
        [h, g, modes.D @ h, modes.D @ g, modes.omega**2, modes.V.T @ middle, modes.V.T @ loosest, np.zeros_like(h)]
    )
    arms = np.zeros(len(scenario.arms), ARM)
    for i, arm in enumerate(scenario.arms):
        side = -1 if i == 0 else 1
        arms[i] = arm_constants(
            arm.base,
            arm.link_mass,
            arm.link_length,
            arm.link_center,
            arm.inertia,
            arm.elbow,
            side,
            payload.length,
        )
    return Plant(
        arms=arms,
        m=matrices.m,
        I=matrices.I,
        gravity=scenario.gravity,
        modal=modal,
        damping=modes.D,
        block_start=modes.block_start,
        kappa=np.array([h @ h, h @ g, g @ g]),
        V=modes.V,
        compliance=-middle @ bend,
        pull=np.array([0.0, 0.0, 0.0, 0.0, ON_BEAM, 0.0]),
    )


def payload_row(payload: Payload, s: float) -> np.ndarray:
    """N(s) of a payload at the material coordinate s in [-L/2, L/2], m, (n_q,)."""
    return shape_row(s, payload.length, payload.element_count, payload.boundary)


KINDS = {
    "none": NONE,
    "adaptive-sliding-mode": ADAPTIVE_SLIDING_MODE,
    "computed-torque": COMPUTED_TORQUE,
    "pd": PROPORTIONAL_DERIVATIVE,
    "vibration-damping": VIBRATION_DAMPING,
}


def _triple(value: float | tuple[float, ...]) -> np.ndarray:
    return np.array(np.broadcast_to(value, 3), dtype=float)


def build_control(scenario: Scenario, beam: Beam) -> Control:
    """The control law of a scenario, with the payload as the controller believes it to be."""
    law, model = scenario.controller, scenario.controller.model
    adaptive = AdaptiveGains(np.zeros(3), np.zeros(3), 1.0, np.ones(3))
    feedback = FeedbackGains(np.zeros(3), np.zeros(3))
    vibration = np.zeros(2)
    if law.kind in ("adaptive-sliding-mode", "vibration-damping"):
        gains = (_triple(law.feedback_gain), _triple(law.sliding_slope), law.boundary_layer, np.array(law.adaptation))
        adaptive = AdaptiveGains(*gains)
        if law.kind == "vibration-damping":
            vibration = np.array([law.lateral_vibration_gain, law.angular_vibration_gain])
    elif law.kind in ("computed-torque", "pd"):
        feedback = FeedbackGains(_triple(law.position_gain), _triple(law.velocity_gain))
        # These laws have no sliding surface; their own ratio of gains gives the comparable one for the plots.
        slope = np.zeros(3)
        np.divide(feedback.position, feedback.velocity, out=slope, where=feedback.velocity > 0)
        adaptive = adaptive._replace(Lambda=slope)
    factors = (model.length_factor, model.linear_density_factor)
    believed, kappa = beam.matrices, beam.kappa
    if factors != (1.0, 1.0):
        believed = _matrices(scenario.payload, *factors)
        loads = np.stack([believed.h, believed.g], axis=1)
        kappa = (loads.T @ np.linalg.solve(believed.M_q, loads))[[0, 0, 1], [0, 1, 1]]
    return Control(
        kind=KINDS[law.kind],
        adaptive=adaptive,
        feedback=feedback,
        vibration_gains=vibration,
        payload=BelievedPayload(believed.m, believed.I, kappa.copy()),
        torque_limit=np.full(3, np.inf) if law.torque_limit is None else np.array(law.torque_limit),
        limited=law.torque_limit is not None,
        sampled=law.control_period is not None,
        scratch=np.zeros((6, 3)),
    )


def build_trajectory(scenario: Scenario) -> Sine:
    """The desired motion of a scenario."""
    path = scenario.trajectory
    return Sine(np.array(path.center), np.array(path.amplitude), np.array(path.frequency), np.array(path.phase))


def desired_at(trajectory: Sine, t: float) -> np.ndarray:
    """x_d, ẋ_d, ẍ_d at time t, (3, 3)."""
    desired = np.zeros((3, 3))
    desired_motion(trajectory, t, desired)
    return desired


def build_system(scenario: Scenario, beam: Beam) -> System:
    """Plant, control law and trajectory of a scenario, with motors off until a sampled controller first acts."""
    return System(
        build_plant(scenario, beam),
        build_control(scenario, beam),
        build_trajectory(scenario),
        np.zeros((len(scenario.arms), 3)),
    )
