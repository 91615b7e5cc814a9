"""Thinned signals keep every peak, whatever the blocks they come in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexlab.lab.plots.envelope import BINS, Envelope
from flexlab.sim.snapshot import TICK


def ring(count: int, frequency: float = 44.0) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(count) * TICK
    return time, np.stack([np.sin(2 * np.pi * frequency * time), 0.1 * time])


def test_a_44_hz_ring_is_a_band_of_its_full_width() -> None:
    time, values = ring(30_000)
    envelope = Envelope(2, 30.0)
    envelope.append(time, values)
    _, lines = envelope.lines()
    band = lines[0].reshape(-1, 2)
    full = band[~np.isnan(band).any(axis=1)]
    assert len(full) > 0.99 * BINS
    assert (np.abs(full[:, 0] - full[:, 1]) > 1.99).all()


@pytest.mark.parametrize("block", [1, 7, 72, 101, 10_000])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_slow_signal_stays_monotonic_whatever_the_blocks(block: int, sign: int) -> None:
    time, values = ring(10_000)
    envelope = Envelope(2, 10.0)
    for start in range(0, len(time), block):
        envelope.append(time[start : start + block], sign * values[:, start : start + block])
    line = sign * envelope.lines()[1][1]
    assert (np.diff(line[~np.isnan(line)]) > 0).all()


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.integers(1, 400), min_size=1, max_size=30),
    st.sampled_from([0.1, 0.5, 2.0, 5.0, 30.0]),
    st.integers(0, 99),
)
def test_blocks_do_not_matter_and_no_peak_is_lost(blocks: list[int], window: float, seed: int) -> None:
    count = sum(blocks)
    time = np.arange(count) * TICK
    values = np.random.default_rng(seed).normal(size=(3, count))
    whole, pieces = Envelope(3, window), Envelope(3, window)
    whole.append(time, values)
    start = 0
    for block in blocks:
        overlap = max(start - 7, 0)
        pieces.append(time[overlap : start + block], values[:, overlap : start + block])
        start += block
    np.testing.assert_array_equal(whole.extent(), pieces.extent())
    lines = np.sort(whole.lines()[1][:, ~np.isnan(whole.lines()[1]).any(axis=0)], axis=1)
    other = np.sort(pieces.lines()[1][:, ~np.isnan(pieces.lines()[1]).any(axis=0)], axis=1)
    np.testing.assert_array_equal(lines, other)
    width = round(whole.bin_width / TICK)
    first_kept = max(0, ((count - 1) // width - BINS) * width)
    np.testing.assert_array_equal(whole.extent(), np.abs(values[:, first_kept:]).max(axis=1))


@pytest.mark.parametrize("window", [0.1, 1.0, 5.0, 30.0])
def test_the_axis_spans_the_same_time_from_the_first_sample_on(window: float) -> None:
    envelope = Envelope(1, window)
    spans = set()
    for start in range(0, 40_000, 997):
        time = (start + np.arange(997)) * TICK
        envelope.append(time, np.zeros((1, 997)))
        shown, _ = envelope.lines()
        spans.add(round(float(shown[-1] - shown[0]), 6))
        assert shown[0] - 1e-9 <= time[-1] <= shown[-1] + envelope.bin_width + 1e-9
    assert len(spans) == 1
    assert spans.pop() == pytest.approx(BINS * envelope.bin_width, rel=0.01)


def test_a_gap_in_time_stays_empty() -> None:
    envelope = Envelope(1, 1.0)
    envelope.append(np.arange(100) * TICK, np.ones((1, 100)))
    envelope.append((np.arange(100) + 500) * TICK, np.ones((1, 100)))
    time, lines = envelope.lines()
    inside = (time > 0.15) & (time < 0.45)
    assert np.isnan(lines[0, inside]).all()
    assert (lines[0, (time > 0.51) & (time < 0.59)] == 1).all()


def test_clearing_forgets() -> None:
    envelope = Envelope(1, 1.0)
    envelope.append(np.arange(100) * TICK, np.ones((1, 100)))
    envelope.clear()
    assert envelope.newest == -1
    assert np.isnan(envelope.lines()[1]).all()
