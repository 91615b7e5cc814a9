"""A steady Kalman filter on pose, pose rate and the beam's lowest modes.

L = P Cᵀ(C P Cᵀ + R)⁻¹ with P the stabilising solution of the filter's discrete Riccati equation; R: the squares of the sensors'
noise, but of no sensor less than its floor; Q: unknown forces on pose and modes, held over a period (Kalman, J. Basic Eng. 82
(1960) 35; Franklin, Powell, Workman, Digital Control of Dynamic Systems, ch. 9). Φ - L C Φ is stable wherever the gauges see the
modes (a steady P exists).
"""

from typing import Any, Literal

import numpy as np

from flexlab.control.law import USUAL_GAUGES
from flexlab.control.observers.believed_plant import BelievedPlant
from flexlab.control.observers.observer import MOST_MODES, Observer
from flexlab.errors import ScenarioError
from flexlab.numerics.linear_algebra import NoSolution, product, solve
from flexlab.numerics.matrix_functions import discrete_riccati
from flexlab.physics.law_input import MOST_DELAY
from flexlab.quantities import Count, Number, Numbers, Triple, quantity
from flexlab.text import counted, number_text

POSE_FLOOR, RATE_FLOOR, STRAIN_FLOOR = 1e-6, 1e-4, 1e-7
"""Least noise that the filter assumes, m and rad; m/s and rad/s; 1: that of good encoders and gauges. Without noise it would
trust its sensors alone and differentiate them."""


class KalmanObserver(Observer):
    """A Kalman filter on pose and the lowest modes, with strain gauges; it predicts to the time at which its torque acts."""

    kind: Literal["kalman"] = "kalman"
    observer_modes: Count = quantity(3, "Modes observed", "n_o", "1", low=1, high=MOST_MODES, slider=(1, MOST_MODES))
    gauges: Numbers = quantity(USUAL_GAUGES, "Strain gauges at", "s_j/L", "1", low=-0.5, high=0.5)
    unknown_force: Triple = quantity(
        (20.0, 20.0, 2.0), "Unknown force on the pose", "σ_F", "N, N, N·m", low=1e-6, high=1e6
    )
    unknown_modal_force: Number = quantity(0.1, "Unknown modal force", "σ_η", "N/kg^½", low=1e-9, high=1e6)
    horizon: Number | None = quantity(
        None, "Prediction (null: delay + ½)", "N_p", "control periods", low=0, high=MOST_DELAY + 1
    )

    def gain(self, scenario: Any, plant: BelievedPlant, transition: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """P Cᵀ(C P Cᵀ + R)⁻¹; raises `ScenarioError` if there is no steady P."""
        noise, n = scenario.controller.sensor_noise, len(plant.mass)
        C = np.zeros((6 + len(plant.strain), 2 * n))
        C[:3, :3] = C[3:6, n : n + 3] = np.eye(3)
        C[6:, 3:n] = plant.strain
        strain = np.full(len(plant.strain), max(noise.strain, STRAIN_FLOOR))
        pose, rate = np.maximum(noise.pose, POSE_FLOOR), np.maximum(noise.pose_rate, RATE_FLOOR)
        R = np.diag(np.square(np.concatenate([pose, rate, strain])))
        unknown = np.concatenate([self.unknown_force, np.full(n - 3, self.unknown_modal_force)])
        try:
            P = discrete_riccati(transition.T, C.T, product(inputs * np.square(unknown), inputs.T), R)
            seen = product(C, P)
            return solve(product(seen, C.T) + R, seen).T
        except NoSolution:
            places, observed = ", ".join(number_text(place) for place in self.gauges), counted(n - 3, "mode")
            text = (
                f"controller.observer: no steady gain is found for {observed} and strain gauges at s/L = {places}: observe "
                "fewer modes, place the gauges elsewhere, or take unknown forces and a control period nearer to the usual ones."
            )
            raise ScenarioError([("controller.observer", text)]) from None
