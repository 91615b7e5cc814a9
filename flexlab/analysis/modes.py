"""Vibration modes of the payload, and poles of the whole closed loop near a pose."""

from dataclasses import dataclass

import numpy as np

from flexlab.errors import ScenarioError, StudyError
from flexlab.physics.dynamics import set_momenta
from flexlab.physics.plant import ETA, P, X, make_workspace, state_size
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam, build_system
from flexlab.sim.closed_loop import rates
from flexlab.sim.termination import pose_fault

DIFFERENCE = 1e-6
"""Step of the central differences, in units of each coordinate: the laws are smooth, so that 1e-10 of relative error stays."""


@dataclass(frozen=True)
class Modes:
    """Modes in ascending frequency; n_m modes, n_q nodal coordinates, arrays read-only."""

    frequency: np.ndarray
    """Undamped frequencies of the beam with its grips held, Hz, (n_m,)."""
    damping_ratio: np.ndarray
    """ζ of each mode alone, D_kk/(2ω_k), (n_m,); nodal damping also couples modes, see `poles`."""
    shape: np.ndarray
    """Mass-normalised nodal shapes, deflections (1/√kg) and slopes, (n_q, n_m)."""
    lateral_participation: np.ndarray
    """Share of the payload's mass that moves with a mode when both grips move sideways, (n_m,)."""
    angular_participation: np.ndarray
    """Share of the payload's inertia that moves with a mode when the virtual link turns, (n_m,)."""
    pose: np.ndarray
    """The pose of the linearisation, (3,)."""
    poles: np.ndarray
    """Poles of arms, beam and control law linearised at `pose`, 1/s, complex, by magnitude, (2 n_m + 6,)."""

    @property
    def pole_frequency(self) -> np.ndarray:
        """|pole|/2π, Hz."""
        return np.abs(self.poles) / (2 * np.pi)

    @property
    def pole_damping_ratio(self) -> np.ndarray:
        """-Re/|pole|: 1 for a decay without oscillation, negative for an unstable pole."""
        return -self.poles.real / np.maximum(np.abs(self.poles), np.finfo(float).tiny)


def modes(scenario: Scenario, pose: tuple[float, float, float] | None = None) -> Modes:
    """Modes of the payload, and poles of the closed loop at rest at `pose` (None: the trajectory's centre).

    The linearisation holds the target at that pose with b̂ = 0 and continuous control. Raises `ScenarioError` for a
    scenario that is not valid and `StudyError` for a pose that an arm cannot take.
    """
    scenario = scenario.replace({})
    at = np.array(scenario.trajectory.center if pose is None else pose, dtype=float)
    if at.shape != (3,) or not np.all(np.isfinite(at)):
        raise StudyError(f"pose = {pose!r} is not usable: give three numbers, x and y in m and θ in rad.")
    fault = pose_fault(scenario, at, 0.0, "the pose of the linearisation")
    if fault is not None:
        raise StudyError(fault.text)
    beam = build_beam(scenario.payload)
    order = np.argsort(beam.modes.omega)
    omega, V = beam.modes.omega[order], beam.modes.V[:, order]
    h, g = V.T @ beam.matrices.h, V.T @ beam.matrices.g
    result = Modes(
        frequency=omega / (2 * np.pi),
        damping_ratio=np.diag(beam.modes.D)[order] / (2 * omega),
        shape=V,
        lateral_participation=h**2 / beam.matrices.m,
        angular_participation=g**2 / beam.matrices.I,
        pose=at,
        poles=closed_loop_poles(scenario, at),
    )
    for array in vars(result).values():
        array.flags.writeable = False
    return result


def closed_loop_poles(scenario: Scenario, pose: np.ndarray) -> np.ndarray:
    """Eigenvalues of the closed loop about rest at a pose, 1/s, complex, by magnitude, (2 n_m + 6,)."""
    still = {
        "trajectory.center": tuple(pose),
        "trajectory.amplitude": (0.0, 0.0, 0.0),
        "controller.control_period": None,
        "controller.input_delay": 0,
        "controller.sensor_noise": {},
        "controller.torque_limit": None,
    }
    try:
        scenario = scenario.replace(still)
    except ScenarioError as error:
        raise StudyError(str(error)) from None
    beam = build_beam(scenario.payload)
    system, n = build_system(scenario, beam), len(beam.modes.omega)
    workspace = make_workspace(len(scenario.arms), n)
    y = np.zeros(state_size(n))
    y[X : X + 3] = pose
    # The beam's own sag under weight, so that the linearisation is about rest.
    y[ETA : ETA + n] = -scenario.gravity * np.cos(pose[2]) * (beam.modes.V.T @ beam.matrices.h) / beam.modes.omega**2
    set_momenta(system.plant, y, np.zeros(3), np.zeros(n), workspace)
    index = np.r_[X : X + 3, P : P + 3, ETA : ETA + 2 * n]
    # Beam coordinates enter as ωη: their columns then have the size of the others and eigenvalues lose no digits.
    scale = np.r_[np.ones(6), 1 / beam.modes.omega, np.ones(n)]
    A = np.empty((len(index), len(index)))
    upper, lower = np.zeros_like(y), np.zeros_like(y)
    for column, (at, size) in enumerate(zip(index, scale, strict=True)):
        for target, sign in ((upper, 1), (lower, -1)):
            moved = y.copy()
            moved[at] += sign * DIFFERENCE * size
            workspace.desired_time[0] = np.nan
            rates(system, 0.0, moved, workspace, target, True)
        A[:, column] = (upper[index] - lower[index]) / (2 * DIFFERENCE * scale)
    poles = np.linalg.eigvals(A)
    return poles[np.argsort(np.abs(poles), kind="stable")]
