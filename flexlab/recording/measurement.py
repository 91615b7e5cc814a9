"""Somebody's own measurement of a beam's deflection as a run of the library, beside simulations of that beam.

The run has what was measured, and is without a number (NaN) in all that was not: it is listed, shown, exported and compared
as any other, but nothing is drawn of it in space, and it cannot be replayed. Its status is "measured".
"""

import hashlib
from pathlib import Path

import numpy as np

from flexlab.recording.importing import take_run
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import file_word, list_runs
from flexlab.scenario import Scenario
from flexlab.sim.row_layout import row_length, rows_to_samples
from flexlab.sim.samples import MEASURED, Run, Status
from flexlab.sim.signals import MIDSPAN, QUASI_STATIC, TIME, own_signals

NOTE = "measured"
"""In the notes: a digest of the samples and of the scenario that they are held against."""


def take_measurement(
    source: Path, scenario: Scenario, time: np.ndarray, deflection: np.ndarray, rest: np.ndarray, what: str, logs: Path
) -> Path:
    """Take the deflection at mid-span (N,), m, at `time` (N,), s, rising, into `logs`; returns the recording.

    Time is counted from the first sample, as in a comparison. `rest` (N,), m: what it rings about, so that the difference is
    the run's vibration. `scenario`: what the beam is believed to be; `what`: which data these are, in words. The same data are
    taken in once. Raises `RecordingError`.
    """
    digest = _digest(scenario, time, deflection, rest)
    for run in list_runs(logs):
        if read_notes(run).get(NOTE) == digest:
            return run
    own = own_signals(scenario)
    arms = len(scenario.arms)
    rows = np.full((len(time), row_length(arms, scenario.payload.coordinate_count, own)), np.nan)
    rows[:, TIME], rows[:, MIDSPAN], rows[:, QUASI_STATIC] = time - time[0], deflection, rest
    said = f"Measured, not simulated: {what}."
    status = Status(MEASURED, said, float(rows[-1, TIME]))
    run = Run(**rows_to_samples(rows, arms, own).signals(), scenario=scenario, status=status)
    info = RunInfo(file_word(source.stem), scenario, float(np.median(np.diff(time))), measured=said)
    return take_run(run, info, source.name, logs, **{NOTE: digest})


def _digest(scenario: Scenario, *arrays: np.ndarray) -> str:
    found = hashlib.sha256(scenario.model_dump_json().encode())
    for array in arrays:
        found.update(np.ascontiguousarray(array, float).tobytes())
    return found.hexdigest()
