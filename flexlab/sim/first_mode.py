"""The beam's first mode in the closed loop, which an input shaper is made for unless it is told another."""

import contextlib
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexlab.control.motion import DesiredMotion
from flexlab.control.path import build_motion
from flexlab.errors import ScenarioError
from flexlab.numerics.linear_algebra import eigenvalues, eigenvector
from flexlab.physics.plant import ETA, P, X
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam, build_control, build_plant
from flexlab.sim.closed_loop import System, new_workspace, rates_at, state_length

DIFFERENCE = 1e-5
"""Step of the central differences, m, rad and their momenta: their error stays under 1e-6 of the frequency."""
OWN_SHARE = 0.5
"""How much of an oscillation must be the beam's for it to be one of its modes."""
MOST_DAMPED = 0.9
"""Damping ratio that a shaper is made for at most; what fades faster needs none."""


class Mode(NamedTuple):
    """An oscillation."""

    omega: float
    """Magnitude of its pole, rad/s."""
    zeta: float
    """Damping ratio, 1."""


def first_mode(scenario: Scenario) -> Mode:
    """The closed loop's slowest oscillation that is the beam's, with the payload held in the middle of its path.

    Continuous control, memory as at the start; with a law that only runs sampled, the arms free. Raises `ScenarioError` if
    there is none, as with fast-acting damping.
    """
    still = {"title": "", "watch": "", "trajectory": {"kind": "hold", "pose": scenario.trajectory.middle}}
    return _found(_continuous(scenario).replace(still))


def _continuous(scenario: Scenario) -> Scenario:
    """The scenario under its law in continuous time, without limits and noise; without control where that cannot be."""
    ideal = {
        "controller.control_period": None,
        "controller.input_delay": 0,
        "controller.sensor_noise": {},
        "controller.torque_limit": None,
        "joints.encoders": {},
        "joints.motor": {},
        "grips": {},
    }
    with contextlib.suppress(ScenarioError):
        found = scenario.replace(ideal)
        if found.controller.control_period is None:
            return found
    return scenario.replace({"controller": {"kind": "none"}})


@lru_cache(maxsize=32)
def _found(scenario: Scenario) -> Mode:
    beam = build_beam(scenario.payload)
    nothing = np.zeros((len(scenario.arms), 3))
    held: DesiredMotion = build_motion(scenario.trajectory)
    system = System(build_plant(scenario, beam), build_control(scenario, beam), held, nothing)
    n = len(beam.modes.omega)
    parts = np.concatenate([np.arange(X, X + 3), ETA + np.arange(n), np.arange(P, P + 3), ETA + n + np.arange(n)])
    scale = np.concatenate([np.ones(3), beam.modes.omega, np.ones(3 + n)])
    matrix = _slopes(system, np.array(scenario.trajectory.middle), parts, scale)
    value = eigenvalues(matrix)
    size = np.sqrt(np.square(value.real) + np.square(value.imag))
    for place in np.argsort(size, kind="stable"):
        if value.imag[place] > 0 and _beams_share(matrix, value[place], n) > OWN_SHARE:
            omega = float(size[place])
            return Mode(omega, float(np.clip(-value.real[place] / omega, 0.0, MOST_DAMPED)))
    text = (
        "trajectory.shaper_frequency = null: no mode of the beam oscillates in this loop. "
        "Give the frequency that the shaper is made for, in Hz, or choose the shaper none."
    )
    raise ScenarioError([("trajectory.shaper_frequency", text)])


def _beams_share(matrix: np.ndarray, pole: complex, n: int) -> float:
    """How much of an oscillation is the beam's, by the participation of the loop's states in it (x, η, p, π)."""
    left, right = eigenvector(matrix.T, pole), eigenvector(matrix, pole)
    real, imaginary = left.real * right.real - left.imag * right.imag, left.real * right.imag + left.imag * right.real
    parts = np.sqrt(real * real + imaginary * imaginary)
    return float((parts[3 : 3 + n].sum() + parts[6 + n :].sum()) / max(float(parts.sum()), np.finfo(float).tiny))


def _slopes(system: System, pose: np.ndarray, parts: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """The matrix of the linear loop at rest over `parts` of its state, η by its frequency; raises `ScenarioError`."""
    y, ws = np.zeros(state_length(system)), new_workspace(system)
    y[:3] = pose
    rows = np.zeros((2, len(y)))
    columns = []
    for part in parts:
        for row, step in zip(rows, (DIFFERENCE, -DIFFERENCE), strict=True):
            moved = y.copy()
            moved[part] += step
            if rates_at(system, 0.0, moved, ws, row, True) != 0:
                raise ScenarioError([("trajectory", "The middle of the path cannot be reached by both arms: move it.")])
        columns.append((rows[0] - rows[1])[parts] / (2 * DIFFERENCE))
    return np.stack(columns, axis=1) * scale[:, None] / scale
