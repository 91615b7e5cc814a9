"""Theorems 1 and 2 along the paper's run, with what they assume."""

from collections.abc import Iterator

import numpy as np

from flexlab.analysis.validation.check import PERIOD, Check, Runs, above, below
from flexlab.analysis.validation.control_law import GAIN
from flexlab.analysis.validation.mass_points import MassPoints, christoffel

SUBJECT, PLACE = "Theorems 1 and 2 along the run", 5

EVERY = 25
"""Of the run's first second, which samples are looked at."""


def checks(runs: Runs) -> Iterator[Check]:
    """Assumptions, then what the theorems conclude."""
    run = runs.paper
    second = slice(round(1 / PERIOD), None)
    for words, signal in (("x", run.pose), ("ẋ", run.pose_rate), ("ẍ", run.pose_acceleration)):
        sizes = np.linalg.norm(signal, axis=1)
        later, first = float(sizes[second].max()), float(sizes[: second.start].max())
        yield below(f"Theorem 1 assumes {words} bounded: largest after 1 s, as a part of before", 1.01, later / first)
    for words, signal in (("q", run.beam_coordinates), ("q̇", run.beam_rates)):
        part = float((np.abs(signal[second]).max(axis=0) / np.abs(signal).max(axis=0)).max())
        yield below(f"Theorem 1: {words} stays bounded: largest after 1 s, as a part of all", 0.5, part)
        again = np.abs(signal[3000:5000] - signal[4000:6000]).max(axis=0) / np.abs(signal).max(axis=0)
        yield below(f"and {words} repeats itself every second from 3 s on: relative change", 1e-5, again.max())
    yield from _theorem_2(runs)


def _theorem_2(runs: Runs) -> Iterator[Check]:
    run, points = runs.paper, MassPoints(runs.paper.scenario)
    rows = np.arange(0, round(1 / PERIOD), EVERY)
    bound, stored = [], []
    for k in rows:
        x, v, a, s = run.pose[k], run.pose_rate[k], run.pose_acceleration[k], run.sliding_variable[k]

        def inertia(at: np.ndarray) -> np.ndarray:
            return points.rigid_inertia(at) + points.arm_inertia(at, 0) + points.arm_inertia(at, 1)

        M, C = inertia(x), christoffel(inertia, x, v)
        disturbance = M @ a + C @ v - run.arm_input[k].sum(axis=0)
        bound.append(np.linalg.norm(disturbance) / (1 + np.linalg.norm(x) + np.linalg.norm(v) ** 2))
        stored.append(0.5 * s @ M @ s)
    yield below("Theorem 2 assumes ‖Ψ‖ ≤ b0 + b1‖x‖ + b2‖ẋ‖²: holds with equal b of", 1e3, max(bound), "N")
    learnt = np.diff(run.bound_estimates, axis=0)
    yield above("b̂ never falls: least change", -1e-15, learnt.min())
    size = np.linalg.norm(run.sliding_variable, axis=1)
    spent = float(GAIN * np.sum(size[: round(1 / PERIOD)] ** 2) * PERIOD)
    yield below("Theorem 2: ½ sᵀM̄s at 1 s, as a part of its start", 1e-3, stored[-1] / stored[0])
    rises = np.diff(stored)
    yield below("it falls all the way: largest rise, as a part of its start", 0.02, rises.max() / stored[0])
    yield below(
        "∫ sᵀKs over the first second stays finite: as a part of the energy at the start",
        10.0,
        spent / float(stored[0]),
    )
    late = float(size[round(2 / PERIOD) :].max() / size[0])
    yield below("s ends in a small neighbourhood of 0: largest after 2 s, as a part of its start", 0.05, late)
