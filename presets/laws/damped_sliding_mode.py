"""Sliding mode for the slow motion, damping for the beam: flexlab's law composite, written as an own law."""

import numpy as np

from flexlab import OwnLaw, gain, memory, readout


class DampedSlidingMode(OwnLaw):
    """The paper's law, and accelerations of the virtual link that take energy from the beam by its measured rates."""

    feedback_gain = gain(200.0, "N·s/m, N·m·s/rad", low=0, high=1e6, symbol="K")
    sliding_slope = gain(50.0, "1/s", low=0, high=1e4, symbol="Λ")
    boundary_layer = gain(0.1, "m/s", low=1e-9, high=1e3, logarithmic=True, symbol="ε")
    adaptation = gain((10.0, 10.0, 10.0), "m/N, m³/N, m⁵/(N·s⁴)", low=1e-6, high=1e12, symbol="k")
    lateral_gain = gain(100.0, "1/(kg·s)", low=0, high=1e5, symbol="k_v")
    angular_gain = gain(0.0, "1/(kg·m²·s)", low=0, high=1e6, symbol="k_θ")
    bounds = memory(3)
    damping = readout("N", "force that damps the beam", "F_b")

    def act(self, at):
        error, error_rate = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        s = error_rate + self.sliding_slope * error
        r, r_rate = at.pose_rate - s, at.desired_acceleration - self.sliding_slope * error_rate
        size, powers = np.linalg.norm(s), np.array([1.0, np.linalg.norm(at.pose), at.pose_rate @ at.pose_rate])
        bound = self.bounds @ powers / max(size, self.boundary_layer)
        self.bounds += at.period * size * powers / self.adaptation
        common = at.payload_matrix @ r_rate - (self.feedback_gain + bound) * s
        lateral, turn = self.lateral_gain * at.beam_rate[0], self.angular_gain * at.beam_rate[1]
        angle = at.pose[2]
        link = np.array([-np.sin(angle) * lateral, np.cos(angle) * lateral, turn])
        push = at.inertias.sum(axis=0) @ link
        self.damping = np.hypot(push[0], push[1])
        return at.inertias @ r_rate + at.coriolis @ r + at.weights + at.shared(common + push)
