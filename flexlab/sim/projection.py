"""Carrying the beam's shape from one mesh or boundary to another."""

import numpy as np

from flexlab.physics.beam import GAUSS_POINTS, shape_row
from flexlab.scenario import Payload


def project_beam(old: Payload, new: Payload, M_q: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The new mesh's coordinates closest to the old shape in ∫ρ(w' - w)²ds, with the same mid-span value, (n_q',).

    M_q: mass matrix of the new mesh. A mesh of one pinned element, whose shape cannot always meet that condition, gets it
    as well where its mid-span can move at all.
    """
    load = np.zeros(len(M_q))
    cells = np.union1d(*(np.linspace(-p.length / 2, p.length / 2, p.element_count + 1) for p in (old, new)))
    points, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    for low, high in zip(cells[:-1], cells[1:], strict=True):
        for point, weight in zip(points, weights, strict=True):
            s = (low + high) / 2 + point * (high - low) / 2
            scale = new.linear_density * weight * (high - low) / 2
            load += scale * (row(old, s) @ q) * row(new, s)
    projected = np.linalg.solve(M_q, load)
    middle = row(new, 0.0)
    correction = np.linalg.solve(M_q, middle)
    give = middle @ correction
    if give > 0:
        projected += correction * (row(old, 0.0) @ q - middle @ projected) / give
    return projected


def row(payload: Payload, s: float) -> np.ndarray:
    """N(s) of a payload, (n_q,)."""
    return shape_row(s, payload.length, payload.element_count, payload.boundary)
