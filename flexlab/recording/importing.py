"""Import of runs into a logs folder: a recording as it is, an exported table as a recording with the same bits."""

import contextlib
import hashlib
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from flexlab.errors import RecordingError
from flexlab.recording.codec import event_from_values, state_from_values
from flexlab.recording.export import FORMATS, import_run, reason_of
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.reader import read_recording
from flexlab.recording.repair import finish
from flexlab.recording.run_encoder import is_end
from flexlab.recording.run_info import RunInfo, makers
from flexlab.recording.store.formats import checked_format
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.people import LONGEST_NAME
from flexlab.recording.store.run_files import SUFFIX, claim_run_file, file_word, list_runs, remove_run
from flexlab.recording.table_columns import check_events, check_period, checked_blocks
from flexlab.scenario import Scenario
from flexlab.sim.samples import MEASURED, Run, Status, row_length, rows_to_samples
from flexlab.sim.signals import MIDSPAN, QUASI_STATIC, TIME, own_signals
from flexlab.sim.snapshot import TICK, Event
from flexlab.text import number_text, visible

IMPORTED = (SUFFIX, *FORMATS)
"""Endings of files that can be imported."""


def check_format(name: str) -> None:
    """Raise `RecordingError` for the name of a file that is neither a recording nor an exported table."""
    ending = Path(name).suffix.lower()
    if ending not in IMPORTED:
        archived = " From an archive, take run.rrd." if ending == ".zip" else ""
        raise RecordingError(
            f"{visible(name, 60)} has no known format: choose a file that ends in {', '.join(IMPORTED)}.{archived}"
        )


def import_into(path: Path, logs: Path, **notes: str) -> Path:
    """Import a recording or an exported run into `logs`, and return the new recording. The file itself is not changed.

    `notes` are written beside the run; its "note" lists columns that were left out. Raises `RecordingError`, and leaves nothing
    in `logs`, for a file without a run or if `logs` cannot be written.
    """
    check_format(path.name or str(path))
    return _take_recording(path, logs, notes) if path.suffix.lower() == SUFFIX else _take_table(path, logs, notes)


def _take_recording(path: Path, logs: Path, notes: Mapping[str, str]) -> Path:
    recording = read_recording(path)
    check_period(path.name, recording.sample_period)
    check_events(path.name, recording.events)
    checked = checked_blocks(path.name, recording.blocks())
    times = [(float(block.time[0]), float(block.time[-1]), len(block)) for block in checked]
    begin, end = (times[0][0], times[-1][1]) if times else (0.0, 0.0)
    file = claim_run_file(logs, recording.name, recording.started)
    try:
        with path.open("rb") as source:
            shutil.copyfileobj(source, file.handle)
        os.fsync(file.handle.fileno())
        write_notes(
            file.path, ended=recording.state == "complete", preset=recording.name,
            started=recording.started.isoformat(timespec="seconds"), status=str(recording.status), begins=begin,
            duration=end - begin, rows=sum(rows for *_, rows in times), imported=path.name,
            **({"why_stopped": recording.status.text} if recording.status.failed else {}), **notes,
        )  # fmt: skip
    except BaseException as error:
        file.release()
        remove_run(file.path)
        if isinstance(error, OSError):
            raise RecordingError(f"{path.name} cannot be copied into {logs} ({error.strerror}): make room.") from None
        raise
    file.release()
    with contextlib.suppress(RecordingError):  # Finishing needs room; all of the run is there.
        finish(file.path)
    return file.path


def _take_table(path: Path, logs: Path, notes: Mapping[str, str]) -> Path:
    run, metadata = import_run(path)
    if len(run) == 0:
        raise RecordingError(f"{path.name} has no samples: there is nothing to import.")
    try:
        info, events = _info(run, metadata), [event_from_values(values) for values in metadata.get("events", [])]
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise RecordingError(f"{path.name} was not exported by this version of flexlab ({reason_of(error)}).") from None
    check_period(path.name, info.sample_period)
    if said := " ".join(filter(None, (metadata["left_out"], _missing_text(run.time, info.sample_period)))):
        notes = {"note": said, **notes}
    return take_run(run, info, path.name, logs, [event for event in events if not is_end(event)], **notes)


def take_run(run: Run, info: RunInfo, source: str, logs: Path, events: Sequence[Event] = (), **notes: str) -> Path:
    """Write a run that came from the file `source` into `logs`, whole or not at all, and return the recording.

    Raises `RecordingError`.
    """
    check_period(source, info.sample_period)
    recording = HeadlessRecording(logs, info, in_one_piece=True)
    try:
        with recording:
            recording.write_whole(run, events)
        write_notes(recording.path, imported=source, **notes)
    except BaseException as error:
        with contextlib.suppress(RecordingError):
            remove_run(recording.path)
        if isinstance(error, OSError):
            raise RecordingError(f"{source} cannot be taken into {logs} ({error.strerror}): make room.") from None
        raise
    return recording.path


def _missing_text(time: np.ndarray, period: float) -> str:
    """Which samples are missing between times (N,), s, of a run that was sampled every `period`, s; empty if none are."""
    missed = np.rint(np.diff(time) / period).astype(int) - 1
    gaps = np.flatnonzero(missed > 0)
    if len(gaps) == 0:
        return ""
    first, last = (number_text(value) for value in time[gaps[0] : gaps[0] + 2])
    where = f"between {first} s and {last} s" if len(gaps) == 1 else f"in {len(gaps)} places, first after {first} s"
    return f"Samples missing, {where}: {missed[gaps].sum()}."


def _info(run: Run, metadata: Mapping[str, Any]) -> RunInfo:
    period = float(metadata.get("sample_period_s") or (run.time[1] - run.time[0] if len(run) > 1 else TICK))
    start = metadata.get("start")
    computed_in = checked_format(metadata.get("computed_in", metadata.get("format", 1)))
    info = RunInfo(
        visible(metadata.get("preset") or "imported", LONGEST_NAME),
        run.scenario,
        period,
        None if start is None else state_from_values(start),
        measured=run.status.text if run.status == MEASURED else "",
        recorded_by=makers(metadata, computed_in),
    )
    return replace(info, started=datetime.fromisoformat(metadata["started"])) if "started" in metadata else info


NOTE = "measured"
"""Key in the notes: a digest of the samples and of the scenario that they are compared with."""


def take_measurement(
    source: Path, scenario: Scenario, time: np.ndarray, deflection: np.ndarray, rest: np.ndarray, what: str, logs: Path
) -> Path:
    """Record a measured deflection at mid-span (N,), m, at `time` (N,), s, rising, in `logs`; return the recording.

    Time is counted from the first sample, as in a comparison. `rest` (N,), m: what the deflection rings about; the difference
    is the run's vibration. `scenario`: one with a model of the beam; `what`: a description of the data. The same data are
    recorded only once. Raises `RecordingError`.
    """
    arrays = (np.ascontiguousarray(array, float).tobytes() for array in (time, deflection, rest))
    digest = hashlib.sha256(b"".join([scenario.model_dump_json().encode(), *arrays])).hexdigest()
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
