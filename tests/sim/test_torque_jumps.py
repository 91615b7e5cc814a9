"""Where inputs jump at a sample, modes damped faster than the step still follow the inputs before the jump."""

from typing import Any

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

SETTLED = 30
"""Time after which the jerk at the start is over, ms."""

DENSE, STIFF = {"kind": "nodal", "coefficient": 1.0}, {"kind": "stiffness", "coefficient": 2e-3}


def run(changes: dict[str, Any], step: float | None, ticks: int) -> Samples:
    return World(load_preset("paper").replace({**changes, "simulation.step": step})).run(ticks)


def force_error(changes: dict[str, Any], ticks: int) -> np.ndarray:
    """Error of the force with the automatic step against steps of 10 µs, over its peak, by sample, after the start."""
    found, right = run(changes, None, ticks).internal_force, run(changes, 1e-5, ticks).internal_force
    return np.abs(found - right).max(axis=(1, 2))[SETTLED:] / np.abs(right).max()


@pytest.mark.parametrize("period", [1e-3, 2e-3, 4e-3])
@pytest.mark.parametrize(
    ("elements", "damping"), [(16, DENSE), (16, STIFF), (32, {"kind": "nodal", "coefficient": 0.1})]
)
def test_force_is_right_at_control_instants(elements: int, damping: dict[str, Any], period: float):
    """The force used to be off by 3e-5 to 2e-4 of its peak there, and by 5e-7 in between."""
    changes = {"payload.element_count": elements, "payload.damping": damping, "controller.control_period": period}
    assert force_error(changes, 120).max() < 2e-6


@pytest.mark.parametrize(("elements", "coefficient"), [(8, 0.1), (16, 1.0)])
def test_force_is_right_where_the_path_jumps_on_a_sample(elements: int, coefficient: float):
    """bang-bang jumps at 0.25 s. The force used to be off there by 1.3e-3 and 5.5e-2 of its peak, now as little as before it."""
    damping = {"kind": "nodal", "coefficient": coefficient}
    changes = {"payload.element_count": elements, "payload.damping": damping, "trajectory": {"kind": "bang-bang"}}
    error = force_error(changes, 260)
    jump = 250 - SETTLED
    assert error[jump] < 1.5 * error[jump - 10 : jump].max()
    assert error[jump - 10 :].max() < 5e-5
