"""Helpers that several tests of recordings share."""

import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader
from waiting import wait_until as wait_until

from flexlab.recording.rerun_internals.chunks import quiet_reader
from flexlab.sim.samples import Samples


def assert_same_bits(found: Samples, expected: Samples) -> None:
    """Check that every signal has the same bits, NaN and -0.0 included."""
    for field in fields(Samples):
        one, other = np.asarray(getattr(found, field.name)), np.asarray(getattr(expected, field.name))
        assert one.shape == other.shape, field.name
        assert one.tobytes() == other.tobytes(), field.name


def start_script(script: str, *words: str | Path) -> "subprocess.Popen[str]":
    """Start Python code in a process of its own; its output can be read line by line."""
    command = [sys.executable, "-c", script, *map(str, words)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def opened(path: Path) -> RrdReader:
    """Rerun's reader of a file, without the warning that a live stream ends without an index."""
    with quiet_reader(path) as reader:
        return reader


def plotted(path: Path, entity: str) -> tuple[np.ndarray, np.ndarray]:
    """Times in ns and values of a plotted entity, as any client of rerun finds them."""
    times, values = [], []
    for chunk in opened(path).stream().filter(content=[entity]):
        batch = chunk.to_record_batch()
        if "sim_time" in batch.schema.names:
            times += batch.column("sim_time").cast("int64").to_pylist()
            values += batch.column("Scalars:scalars").to_pylist()
    order = np.argsort(times, kind="stable")
    return np.array(times)[order], np.array(values)[order]


def drawn_beam(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times in ns and points of the beam of all drawn states."""
    times, strips = [], []
    for chunk in opened(path).stream().filter(content=["/scene/beam"]):
        if not chunk.is_static:
            batch = chunk.to_record_batch()
            times += batch.column("sim_time").cast("int64").to_pylist()
            strips += [row[0] for row in batch.column("LineStrips3D:strips").to_pylist()]
    return np.array(times), np.array(strips)
