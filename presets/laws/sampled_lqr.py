"""LQR on the rigid motion, designed for the control period at which it runs."""

import numpy as np
from scipy.linalg import solve_discrete_are

from flexlab import OwnLaw, gain


class SampledLQR(OwnLaw):
    """LQR on position and rate error; inverse dynamics make each coordinate a double integrator."""

    error_weight = gain(1e4, "1/m²", low=1, high=1e8, logarithmic=True, symbol="q")
    acceleration_weight = gain(1e-4, "s⁴/m²", low=1e-8, high=1, logarithmic=True, symbol="r")
    period = 0.002

    def feedback(self, period):
        """Return the gains K (2,) of u = -K (e, ė) for x(k+1) = A x(k) + B u(k)."""
        A, B = np.array([[1.0, period], [0.0, 1.0]]), np.array([[period**2 / 2], [period]])
        Q, R = np.diag([self.error_weight, 0.0]), np.array([[self.acceleration_weight]])
        S = solve_discrete_are(A, B, Q, R)
        return np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A)[0]

    def act(self, at):
        asked = self.error_weight, self.acceleration_weight, at.period
        if getattr(self, "asked", None) != asked:
            self.asked, self.K = asked, self.feedback(at.period)
        error, error_rate = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        return at.inputs_for(at.desired_acceleration - self.K[0] * error - self.K[1] * error_rate)
