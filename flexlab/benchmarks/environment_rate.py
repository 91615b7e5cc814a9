"""How many steps per second the vector environment takes, on one core and on all."""

import os
import time
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexlab.gym_environment import TwoArmsVector

RATE_GOAL = 4e5
"""Steps/s on two cores."""

WORLDS = 64

STEPS = 500
"""Control periods of a round, 0.5 s: no episode ends within it."""

PUSH = 0.2
"""Largest action: such pushes, drawn anew for each period, leave all worlds where they can go on."""


@dataclass(frozen=True)
class EnvironmentRate:
    """World steps per second at 1 kHz control, the paper's scenario."""

    worlds: int
    cores: int
    """That all cores are."""
    one_core: float
    """Per second of processor time, on one thread."""
    all_cores: float
    """Per second of wall time, with all the machine's load."""


def measure_environment(rounds: int) -> EnvironmentRate | None:
    """The best of `rounds` rounds on one core and on all, in turn; None where Gymnasium is not installed."""
    if find_spec("gymnasium") is None:
        return None
    from flexlab.gym_environment import TwoArmsVector

    one, every = TwoArmsVector(WORLDS, threads=1), TwoArmsVector(WORLDS)
    try:
        actions = np.random.default_rng(0).uniform(-PUSH, PUSH, (STEPS, WORLDS, 3))
        times = np.array([[_round(one, actions)[1], _round(every, actions)[0]] for _ in range(rounds)])
    finally:
        one.close()
        every.close()
    best = WORLDS * STEPS / times.min(axis=0)
    return EnvironmentRate(WORLDS, os.cpu_count() or 1, float(best[0]), float(best[1]))


def _round(envs: "TwoArmsVector", actions: np.ndarray) -> tuple[float, float]:
    """Wall time, and this thread's processor time, s."""
    envs.reset(seed=0)
    wall, cpu = time.perf_counter(), time.thread_time()
    for action in actions:
        envs.step(action)
    return time.perf_counter() - wall, time.thread_time() - cpu
