"""The fit of a free vibration in a CSV file or a recorded run, from its samples to the beam of a scenario."""

import os
from dataclasses import dataclass, replace
from functools import cached_property
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from flexlab.analysis.identification.beam_parameters import (
    BeamParameters,
    another_mode,
    beam_parameters,
    mesh_note,
    read_measured,
)
from flexlab.analysis.identification.estimates import Estimate, RingFit
from flexlab.analysis.identification.evidence import ring_begins
from flexlab.analysis.identification.free_ring import ring_of_run
from flexlab.analysis.identification.ring import FEWEST_SAMPLES, NOISE_ALONE, fit_ring
from flexlab.analysis.result import Result, provenance
from flexlab.analysis.run_summary import note_metrics
from flexlab.arguments import time_or_none
from flexlab.errors import RecordingError, StudyError
from flexlab.presets import load_preset
from flexlab.recording.course import changed_scenario
from flexlab.recording.importing import take_measurement
from flexlab.recording.reader import read_recording
from flexlab.recording.store.run_files import SUFFIX, find_run
from flexlab.scenario import Scenario
from flexlab.sim.samples import MEASURED
from flexlab.text import counted, visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNTOLD = "paper"
"""The preset for a measurement without a scenario."""


@dataclass(frozen=True, eq=False)
class Fit(Result):
    """A fitted ring, and the beam that rings like it."""

    name: str
    """Name of the file or run."""
    ring: RingFit
    time: np.ndarray
    """s, (N,), from the beginning of the ring."""
    signal: np.ndarray
    """In `unit`, (N,)."""
    unit: str
    beam: BeamParameters | None
    """None without a scenario."""
    measured: bool
    """Whether the samples are a measurement rather than a simulated run."""
    notes: tuple[str, ...]
    """Sentences on left-out samples, and on the mesh."""

    @property
    def is_ring(self) -> bool:
        """Whether the samples hold one free ring and nothing else; if not, `ring.problem` says why."""
        return self.ring.is_ring

    @property
    def estimates(self) -> dict[str, Estimate]:
        """f1, ζ1, f2… and, with a scenario, EI, ρ and the field of the damping."""
        rows: dict[str, Estimate] = {}
        for number, mode in enumerate(self.ring.modes, start=1):
            rows[f"f{number}"], rows[f"ζ{number}"] = mode.frequency, mode.damping_ratio
        if self.beam is not None:
            found = self.beam
            rows |= {"EI": found.bending_stiffness, "ρ": found.linear_density, found.damping_field: found.damping}
        return rows

    @property
    def scenario(self) -> Scenario | None:
        """The given scenario, with the identifiable parameters of the beam."""
        return None if self.beam is None else self.beam.scenario

    @cached_property
    def table(self) -> Any:
        """A row per estimate: name, value, low, high (NaN if not identifiable, and the reason), unit, and provenance."""
        about = provenance(self.scenario)
        rows = [{"name": name, **self._row(value), **about} for name, value in self.estimates.items()]
        return pa.Table.from_pylist(rows)

    def _row(self, estimate: Estimate) -> dict[str, Any]:
        """The fields of an estimate; without numbers if the samples do not determine it, or hold no ring."""
        reason = estimate.reason or ("" if self.is_ring else self.ring.problem)
        return vars(estimate) | {"reason": reason} | (dict.fromkeys(("value", "low", "high"), nan) if reason else {})

    def plot(self) -> "Figure":
        """The samples, and the background about which they ring."""
        from flexlab.analysis.figures import draw_fit

        return draw_fit(self.time, self.signal, self.ring.background, self.unit)

    def as_data(self) -> dict[str, Any]:
        """The estimates as plain data with all digits; NaN if not identifiable."""
        rows = {name: self._row(value) for name, value in self.estimates.items()}
        rows = {name: row | {"identifiable": not row["reason"]} for name, row in rows.items()}
        about = {"samples": self.ring.samples, "noise": self.ring.noise, "change": self.ring.change}
        return {"ring": self.is_ring, **about, **rows}

    def __repr__(self) -> str:
        found = "; ".join(f"{name} = {value.text}" for name, value in self.estimates.items() if value.identifiable)
        return f"<Fit of {self.name}: {found or 'nothing identifiable' if self.is_ring else 'no ring, ' + self.ring.problem}>"

    def __str__(self) -> str:
        ring = self.ring
        span = f"t = {ring.start:.6g} s to {ring.end:.6g} s"
        lines = [f"{ring.samples} samples from {span}, noise {ring.noise:.3g} {self.unit}"]
        if not self.is_ring:
            return "\n".join([*lines, f"No ring: {ring.problem}."])
        lines += [f"  {name:<4} {value}" for name, value in self.estimates.items()]
        return "\n".join(lines + [ring.change] * bool(ring.change))


TABLES = (".csv", ".tsv", ".txt", ".dat")
"""Suffixes of files whose columns can be fitted."""


def is_measurement(source: str) -> bool:
    """Whether the source of a fit is a file with a measurement rather than a run. Raises `StudyError` if it is neither."""
    path = Path(source)
    if path.suffix.lower() in TABLES:
        return True
    if path.suffix.lower() not in ("", SUFFIX) and os.path.isfile(path):
        known = ", ".join(TABLES)
        raise StudyError(
            f"{visible(path.name, 60)} is neither a recording (.rrd) nor a table ({known}): save its columns as CSV."
        )
    return False


@np.errstate(over="ignore", invalid="ignore")  # Imported values may be of any size.
def fit_file(
    path: Path,
    time: str | None = None,
    signal: str | None = None,
    start: float | None = None,
    end: float | None = None,
    scenario: Scenario | None = None,
) -> Fit:
    """The fit of two columns of a CSV file (see `read_measured`) from `start` (None: where the ring begins) to `end`, s.

    `scenario`: the known parameters of the beam; a vice holds its grips. Raises `StudyError`.
    """
    start, end = time_or_none("start", start), time_or_none("end", end)
    found = read_measured(path, time, signal)
    t, y = _window(found.time, found.signal, start, end)
    notes = found.notes
    first = 0 if start is not None else ring_begins(y)
    if first and len(y) - first < FEWEST_SAMPLES:
        after = f"The ring begins at t = {t[first]:.6g} s, and {counted(len(y) - first, 'sample')} from there on are too few"
        raise StudyError(
            f"{after}: measure for longer, or say with start where the ring begins; {FEWEST_SAMPLES} are needed."
        )
    fit = _fit(path.stem, t[first:], y[first:], found.unit, scenario, notes, start is not None)
    if not first or fit.ring.problem == NOISE_ALONE:  # Noise has no beginning to tell of.
        return fit
    began = f"The ring begins at t = {t[first]:.6g} s, its first peak: what comes before is left out."
    return replace(fit, notes=(*notes, began, *fit.notes[len(notes) :]))


@np.errstate(over="ignore", invalid="ignore")
def fit_run(
    run: str,
    logs: Path,
    time: str | None = None,
    signal: str | None = None,
    start: float | None = None,
    end: float | None = None,
    scenario: Scenario | None = None,
) -> Fit:
    """The fit of a recorded run after its last tap or from its first ring; `scenario` None: the run's. Raises `FlexlabError`."""
    if time is not None:
        raise StudyError(f"time = {time!r:.60} names a column of a file: a run has one time, leave it out.")
    start, end = time_or_none("start", start), time_or_none("end", end)
    recording = read_recording(find_run(run, logs))
    t, y, unit = ring_of_run(recording, signal or "vibration", start, end)
    own = changed_scenario(recording.scenario, recording.events, float(t[0]))
    path = None
    if recording.status != MEASURED:  # A measurement has no loop and no pose.
        path = recording.samples.desired_pose[np.searchsorted(recording.samples.time, t)], own
    return _fit(recording.path.stem, t, y, unit, scenario or own, (), start is not None, path)


def _fit(
    name: str,
    t: np.ndarray,
    y: np.ndarray,
    unit: str,
    scenario: Scenario | None,
    notes: tuple[str, ...],
    is_chosen: bool,
    simulated: tuple[np.ndarray, Scenario] | None = None,
) -> Fit:
    """`is_chosen`: whether a person chose the start, and not where the ring begins.

    `simulated`: the desired poses of a run at `t`, (N, 3), and its scenario; None: the samples are a measurement.
    """
    ring, poses, other = fit_ring(t, y), [], ""
    if simulated is not None:
        poses = _poses(simulated[0], y - ring.background)
        other = another_mode(ring, simulated[1], poses[0])
    beam = None if scenario is None else beam_parameters(ring, scenario, simulated is not None, poses, other)
    if beam is not None and simulated is None and (note := mesh_note(beam)):
        notes += (note,)
    if beam is not None:
        along = replace(ring.first, frequency=beam.frequency, damping_ratio=beam.damping_ratio)
        ring = replace(ring, modes=tuple(along if mode is ring.first else mode for mode in ring.modes))
    start, begins = float(t[0]), float(t[ring_begins(y)]) if is_chosen else float(t[0])
    if ring.modes and (begins - start) * ring.first.frequency.value > 1:
        notes += (
            f"The ring begins at t = {begins:.6g} s, its first peak, and the fit at {start:.6g} s: frequencies and damping "
            f"ratios are wrong with what comes before the ring. Start at {begins:.6g} s, or leave the start out.",
        )
    return Fit(name, ring, t, y, unit, beam, simulated is None, notes)


POWER = (0.5, 0.05, 0.95)
"""Shares of a ring's power at which its poses are taken, the middle first."""


def _poses(path: np.ndarray, ring: np.ndarray) -> list[tuple[float, float, float]]:
    """The desired poses, from `path` (N, 3), in the middle of the power of a ring (N,) and near its ends."""
    power = np.cumsum(ring**2)
    places = np.minimum(np.searchsorted(power, np.multiply(POWER, power[-1])), len(ring) - 1)
    return list(dict.fromkeys((float(x), float(y), float(angle)) for x, y, angle in path[places]))


def keep_measurement(fit: Fit, source: Path, scenario: Scenario | None, against: str | None, logs: Path) -> Path:
    """Record a measured deflection in `logs`, to compare with a scenario called `against`. Raises `RecordingError`."""
    if fit.unit != "m":
        raise RecordingError(f"{fit.unit or 'a number without a unit'} is not a deflection.")
    held = scenario or load_preset(UNTOLD)
    what = f"{len(fit.time)} deflections from {source.name}, held against {against or UNTOLD}"
    path = take_measurement(source, held, fit.time, fit.signal, fit.ring.background, what, logs)
    note_metrics(path)
    return path


def _window(t: np.ndarray, y: np.ndarray, start: float | None, end: float | None) -> tuple[np.ndarray, np.ndarray]:
    first, last = t[0] if start is None else start, t[-1] if end is None else end
    inside = (t >= first) & (t <= last)
    if not inside.any():
        data = f"the data last from {t[0]:.6g} to {t[-1]:.6g} s"
        raise StudyError(f"There are no samples from {first:.6g} to {last:.6g} s: {data}.")
    return t[inside], y[inside]
