"""Model predictive control: at each instant OSQP finds the best accelerations within a limit over a horizon."""

import numpy as np
import scipy.sparse as sparse

from flexlab import OwnLaw, gain, readout

try:
    import osqp
except ImportError:
    raise ImportError("OSQP is not installed: pip install flexlab[mpc]") from None

HORIZON = 20
"""Number of control periods to look ahead."""


class PredictiveControl(OwnLaw):
    """MPC on the rigid motion: accelerations within a limit that bring position and rate errors to zero soonest."""

    rate_weight = gain(1e-3, "s²", low=0, high=1, symbol="w_v")
    acceleration_weight = gain(1e-7, "s⁴", low=1e-10, high=1e-2, logarithmic=True, symbol="w_a")
    acceleration_limit = gain(50.0, "m/s², rad/s²", low=1, high=1000, symbol="a_max")
    period = 0.005
    first_acceleration = readout("m/s²", "acceleration asked for along x, beyond the path's", "a_x")

    def prepare(self, period):
        """Make the prediction matrices over the horizon, and the solver of min ½aᵀHa + gᵀa with |a| ≤ limit."""
        ahead, steps = np.arange(1, HORIZON + 1), np.arange(HORIZON)
        later = np.clip(ahead[:, None] - steps, 0, None)
        self.from_rate = ahead * period
        self.position = np.where(later > 0, (later - 0.5) * period**2, 0.0)
        self.rate = np.where(later > 0, period, 0.0)
        H = self.position.T @ self.position + self.rate_weight * self.rate.T @ self.rate
        H += self.acceleration_weight * np.eye(HORIZON)
        limit = np.full(HORIZON, self.acceleration_limit)
        self.solver = osqp.OSQP()
        # Scaled to numbers near one. Without a warm start the answer depends on this instant alone, as a replay needs.
        self.scale = 1 / np.abs(H).max()
        self.solver.setup(
            sparse.csc_matrix(np.triu(self.scale * H)),
            np.zeros(HORIZON),
            sparse.eye(HORIZON, format="csc"),
            -limit,
            limit,
            verbose=False,
            warm_starting=False,
            adaptive_rho=False,
            eps_abs=1e-5,
            eps_rel=1e-5,
            max_iter=2000,
        )

    def act(self, at):
        asked = self.rate_weight, self.acceleration_weight, self.acceleration_limit, at.period
        if getattr(self, "asked", None) != asked:
            self.asked = asked
            self.prepare(at.period)
        acceleration = np.zeros(3)
        for axis in range(3):
            error = at.pose[axis] - at.desired_pose[axis]
            error_rate = at.pose_rate[axis] - at.desired_rate[axis]
            free = error + self.from_rate * error_rate
            g = self.position.T @ free + self.rate_weight * error_rate * self.rate.sum(axis=0)
            self.solver.update(q=self.scale * g)
            acceleration[axis] = self.solver.solve(raise_error=False).x[0]
        self.first_acceleration = acceleration[0]
        return at.inputs_for(at.desired_acceleration + acceleration)
