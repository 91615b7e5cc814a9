"""Carrying the beam's shape from one mesh or boundary to another."""

import numpy as np

from flexlab.numerics.linear_algebra import product, solve
from flexlab.physics.beam import GAUSS_POINTS, gauss_rule
from flexlab.scenario import Payload
from flexlab.sim.build import payload_row
from flexlab.sim.geometry import shape_functions


def project_beam(old: Payload, new: Payload, M_q: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The new mesh's coordinates closest to the old shape in ∫ρ(w' - w)²ds, with the same mid-span value, (n_q',).

    M_q: mass matrix of the new mesh. A mesh of one pinned element, whose shape cannot always meet that condition, gets it
    as well where its mid-span can move at all.
    """
    cells = np.union1d(*(np.linspace(-p.length / 2, p.length / 2, p.element_count + 1) for p in (old, new)))
    points, weights = gauss_rule(GAUSS_POINTS)
    middles, halves = (cells[1:] + cells[:-1]) / 2, np.diff(cells) / 2
    s = (middles[:, None] + np.outer(halves, points)).ravel()
    w = product(shape_functions(old, s), q)
    load = product(new.linear_density * np.outer(halves, weights).ravel() * w, shape_functions(new, s))
    middle = payload_row(new, 0.0)
    projected, correction = solve(M_q, np.stack([load, middle], axis=1)).T
    give = product(middle, correction)
    if give > 0:
        projected += correction * (product(payload_row(old, 0.0), q) - product(middle, projected)) / give
    return projected
