"""The ring of recent samples that plots read."""

import threading

import numpy as np
import pytest

from flexlab.sim import samples
from flexlab.sim.history import HISTORY_SECONDS, History
from flexlab.sim.signals import TIME

SIZE = round(HISTORY_SECONDS / 0.001) + 1


def rows(start: int, count: int) -> np.ndarray:
    """Sample rows of one arm and one coordinate, numbered in time and in every other column."""
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
def test_the_last_seconds_come_oldest_first_across_the_wrap(total: int, seconds: float):
    """Both ends of the window are included, as far as there are samples."""
    found = np.rint(filled(total).recent(seconds).kinetic_energy).astype(int)
    count = min(round(seconds / 0.001) + 1, total, SIZE)
    assert np.array_equal(found, np.arange(total - count, total))


def test_all_signals_of_a_row_belong_together():
    """Also across the wrap."""
    recent = filled(SIZE + 5000).recent(20.0)
    numbers = np.rint(recent.time / 0.001)
    for signal in (recent.kinetic_energy, recent.pose[:, 1], recent.joint_torque[:, 0, 2], recent.beam_rates[:, 0]):
        assert np.array_equal(np.rint(signal), numbers)


def test_a_block_longer_than_the_ring_leaves_its_end():
    """A block of 100 s, as by single steps at once."""
    history = filled(100)
    history.append(rows(100, 3 * SIZE))
    found = np.rint(history.recent(HISTORY_SECONDS).kinetic_energy).astype(int)
    assert np.array_equal(found, np.arange(100 + 2 * SIZE, 100 + 3 * SIZE))


def test_an_empty_history_has_no_samples():
    """This is the history of a run that could not start."""
    assert len(History(samples.row_length(1, 1), 1).recent(5.0)) == 0


def test_what_is_handed_out_is_a_copy():
    """Later samples do not change it."""
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
def test_the_past_comes_as_it_was_then(total: int, ago: int):
    """Beyond what is remembered, the oldest sample stands for all before it."""
    found = np.rint(filled(total).recent(0.3, ago).kinetic_energy).astype(int)
    kept = min(total, SIZE)
    end = total - min(ago, kept - 1)
    assert np.array_equal(found, np.arange(max(end - 301, total - kept), end))
