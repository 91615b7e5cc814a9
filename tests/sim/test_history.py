"""The ring buffer of recent samples that plots read."""

import threading

import numpy as np
import pytest

from flexlab.sim import samples
from flexlab.sim.history import HISTORY_SECONDS, History
from flexlab.sim.signals import TIME

SIZE = round(HISTORY_SECONDS / 0.001) + 1


def rows(start: int, count: int) -> np.ndarray:
    """Rows for one arm and one beam coordinate: time is the row's number in ms, every other column the number itself."""
    numbers = np.arange(start, start + count, dtype=float)
    block = np.repeat(numbers[:, None], samples.row_length(1, 1), axis=1)
    block[:, TIME] = numbers * 0.001
    return block


def filled(total: int, block: int = 777) -> History:
    history = History(samples.row_length(1, 1), 1)
    for start in range(0, total, block):
        history.append(rows(start, min(block, total - start)))
    return history


@pytest.mark.parametrize("total", [1, 500, SIZE - 1, SIZE, SIZE + 1, 2 * SIZE + 123])
@pytest.mark.parametrize("seconds", [0.001, 0.3, 0.7, 10.0, 29.9, 60.0])
def test_the_last_seconds_come_oldest_first_even_where_the_ring_wraps(total: int, seconds: float):
    """Both ends of the window are included if there are that many samples."""
    found = np.rint(filled(total).recent(seconds).kinetic_energy).astype(int)
    count = min(round(seconds / 0.001) + 1, total, SIZE)
    assert np.array_equal(found, np.arange(total - count, total))


def test_all_signals_of_a_row_belong_together():
    """This holds where the ring wraps around, too."""
    recent = filled(SIZE + 5000).recent(20.0)
    numbers = np.rint(recent.time / 0.001)
    for signal in (recent.kinetic_energy, recent.pose[:, 1], recent.joint_torque[:, 0, 2], recent.beam_rates[:, 0]):
        assert np.array_equal(np.rint(signal), numbers)


def test_the_end_of_a_block_longer_than_the_ring_is_kept():
    """Single steps can bring blocks of 100 s; this one has 180 s."""
    history = filled(100)
    history.append(rows(100, 3 * SIZE))
    found = np.rint(history.recent(HISTORY_SECONDS).kinetic_energy).astype(int)
    assert np.array_equal(found, np.arange(100 + 2 * SIZE, 100 + 3 * SIZE))


def test_an_empty_history_has_no_samples():
    """This is the history of a run that could not start."""
    assert len(History(samples.row_length(1, 1), 1).recent(5.0)) == 0


def test_recent_samples_are_a_copy():
    """Later samples do not change them."""
    history = filled(1000)
    before = history.recent(0.5)
    kept = before.kinetic_energy.copy()
    history.append(rows(1000, 2 * SIZE))
    assert np.array_equal(before.kinetic_energy, kept)


def test_readers_see_whole_blocks_while_the_runner_writes():
    """One thread appends while another reads, and always finds contiguous numbers."""
    history = filled(SIZE)
    stop = threading.Event()

    def write() -> None:
        start = SIZE
        while not stop.is_set():
            history.append(rows(start, 64))
            start += 64

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for _ in range(200):
            numbers = np.rint(history.recent(1.0).kinetic_energy)
            assert np.array_equal(np.diff(numbers), np.ones(1000))
    finally:
        stop.set()
        writer.join()


@pytest.mark.parametrize("total", [1, 500, SIZE, 2 * SIZE + 123])
@pytest.mark.parametrize("ago", [0, 1, 400, 30_000, 10 * SIZE])
def test_recent_samples_can_be_those_of_an_earlier_instant(total: int, ago: int):
    """If the ring does not go back that far, they end at its oldest sample."""
    found = np.rint(filled(total).recent(0.3, ago).kinetic_energy).astype(int)
    kept = min(total, SIZE)
    end = total - min(ago, kept - 1)
    assert np.array_equal(found, np.arange(max(end - 301, total - kept), end))
