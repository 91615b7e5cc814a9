"""One table of signals: documentation, rows, recordings and exports follow from it; a law's own signals come along."""

import copy
import pickle
import pydoc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import export_run

import flexlab
from flexlab.analysis.replay import replay
from flexlab.analysis.result import result_hash
from flexlab.presets import load_preset
from flexlab.recording.codec import decode_block, encode_block
from flexlab.recording.export import import_run
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.signal import ARM, COORDINATE
from flexlab.sim.samples import Run, Samples, empty_samples, join_blocks
from flexlab.sim.signals import DERIVED, TABLE
from flexlab.sim.simulate import simulate


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(load_preset("paper"), 0.1)


def test_the_help_shows_units_and_shape_of_every_array():
    text = pydoc.render_doc(flexlab.Run, renderer=pydoc.plaintext)
    for signal in (*TABLE.values(), *DERIVED.values()):
        assert f"{signal.name} -- {signal.text}" in text
        assert signal.shape_text in signal.text
        assert signal.unit_text in signal.text or signal.units == ("1",)


def test_every_signal_has_the_shape_that_the_table_says(run: Run):
    for signal in TABLE.values():
        assert run[signal.name].shape == (len(run), *signal.shape(2, run.scenario.payload.coordinate_count))
        assert not run[signal.name].flags.writeable
    nothing = empty_samples(1, 5)
    for signal in TABLE.values():
        assert nothing[signal.name].shape == (0, *signal.shape(1, 5))


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda run: pickle.loads(pickle.dumps(run))])
def test_a_copy_of_a_run_is_read_only_too(run: Run, copied: Callable[[Run], Run]):
    for source in (run, run.take(run.time < 0.05), run.having(mine=np.zeros(len(run)))):
        again = copied(source)
        assert result_hash(again) == result_hash(source)
        assert not any(array.flags.writeable for array in again.signals().values())
    assert (copied(run).scenario, copied(run).status) == (run.scenario, run.status)


def test_the_owner_of_an_array_may_go_on_to_write():
    times = np.zeros(3)
    assert not Samples(time=times).time.flags.writeable
    times[0] = 1.0


@pytest.mark.parametrize("rows", [None, 3, np.int64(3), "pose", ((0, 1), (2, 3)), ...])
def test_rows_are_taken_by_a_slice_or_a_list(run: Run, rows: Any):
    with pytest.raises(TypeError, match=r"names no rows: give a slice or a list, as in take\(\[0, 1\]\)"):
        run.take(rows)
    assert len(run.take([0, 3])) == 2


def test_a_signal_has_one_unit_or_one_for_each_entry():
    for signal in TABLE.values():
        last = signal.axes[-1] if signal.axes else None
        assert len(signal.units) in {1, 0 if last is None else len(last.labels)}
        assert last != ARM or len(signal.units) == 1
        assert last != COORDINATE or len(signal.units) == 2


def test_a_missing_signal_is_absent_and_not_an_error(run: Run, tmp_path: Path):
    """Samples of an older version, which lack signals, can be opened, joined, exported, recorded and replayed."""
    lost = {"saturated", "moving_force", "quasi_static_deflection", "joint_torque", "beam_rates"}
    older = Samples(**{name: signal for name, signal in run.signals().items() if name not in lost})
    found = decode_block(encode_block(older))[0]
    assert found.absent == lost
    for name in lost:
        assert found[name].shape == run[name].shape
        assert np.isnan(found[name]).all()
    assert np.isnan(found.vibration).all()
    assert join_blocks([found, found]).absent == lost
    short = Run(**older.signals(), scenario=run.scenario, status=run.status)
    back, _ = import_run(export_run(short, tmp_path / "run.csv"))
    assert back.absent == lost
    np.testing.assert_array_equal(back.pose, run.pose)
    recording = read_recording(write_run(short, tmp_path, "paper"))
    assert recording.samples.absent == lost
    found = replay(recording)
    assert found.identical
    assert all(name in found.text for name in lost)


def test_a_signal_of_a_newer_version_is_kept(run: Run, tmp_path: Path):
    newer = run.slice(0, 20).having(temperature=np.linspace(20.0, 30.0, 20))
    found = decode_block(encode_block(newer))[0]
    np.testing.assert_array_equal(found["temperature"], newer.own["temperature"])
    assert np.isnan(join_blocks([found, run.slice(20, 30)]).own["temperature"][20:]).all()
    again = Run(**newer.signals(), scenario=run.scenario, status=run.status)
    recording = read_recording(write_run(again, tmp_path, "newer"))
    np.testing.assert_array_equal(recording.samples["temperature"], newer.own["temperature"])
    assert replay(recording).identical


def test_an_unknown_signal_name_is_refused_with_the_names_that_exist(run: Run):
    with pytest.raises(AttributeError, match=r"no signal temprature: there are time, pose, .*vibration"):
        run["temprature"]
