"""The linear plant that observers and linear laws are designed for: arms and the beam's lowest modes at one pose.

M p̈ + D ṗ + K p = f over p = (x, η), pose and modal coordinates, for a straight beam at rest, with f the forces on them. The
weight and the terms that turn with the pose are left out: users of the model subtract them from f at the present pose.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from flexlab.errors import ScenarioError
from flexlab.numerics.elementary import sin_cos
from flexlab.numerics.linear_algebra import inverse, product, solve
from flexlab.numerics.matrix_functions import exponential
from flexlab.physics.arm import ARM, arm_configuration, arm_constants
from flexlab.physics.axial_load import geometric_matrices, in_modes
from flexlab.physics.beam import beam_matrices, undamped_modes
from flexlab.physics.sensors import strain_rows

KNOWN_PLANTS = 8
"""Number of plants that are kept: a slider changes gains many times a second, but seldom the plant."""


class BelievedPlant(NamedTuple):
    """Arms and n_o modes; n = 3 + n_o coordinates. Arrays are shared: do not change them."""

    mass: np.ndarray
    """M = [ΣM̄_i + A11, A12; A12ᵀ, 1], (n, n)."""
    damping: np.ndarray
    """D, of the modes alone, (n, n)."""
    omega: np.ndarray
    """ω, rad/s, (n_o,)."""
    stiffness: np.ndarray
    """ω² plus the stiffness from the steady axial force, 1/s², (n_o, n_o)."""
    h: np.ndarray
    """Vᵀh, kg^½, (n_o,)."""
    g: np.ndarray
    """Vᵀg, m·kg^½, (n_o,)."""
    strain: np.ndarray
    """Strain at each gauge by modal coordinates, 1/(m·kg^½), (gauges, n_o)."""
    V: np.ndarray
    """Mass-normalised modes over nodal coordinates, (n_q, n_o)."""

    @property
    def state_matrix(self) -> np.ndarray:
        """A of d(p, ṗ)/dt = A (p, ṗ) + B f, (2 n, 2 n)."""
        n = len(self.mass)
        stiffness = np.zeros((n, n))
        stiffness[3:, 3:] = self.stiffness
        return np.block([[np.zeros((n, n)), np.eye(n)], [-solve(self.mass, np.hstack([stiffness, self.damping]))]])

    @property
    def input_matrix(self) -> np.ndarray:
        """B, (2 n, n)."""
        return np.vstack([np.zeros_like(self.mass), inverse(self.mass)])


def hold(A: np.ndarray, B: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """State and input matrix over `period` s of dz/dt = A z + B u with u held, by one matrix exponential."""
    n, inputs = B.shape
    whole = np.zeros((n + inputs, n + inputs))
    whole[:n, :n], whole[:n, n:] = A, B
    over = exponential(period * whole)
    return over[:n, :n], over[:n, n:]


def arm_records(arms: Sequence[Any], payload_length: float) -> np.ndarray:
    """`ARM` records of a scenario's arms, left first, (arms,)."""
    records = np.zeros(len(arms), ARM).view(np.recarray)
    for i, arm in enumerate(arms):
        side = -1 if i == 0 else 1
        records[i] = arm_constants(
            arm.base, arm.link_mass, arm.link_length, arm.link_center, arm.inertia, arm.elbow, side, payload_length
        )
    return records


def believed_plant(
    scenario: Any, mode_count: int, gauges: tuple[float, ...], pose: Sequence[float] | None = None
) -> BelievedPlant:
    """The plant that a scenario's controller believes in, at a pose (None: its path's centre), with gauges at s/L.

    Raises `ScenarioError` for more modes than the beam's mesh has.
    """
    payload = scenario.payload
    if mode_count > payload.coordinate_count:
        text = (
            f"controller.observer.observer_modes = {mode_count} is more than the {payload.coordinate_count} modes of "
            f"{payload.element_count} {payload.boundary} elements: observe {payload.coordinate_count} or fewer, "
            "or give the beam more elements."
        )
        raise ScenarioError([("controller.observer.observer_modes", text)])
    model = scenario.controller.model
    pose = tuple(scenario.trajectory.middle if pose is None else pose)
    along = None if model.axial_load == "none" else steady_load(scenario)
    return _plant(payload, scenario.arms, model, pose, mode_count, gauges, along)


def steady_load(scenario: Any) -> tuple[float, float]:
    """N_L, N, and a₁, m/s², of the believed payload at rest at the path's centre, from the wanted squeeze and the weight."""
    payload, law = scenario.payload, scenario.controller
    mass = payload.linear_density * law.model.linear_density_factor * payload.length * law.model.length_factor
    along = scenario.gravity * sin_cos(scenario.trajectory.middle[2])[0]
    if len(scenario.arms) == 1:
        return -mass * along, along
    return -law.wanted_internal_force - law.load_share * mass * along, along


@lru_cache(KNOWN_PLANTS)
def _plant(
    payload: Any,
    arms: tuple[Any, ...],
    model: Any,
    pose: tuple[float, ...],
    mode_count: int,
    gauges: tuple[float, ...],
    load: tuple[float, float] | None,
) -> BelievedPlant:
    length, mesh = payload.length * model.length_factor, (payload.element_count, payload.boundary)
    density = payload.linear_density * model.linear_density_factor
    beam = beam_matrices(length, density, payload.bending_stiffness * model.stiffness_factor, *mesh)
    omega, V = undamped_modes(beam)
    omega, V = omega[:mode_count], V[:, :mode_count]
    h, g = product(np.stack([beam.h, beam.g]), V)
    s, c = sin_cos(pose[2])
    mass, damping = np.eye(3 + mode_count), np.zeros((3 + mode_count,) * 2)
    mass[:3, :3] = np.diag([beam.m, beam.m, beam.I])
    for arm in arm_records(arms, payload.length):
        M = np.zeros((3, 3))
        # A pose that an arm cannot take is refused when the run starts.
        arm_configuration(arm, pose[0], pose[1], c, s, 0.0, M, np.zeros(3), np.zeros((2, 3)), np.zeros(4))
        mass[:3, :3] += M
    mass[:3, 3:] = np.stack([-s * h, c * h, g])
    mass[3:, :3] = mass[:3, 3:].T
    damping[3:, 3:] = payload.damping.modal(omega, V)
    strain = product(strain_rows(length * np.array(gauges), length, payload.thickness, *mesh), V)
    stiffness = np.diag(omega * omega)
    if load is not None:
        G0, G1, _ = geometric_matrices(length, density, *mesh)
        stiffness = stiffness + in_modes(load[0] * G0 + load[1] * G1, V)
    return BelievedPlant(mass, damping, omega, stiffness, h, g, strain, V)
