"""What a control law in Python sees of one instant."""

from functools import cached_property
from typing import Any

import numpy as np


class Measurement:
    """What the controller measures and believes at a control instant; SI units; arms in the order left, right.

    Numbers with sensor noise are noisy, as a sampled controller gets them.
    """

    def __init__(self, now: Any, period: float):
        self._now = now
        arms = int(now["arm_count"])
        self.arm_count: int = arms
        """Arms that are there: 2, or 1."""
        self.time: float = float(now["time"])
        """t, s."""
        self.period: float = period
        """T_c between control instants, s."""
        self.pose: np.ndarray = now["x"]
        """x = (x, y, θ) of the beam's middle, m, m, rad, (3,)."""
        self.pose_rate: np.ndarray = now["v"]
        """ẋ, m/s, m/s, rad/s, (3,)."""
        self.beam_rate: np.ndarray = now["beam_rate"]
        """hᵀq̇ and gᵀq̇: how the vibration's momentum and angular momentum move, kg·m/s, kg·m²/s, (2,)."""
        self.desired_pose: np.ndarray = now["desired"][0]
        """x_d, m, m, rad, (3,)."""
        self.desired_rate: np.ndarray = now["desired"][1]
        """ẋ_d, (3,)."""
        self.desired_acceleration: np.ndarray = now["desired"][2]
        """ẍ_d, (3,)."""
        self.inertias: np.ndarray = now["M"][:arms]
        """M̄_i of the arms in the payload's coordinates, kg, kg·m, kg·m², (arms, 3, 3)."""
        self.coriolis: np.ndarray = now["C"][:arms]
        """C̄_i, (arms, 3, 3)."""
        self.arm_weights: np.ndarray = now["G"][:arms]
        """Ḡ_i: what holds the arms' own weight, N, N, N·m, (arms, 3)."""
        self.share: np.ndarray = now["share"][:arms]
        """What each arm carries of the common part, 1, (arms,)."""
        self.payload_mass: float = float(now["m"])
        """As the controller believes it, kg."""
        self.payload_inertia: float = float(now["I"])
        """About the middle, kg·m²."""
        self.gravity: float = float(now["gravity"])
        """Along -y, m/s²."""

    @cached_property
    def jacobians(self) -> np.ndarray:
        """𝒥 of each arm: joint rates from the pose rate, rad/m and 1, (arms, 3, 3), relative joints from the base on."""
        rows = np.zeros((self.arm_count, 3, 3))
        first, second = self._now["J"][: self.arm_count, 0], self._now["J"][: self.arm_count, 1]
        rows[:, 0], rows[:, 1], rows[:, 2] = first, second - first, -second
        rows[:, 2, 2] += 1.0
        return rows

    @property
    def joint_rates(self) -> np.ndarray:
        """θ̇ of the relative joints, rad/s, (arms, 3)."""
        return self.jacobians @ self.pose_rate

    @cached_property
    def joint_angles(self) -> np.ndarray:
        """θ of the relative joints, base first, rad in -π to π, (arms, 3)."""
        c1, s1, c2, s2 = self._now["direction"][: self.arm_count].T
        first, second = np.arctan2(s1, c1), np.arctan2(s2, c2)
        # The last link points along the beam; the right arm's against it.
        last = self.pose[2] + np.where(np.arange(self.arm_count) == 0, 0.0, np.pi)
        angles = np.stack([first, second - first, last - second], axis=1)
        return (angles + np.pi) % (2 * np.pi) - np.pi

    @property
    def weights(self) -> np.ndarray:
        """What holds the arms and their shares of the payload's weight, N, N, N·m, (arms, 3)."""
        held = self.arm_weights.copy()
        held[:, 1] += self.share * self.payload_mass * self.gravity
        return held

    def shared(self, common: Any) -> np.ndarray:
        """A common input (3,), N, N, N·m, dealt out to the arms by their shares, (arms, 3)."""
        return self.share[:, None] * np.asarray(common, float)

    def inputs_for(self, acceleration: Any) -> np.ndarray:
        """The inputs (arms, 3) that give a rigid payload an acceleration (3,), m/s², m/s², rad/s²: inverse dynamics."""
        a = np.asarray(acceleration, float)
        payload = np.array([self.payload_mass, self.payload_mass, self.payload_inertia])
        return self.inertias @ a + self.coriolis @ self.pose_rate + self.weights + self.shared(payload * a)

    def from_torques(self, torques: Any) -> np.ndarray:
        """The inputs u_i = 𝒥_iᵀτ_i, (arms, 3), of joint torques (arms, 3), N·m."""
        return np.einsum("ija,ij->ia", self.jacobians, np.asarray(torques, float).reshape(self.arm_count, 3))
