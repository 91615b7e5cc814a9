"""Derivatives along a direction by central differences."""

from collections.abc import Callable

import numpy as np


def central(function: Callable[[np.ndarray], np.ndarray], direction: np.ndarray, size: float) -> np.ndarray:
    """(f(+step) - f(-step)) / 2 size for step = size · direction: order 2."""
    step = size * direction
    return (function(step) - function(-step)) / (2 * size)


def fourth_order(function: Callable[[np.ndarray], np.ndarray], direction: np.ndarray, size: float) -> np.ndarray:
    """Richardson's combination of steps of `size` and 2 `size`: order 4."""
    return (4 * central(function, direction, size) - central(function, direction, 2 * size)) / 3
