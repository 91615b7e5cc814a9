"""What a fit says: numbers with intervals, and the modes of a ring."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval; `reason` says why it is not identifiable, and is empty if it is."""

    value: float
    low: float
    high: float
    unit: str
    reason: str = ""

    @property
    def identifiable(self) -> bool:
        """Whether the samples determine the number."""
        return not self.reason

    @property
    def text(self) -> str:
        """The number with its unit."""
        return f"{self.value:.5g} {self.unit}".rstrip()

    def __str__(self) -> str:
        if self.reason:
            return f"not identifiable: {self.reason}"
        return f"{self.text}, 95 % within {self.low:.5g} to {self.high:.5g} {self.unit}".rstrip()


@dataclass(frozen=True)
class RingMode:
    """One decaying oscillation."""

    frequency: Estimate
    """Undamped, √(ω² + σ²)/2π, Hz."""
    damping_ratio: Estimate
    """ζ = σ/√(ω² + σ²)."""
    amplitude: float
    """Amplitude at the first sample, in the signal's unit."""


@dataclass(frozen=True)
class RingFit:
    """The modes of a signal, by frequency; modes without an identifiable frequency are left out, except the loudest."""

    modes: tuple[RingMode, ...]
    noise: float
    """Standard deviation of the residual, in the signal's unit."""
    start: float
    end: float
    """First and last instant, s."""
    samples: int
    background: np.ndarray = field(compare=False, repr=False)
    """The background about which the signal rings, in its unit, (N,)."""
    problem: str = ""
    """Why this is no ring; empty if it is one."""
    halves: tuple[float, float] | None = None
    """Frequencies of the loudest mode in the first and in the second half of its energy, Hz, if they differ; None if not."""

    @property
    def change(self) -> str:
        """A sentence on a frequency that changes during the ring; empty if it does not."""
        if self.halves is None or not self.is_ring:
            return ""
        first, second = (f"{frequency:.5g} Hz" for frequency in self.halves)
        return (
            f"The loudest mode rings at {first} in the first half of its energy and at {second} in the second: its frequency "
            "changes, or two modes are too close to be told apart. The intervals hold both."
        )

    @property
    def is_ring(self) -> bool:
        """Whether the samples hold one free ring and nothing else."""
        return not self.problem

    @property
    def first(self) -> RingMode:
        """The loudest mode."""
        return max(self.modes, key=lambda mode: mode.amplitude)
