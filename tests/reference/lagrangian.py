"""T - U of the whole system from the positions of mass points alone: no mass matrix, Jacobian or Christoffel symbol."""

import numpy as np

from flexlab.scenario import Scenario

STEP = 1e-30
"""Complex step, with which velocities are exact derivatives of the positions."""


def hermite(payload, s):
    """Rows of cubic Hermite functions N(s) and N''(s) for all 2 (n + 1) nodal coordinates, (len(s), 2 (n + 1)) each."""
    n = payload.element_count
    l = payload.length / n  # noqa: E741
    place = (s + payload.length / 2) / l
    element = np.clip(place.astype(int), 0, n - 1)
    z = place - element
    value = [(1 + 2 * z) * (1 - z) ** 2, l * z * (1 - z) ** 2, z * z * (3 - 2 * z), l * z * z * (z - 1)]
    second = [(12 * z - 6) / l**2, (6 * z - 4) / l, (6 - 12 * z) / l**2, (6 * z - 2) / l]
    N, N2 = np.zeros((2, len(s), 2 * n + 2))
    rows = np.arange(len(s))
    for k in range(4):
        N[rows, 2 * element + k], N2[rows, 2 * element + k] = value[k], second[k]
    return N, N2


class Lagrangian:
    """L(p, ṗ) of a scenario in p = (x0, y0, θ, q); `held`: indices of the nodal coordinates that are zero."""

    def __init__(self, scenario: Scenario, held: list[int]):
        self.scenario = scenario
        payload = scenario.payload
        n, half = payload.element_count, payload.length / 2
        x, weight = np.polynomial.legendre.leggauss(6)
        edges = np.linspace(-half, half, n + 1)
        middle, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
        self.s = (middle[:, None] + width[:, None] * x).ravel()
        self.mass = payload.linear_density * (width[:, None] * weight).ravel()
        N, N2 = hermite(payload, self.s)
        self.N, self.N2 = np.delete(N, held, axis=1), np.delete(N2, held, axis=1)

    def beam_points(self, p):
        """Positions of the beam's mass points, m, (2, points)."""
        c, s, w = np.cos(p[2]), np.sin(p[2]), self.N @ p[3:]
        return np.array([p[0] + self.s * c - w * s, p[1] + self.s * s + w * c])

    def links(self, p, index):
        """Centres of mass of an arm's links, m, (2, 3), and the unit vectors along the links."""
        arm, side = self.scenario.arms[index], (-1 if index == 0 else 1)
        l1, l2, l3 = arm.link_length
        reach = side * (self.scenario.payload.length / 2 + l3)
        wrist = np.array([p[0] + reach * np.cos(p[2]) - arm.base[0], p[1] + reach * np.sin(p[2]) - arm.base[1]])
        cos_bend = (wrist @ wrist - l1**2 - l2**2) / (2 * l1 * l2)
        sin_bend = arm.elbow * np.sqrt(1 - cos_bend**2)
        # Unit vectors have two components here: as complex numbers they would mix with the complex step.
        along, across = l1 + l2 * cos_bend, l2 * sin_bend
        square = wrist @ wrist
        u1 = np.array([along * wrist[0] + across * wrist[1], along * wrist[1] - across * wrist[0]]) / square
        u2 = (wrist - l1 * u1) / l2
        u3 = -side * np.array([np.cos(p[2]), np.sin(p[2])])
        a1, a2, a3 = arm.link_center
        base = np.array(arm.base)
        return np.array([base + a1 * u1, base + l1 * u1 + a2 * u2, base + l1 * u1 + l2 * u2 + a3 * u3]).T, (u1, u2, u3)

    def __call__(self, p, p_rate):
        """T - U, J."""
        return self.kinetic(p, p_rate) - self.potential(p)

    def kinetic(self, p, p_rate):
        """½∫|Ṙ|² dm of arms and beam, J."""
        moved = p + 1j * STEP * p_rate
        velocity = self.beam_points(moved).imag / STEP
        total = 0.5 * np.sum(self.mass * velocity**2)
        for index, arm in enumerate(self.scenario.arms):
            centers, units = self.links(moved, index)
            total += 0.5 * np.sum(np.array(arm.link_mass) * (centers.imag / STEP) ** 2)
            for unit, inertia in zip(units, arm.inertia, strict=True):
                turning = (unit[0].real * unit[1].imag - unit[1].real * unit[0].imag) / STEP
                total += 0.5 * inertia * turning**2
        return total

    def potential(self, p):
        """½∫EI w''² ds of the beam and the potential energy of all weights, J."""
        payload, g = self.scenario.payload, self.scenario.gravity
        curvature = self.N2 @ p[3:]
        total = 0.5 * payload.bending_stiffness / payload.linear_density * np.sum(self.mass * curvature**2)
        total += g * np.sum(self.mass * self.beam_points(p)[1])
        for index, arm in enumerate(self.scenario.arms):
            total += g * np.array(arm.link_mass) @ self.links(p, index)[0][1]
        return total


def gradient(function, at, step):
    """Gradient by central differences of order 4, (len(at),)."""
    result = np.zeros(len(at))
    for k in range(len(at)):
        d = np.zeros(len(at))
        d[k] = step
        near, far = function(at + d) - function(at - d), function(at + 2 * d) - function(at - 2 * d)
        result[k] = (8 * near - far) / (12 * step)
    return result
