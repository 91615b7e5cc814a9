"""The plant linearised about rest: second derivatives of the energies in `reference.lagrangian`."""

import numpy as np

from flexlab.physics.beam import free_coordinates
from flexlab.scenario import Scenario
from reference.lagrangian import Lagrangian

NEAR = 2e-3
"""Step of the second differences, m and rad; as these are of fourth order, they lose only about 1e-9."""


def hessian(function, at, step):
    """Second derivatives by differences of order 4, (n, n)."""
    n = len(at)
    weights = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
    result = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for a, left in weights.items():
                for b, right in weights.items():
                    moved = np.array(at, float)
                    moved[i] += a * step
                    moved[j] += b * step
                    total += left * right * function(moved)
            result[i, j] = result[j, i] = total / step**2
    return result


def open_loop_matrices(scenario: Scenario, p: np.ndarray) -> tuple[np.ndarray, ...]:
    """M, C, K for (x, q) without motors, and the second derivatives of the arms' potential energy by the pose, (3, 3)."""
    payload = scenario.payload
    free = free_coordinates(payload.element_count, payload.boundary)
    held = np.setdiff1d(np.arange(2 * payload.element_count + 2), free).tolist()
    lagrangian = Lagrangian(scenario, held)
    M = hessian(lambda rate: lagrangian.kinetic(p, rate), np.zeros(len(p)), 1.0)
    K = hessian(lagrangian.potential, p, NEAR)
    C = np.zeros_like(M)
    C[3:, 3:] = payload.damping.coefficient * np.eye(len(p) - 3)

    def arms_weight(x: np.ndarray) -> float:
        pose = np.concatenate([x, np.zeros(len(p) - 3)])
        masses = [np.array(arm.link_mass) for arm in scenario.arms]
        return scenario.gravity * sum(
            float(mass @ lagrangian.links(pose, i)[0][1].real) for i, mass in enumerate(masses)
        )

    return M, C, K, hessian(arms_weight, p[:3], NEAR)
