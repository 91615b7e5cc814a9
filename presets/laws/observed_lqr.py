"""LQR on pose and the beam's lowest modes: flexlab's law lqr, written as an own law."""

import numpy as np

from flexlab import OwnLaw, gain, memory
from flexlab.numerics.matrix_functions import discrete_riccati

MODES = 3


class ObservedLQR(OwnLaw):
    """LQR on pose and lowest modes, which a Kalman filter tells from pose, pose rate and strain gauges."""

    pose_weight = gain((1e6, 1e6, 2.5e5), "1/m², 1/m², 1/rad²", low=1e-6, high=1e12)
    rate_weight = gain((100.0, 100.0, 25.0), "s²/m², s²/m², s²/rad²", low=0, high=1e12)
    vibration_weight = gain(1e3, "1/J", low=0, high=1e9, slider=(1.0, 1e6), logarithmic=True)
    force_weight = gain((1e-4, 1e-4, 1e-2), "1/N², 1/N², 1/(N·m)²", low=1e-12, high=1e6)
    unknown_force = gain((20.0, 20.0, 2.0), "N, N, N·m", low=1e-6, high=1e6)
    unknown_modal_force = gain(0.1, "N/kg^½", low=1e-9, high=1e6)
    estimate = memory(2 * (3 + MODES))
    begun = memory(1)

    def design(self, at):
        """Compute Φ, Γ (forces), Γ_w (weight that bends the beam), the filter's gain L on readings C z, the regulator's K."""
        plant = at.believed.lowest(MODES)
        B, n = plant.input_matrix, 3 + MODES
        self.Phi, inputs = plant.held(at.period, np.column_stack([B, B[:, 3:] @ -plant.h]))
        self.Gamma, self.Gamma_w = inputs[:, :3], inputs[:, -1]
        self.C = np.zeros((6 + len(plant.strain), 2 * n))
        self.C[:3, :3] = self.C[3:6, n : n + 3] = np.eye(3)
        self.C[6:, 3:n] = plant.strain
        strain_noise = np.full(len(plant.strain), max(plant.strain_noise, 1e-7))  # No sensor counts as exact.
        noise = np.concatenate([np.maximum(plant.pose_noise, 1e-6), np.maximum(plant.rate_noise, 1e-4), strain_noise])
        pushes = inputs[:, :n] * np.concatenate([self.unknown_force, np.full(MODES, self.unknown_modal_force)])
        P = discrete_riccati(self.Phi.T, self.C.T, pushes @ pushes.T, np.diag(noise**2))
        self.L = np.linalg.solve(self.C @ P @ self.C.T + np.diag(noise**2), self.C @ P).T
        beam = np.full(MODES, self.vibration_weight)
        Q = np.diag(np.concatenate([self.pose_weight, beam * plant.omega**2, self.rate_weight, beam]))
        S = discrete_riccati(self.Phi, self.Gamma, Q, np.diag(self.force_weight))
        pushed = self.Gamma.T @ S
        self.K = np.linalg.solve(np.diag(self.force_weight) + pushed @ self.Gamma, pushed @ self.Phi)

    def act(self, at):
        weights = self.pose_weight, self.rate_weight, self.vibration_weight, self.force_weight
        asked = at.believed, at.period, np.hstack([*weights, self.unknown_force, self.unknown_modal_force]).tobytes()
        if getattr(self, "asked", None) != asked:
            self.asked = asked
            self.design(at)
        still = np.zeros(MODES)
        bending = self.Gamma_w * at.gravity * np.cos(at.pose[2])

        def later(z, torques):
            return self.Phi @ z + self.Gamma @ at.net_force(at.from_torques(torques)) + bending

        z = np.concatenate([at.pose, still, at.pose_rate, still])
        if self.begun[0]:
            z = later(self.estimate, at.torques[0])
        self.estimate = z + self.L @ (np.concatenate([at.pose, at.pose_rate, at.strains]) - self.C @ z)
        self.begun[0] = 1
        z = self.estimate
        for torques in at.torques[1:]:
            z = later(z, torques)
        feedback = self.K @ (np.concatenate([at.coming[0], still, at.coming[1], still]) - z)
        a = at.desired_acceleration
        common = at.shared(at.payload_matrix @ a + feedback)
        return at.inertias @ a + at.coriolis @ at.desired_rate + at.weights + common
