"""What the engine hands out: blocks of samples, one row per instant, read-only, SI units."""

from dataclasses import dataclass, fields

import numpy as np

from flexlab.scenario import Scenario


@dataclass(frozen=True)
class Samples:
    """Signals of a run on the instants `time` (N,). Shapes for `arms` arms and n_q beam coordinates."""

    time: np.ndarray
    """t, s, (N,): exactly k · sample period."""
    pose: np.ndarray
    """x = (x0, y0, θ), m, m, rad, (N, 3)."""
    pose_rate: np.ndarray
    """ẋ, m/s, m/s, rad/s, (N, 3)."""
    pose_acceleration: np.ndarray
    """ẍ, m/s², m/s², rad/s², (N, 3)."""
    desired_pose: np.ndarray
    """x_d, m, m, rad, (N, 3)."""
    beam_coordinates: np.ndarray
    """q, nodal deflections (m) and slopes (rad), left to right, (N, n_q)."""
    beam_rates: np.ndarray
    """q̇, m/s and rad/s, (N, n_q)."""
    tracking_error: np.ndarray
    """e = x - x_d, m, m, rad, (N, 3)."""
    sliding_variable: np.ndarray
    """s, m/s, m/s, rad/s, (N, 3)."""
    bound_estimates: np.ndarray
    """b̂0, b̂1, b̂2, (N, 3)."""
    joint_angle: np.ndarray
    """Relative joint angles, rad, (N, arms, 3)."""
    joint_torque: np.ndarray
    """τ, N·m, (N, arms, 3)."""
    arm_input: np.ndarray
    """u = 𝒥ᵀτ, N, N, N·m, (N, arms, 3)."""
    internal_force: np.ndarray
    """F, Eqs. (13)-(15), N, N, N·m, (N, arms, 3)."""
    moving_force: np.ndarray
    """f/arms, each arm's equal share of what moves the payload, N, N, N·m, (N, 3)."""
    midspan_deflection: np.ndarray
    """w(0, t), m, (N,)."""
    quasi_static_deflection: np.ndarray
    """The part of w(0, t) that the rigid motion's inertial load bends, m, (N,)."""
    kinetic_energy: np.ndarray
    """Of arms and payload, J, (N,)."""
    elastic_energy: np.ndarray
    """½ qᵀ K_F q, J, (N,)."""
    gravity_energy: np.ndarray
    """Potential energy of weight, zero at y = 0, J, (N,)."""
    input_work: np.ndarray
    """∫ power of motors and of pulls, J, (N,)."""
    dissipated_energy: np.ndarray
    """∫ q̇ᵀ D q̇, J, (N,)."""
    saturated: np.ndarray
    """Whether any joint torque stands at its limit, 1 or 0, (N,)."""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def vibration(self) -> np.ndarray:
        """w(0, t) less its quasi-static part: the part that can be driven to zero, m, (N,)."""
        return self.midspan_deflection - self.quasi_static_deflection

    @property
    def total_energy(self) -> np.ndarray:
        """Kinetic, elastic and gravity energy together, J, (N,)."""
        return self.kinetic_energy + self.elastic_energy + self.gravity_energy

    def slice(self, start: int, stop: int) -> "Samples":
        """Rows start..stop as a block of its own (views, read-only like their source)."""
        return Samples(**{f.name: getattr(self, f.name)[start:stop] for f in fields(Samples)})


class Status(str):
    """How a run stands or ended, as a value: "running", "finished", "diverged", "unreachable", "singular".

    Compares as its name; `text` is the sentence that the user reads, `time` the simulation time in s.
    """

    text: str
    time: float

    def __new__(cls, name: str, text: str = "", time: float = 0.0) -> "Status":
        status = super().__new__(cls, name)
        status.text = text or name
        status.time = time
        return status

    @property
    def failed(self) -> bool:
        """Whether the run stopped before its end."""
        return self not in ("running", "finished")


@dataclass(frozen=True)
class Run(Samples):
    """A finished simulation: all samples, the scenario it started from and how it ended.

    A failed run holds the good samples up to the failure.
    """

    scenario: Scenario
    status: Status
