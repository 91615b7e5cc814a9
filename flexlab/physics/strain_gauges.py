"""Strain gauges on the beam, and how well they tell the load moments hᵀq and gᵀq.

A gauge on the surface, half the thickness t off the neutral axis, shows the strain -½ t w''(s). Two lie on each half of the
beam, at the Gauss points, so that every moment of w'' up to the third power of s is a weighted sum of the readings.
"""

import numpy as np

from flexlab.numerics.linear_algebra import product, solve
from flexlab.physics.beam import BeamMatrices, gauss_rule, shape_row

GAUGES_PER_HALF = 2
"""Exact for products of two linear functions on each half: for a mesh of one or two elements, hᵀq to the last digit."""


def gauge_places(length: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions s of the gauges, m, (4,), and the weights of their quadrature over the beam, m, (4,)."""
    points, weights = gauss_rule(GAUGES_PER_HALF)
    half = length / 2
    places = np.concatenate([(points - 1) * half / 2, (points + 1) * half / 2])
    return places, np.tile(weights * half / 2, 2)


def strain_rows(places: np.ndarray, length: float, thickness: float, element_count: int, boundary: str) -> np.ndarray:
    """Rows R with strains R q = -½ t w''(s_j), 1, for gauges at s_j = `places`, m; (gauges, n_q)."""
    rows = [shape_row(s, length, element_count, boundary, derivative=2) for s in places]
    return -thickness / 2 * np.array(rows)


def load_moments(beam: BeamMatrices, EI: float, thickness: float, weights: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Weights W, kg·m and kg·m², (2, gauges), by which strains tell the load moments: W (R q) = (hᵀq, gᵀq).

    hᵀq = (K_F⁻¹h)ᵀ K_F q = ∫ EI b''(s) w''(s) ds, where b = N K_F⁻¹h is the beam bent by the load h; the integral is the
    quadrature with `weights` over the gauges, and strains stand for the curvatures b'' and w''.
    """
    bent = solve(beam.K_F, np.stack([beam.h, beam.g], axis=1))
    return (4 * EI / (thickness * thickness)) * product(rows, bent).T * weights
