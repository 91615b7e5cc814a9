"""The few numbers that tell how a run went, gathered block by block so that long runs need no memory."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.explanations import Background, Evidence, explain
from flexlab.analysis.metrics.run_metrics import value_text
from flexlab.analysis.metrics.settling_time import SettlingTime
from flexlab.errors import FlexlabError
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples, Status

if TYPE_CHECKING:
    from rich.table import Table

MOST_EXPLAINED = 3
"""Sentences of a report: the most important ones."""
START_SPAN = 1.0
"""s: what counts as the start, in which the paper's controller has caught the path and the beam has calmed down."""


def explained(samples: Samples, scenario: Scenario) -> list[str]:
    """What can be said of a run's newest samples, a line per sentence; none where a scenario has no modes."""
    try:
        background = Background.of(scenario)
    except FlexlabError:
        return []
    found = explain(Evidence.of_run(samples, background, start=0.0))
    return [f"{each.plot}: {each.sentence} ({each.equation})" for each in found[:MOST_EXPLAINED]]


class Summary:
    """Largest magnitudes over the start and over the rest of a run."""

    def __init__(self) -> None:
        self.count = 0
        self.time = 0.0
        self._peaks: dict[str, np.ndarray] = {}
        self._settling = SettlingTime()

    def add(self, samples: Samples) -> None:
        """Take in the next block."""
        if len(samples) == 0:
            return
        self.count += len(samples)
        self._settling.update(samples)
        self.time = float(samples.time[-1])
        signals = {
            "error": samples.tracking_error,
            "deflection": samples.midspan_deflection[:, None],
            "vibration": samples.vibration[:, None],
            "internal": np.linalg.norm(samples.internal_force[..., :2], axis=-1),
            "torque": samples.joint_torque.reshape(len(samples), -1),
        }
        early = samples.time <= START_SPAN
        for name, signal in signals.items():
            for part, rows in (("start", early), ("later", ~early)):
                if rows.any():
                    peak = np.abs(signal[rows]).max(axis=0)
                    key = f"{name} {part}"
                    self._peaks[key] = np.maximum(self._peaks.get(key, 0.0), peak)

    def settling_text(self) -> str:
        """When the vibration had died away, in a sentence."""
        (column,), (seconds,) = self._settling.columns, self._settling.compute()
        return (
            f"{column.title} {value_text(column, seconds)} s."
            if seconds == seconds
            else f"Vibration: {column.missing}."
        )

    def table(self, status: Status) -> "Table":
        """The numbers as a table for the terminal."""
        from rich.table import Table

        table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), title_justify="left")
        table.add_column("largest")
        table.add_column(f"0 to {min(START_SPAN, self.time):g} s", justify="right")
        table.add_column(f"{START_SPAN:g} to {self.time:g} s" if self.time > START_SPAN else "later", justify="right")
        rows = [
            ("tracking error x, mm", "error", 0, 1e3),
            ("tracking error y, mm", "error", 1, 1e3),
            ("tracking error θ, mrad", "error", 2, 1e3),
            ("mid-span deflection, mm", "deflection", None, 1e3),
            ("of it vibration, mm", "vibration", None, 1e3),
            ("internal force, N", "internal", None, 1.0),
            ("joint torque, N·m", "torque", None, 1.0),
        ]
        for label, name, axis, scale in rows:
            table.add_row(label, *(self._cell(f"{name} {part}", axis, scale) for part in ("start", "later")))
        return table

    def _cell(self, key: str, axis: int | None, scale: float) -> str:
        if key not in self._peaks:
            return "-"
        peak = self._peaks[key]
        return f"{scale * (peak.max() if axis is None else peak[axis]):.4g}"
