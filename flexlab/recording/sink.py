"""What takes a run as it is encoded: a file, live viewers, or a file that nobody waits for."""

from collections.abc import Iterable
from typing import Literal, Protocol

import numpy as np
import rerun as rr

from flexlab.recording.recorded_plots import PlotSignal
from flexlab.recording.rerun_internals.columns import Column

Kept = Literal["no", "as it was", "as it stands"]
"""Whether a file that begins later in the run is told: not, as it was then, or from its beginning on (the latest only)."""


class Sink(Protocol):
    """One place that a run goes to. It tells of its own troubles; the encoder does not wait for it."""

    def send(
        self, entity: str, time: np.ndarray, columns: Iterable[Column], *, exact: bool = False, kept: Kept = "no"
    ) -> None:
        """Take columns for the instants `time` (N,), s. `exact`: only for who keeps samples in full precision."""

    def name_curves(self, signals: Iterable[PlotSignal]) -> None:
        """Take what the curves are called that will be sent, and how they look."""

    def send_property(self, name: str, values: rr.AsComponents) -> None:
        """Take a property, as seen in listings."""
