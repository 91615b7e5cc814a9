"""What periodic paths share: one number or three, and phases that live changes of a frequency keep."""

import numpy as np


def three(value: float | tuple[float, ...]) -> tuple[float, ...]:
    """One number as the three that it stands for."""
    return value if isinstance(value, tuple) else (value,) * 3


def squared_rate(frequency: float) -> float:
    """(2πf)², 1/s²."""
    return (2 * np.pi * frequency) * (2 * np.pi * frequency)


def kept_phase(phase: float, old: float, new: float, time: float) -> float:
    """The phase, rad, with which a new frequency, Hz, has at `time`, s, the angle that the old one had."""
    if old == new:
        return phase
    return float(np.remainder(phase + 2 * np.pi * (old - new) * time, 2 * np.pi))
