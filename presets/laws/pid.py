"""PID in task space: the integral removes the error that a constant load leaves."""

import numpy as np

from flexlab import OwnLaw, gain, memory, readout


class PIDControl(OwnLaw):
    """PID in task space with weight compensation; the integral stops growing at a limit."""

    position_gain = gain((40000.0, 40000.0, 8000.0), "N/m, N·m/rad", low=0, high=1e6, symbol="P")
    integral_gain = gain(80000.0, "N/(m·s), N·m/(rad·s)", low=0, high=1e7, symbol="I")
    velocity_gain = gain((1200.0, 1200.0, 240.0), "N·s/m, N·m·s/rad", low=0, high=1e5, symbol="D")
    integral_limit = gain(0.01, "m·s, rad·s", low=0, high=1)
    integral = memory(3)
    integral_share = readout("N", "part of the integral in the force along y", "F_I")

    def act(self, at):
        error, error_rate = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        self.integral = np.clip(self.integral + at.period * error, -self.integral_limit, self.integral_limit)
        held = -self.integral_gain * self.integral
        self.integral_share = held[1]
        return at.weights + at.shared(held - self.position_gain * error - self.velocity_gain * error_rate)
