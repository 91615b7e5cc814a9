"""How the cost grows with the mesh."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexlab.benchmarks.measure import LEAST_TIME, try_out
from flexlab.presets import load_preset

EXPONENT_GOAL = 1.2
"""Largest exponent of the cost against the number of elements that still counts as linear."""

MESHES = (2, 4, 8, 16, 32, 64)
"""Elements."""

FIRST_FITTED = 8
"""Elements: on coarser meshes the arms and the controller cost more than the beam and would flatter the fit."""

STEP = 1e-3
"""s."""


@dataclass(frozen=True)
class MeshCost:
    """What one mesh costs with modal damping and steps of 1 ms."""

    elements: int
    us_per_step: float
    real_time_factor: float
    """Simulated seconds per second of processor time."""


@dataclass(frozen=True)
class Scaling:
    """Cost against the number of elements."""

    meshes: list[MeshCost]
    exponent: float
    """Slope of log cost over log elements, from `FIRST_FITTED` elements on."""


def fitted_exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Slope of the straight line through (log size, log cost), by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def mesh_scaling(duration: float, repeats: int) -> Scaling:
    """Cost with modal damping, where every mode stands alone."""
    meshes = []
    for elements in MESHES:
        changes = {
            "payload.element_count": elements,
            "payload.damping": {"kind": "modal", "ratio": 0.01},
            "simulation.step": STEP,
            "simulation.integrator": "etdrk4",
        }
        trial = try_out(load_preset("paper").replace(changes), duration, repeats, least_time=LEAST_TIME)
        meshes.append(MeshCost(elements, trial.us_per_step, trial.real_time_factor))
    fitted = [mesh for mesh in meshes if mesh.elements >= FIRST_FITTED]
    return Scaling(meshes, fitted_exponent([m.elements for m in fitted], [m.us_per_step for m in fitted]))
