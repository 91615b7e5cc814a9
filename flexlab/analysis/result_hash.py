"""One short text that says whether two results are the same, bit for bit, wherever they were computed."""

import hashlib

import numpy as np

from flexlab.sim.samples import Samples

DIGITS = 16
"""Of a hash, hexadecimal: two different results share it by chance once in 2⁶⁴."""


class ResultHash:
    """Hash of the samples of a run, gathered in blocks of any size: the same for lab, shell, Python and a file of them."""

    def __init__(self) -> None:
        self._signals: dict[str, hashlib._Hash] = {}

    def update(self, samples: Samples) -> None:
        """Take in the next block."""
        for name, values in samples.signals().items():
            hashed = self._signals.setdefault(name, hashlib.sha256())
            hashed.update(np.ascontiguousarray(values, dtype="<f8").tobytes())

    def text(self) -> str:
        """The hash of all blocks so far, `DIGITS` hexadecimal digits."""
        whole = hashlib.sha256()
        for name in sorted(self._signals):
            whole.update(name.encode() + self._signals[name].digest())
        return whole.hexdigest()[:DIGITS]


def result_hash(samples: Samples) -> str:
    """The hash of a run, or of a part of one."""
    gathered = ResultHash()
    gathered.update(samples)
    return gathered.text()
