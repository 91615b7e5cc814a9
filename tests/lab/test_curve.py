"""Thinned signals keep every peak at its own time, whatever blocks they arrive in."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexlab.lab.plots.chart import STRETCHES, Curve, compact, drawn_points
from flexlab.sim.snapshot import TICK


def ring(count: int, frequency: float = 44.0) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(count) * TICK
    return time, np.stack([np.sin(2 * np.pi * frequency * time), 0.1 * time])


def drawn(curve: Curve, seen: tuple[float, float] = (0.0, 1.0)) -> tuple[np.ndarray, np.ndarray]:
    """Times (P,) s and values (signals, P) as a chart draws them."""
    start = curve.start
    block = curve.block(start)
    points = drawn_points(block, seen)
    return (start + points) * TICK, block[:, points]


def test_a_44_hz_ring_is_drawn_as_a_band_of_its_full_height() -> None:
    time, values = ring(30_000)
    curve = Curve(2, 30.0)
    curve.append(time, values)
    shown, lines = drawn(curve)
    for first in np.arange(shown[0], time[-1] - curve.stretch * TICK, curve.stretch * TICK):
        inside = lines[0, (shown > first - 1e-6) & (shown < first + curve.stretch * TICK + 1e-6)]
        assert np.ptp(inside[~np.isnan(inside)]) > 1.99


@pytest.mark.parametrize("block", [1, 7, 72, 101, 10_000])
@pytest.mark.parametrize("seen", [(0.0, 1.0), (0.3, 0.37)])
def test_every_drawn_point_is_a_sample_at_its_own_time(block: int, seen: tuple[float, float]) -> None:
    """So no smooth signal is drawn as a staircase: the drawn points lie on the signal at every zoom."""
    time, values = ring(10_000, 3.0)
    curve = Curve(2, 10.0)
    for start in range(0, len(time), block):
        curve.append(time[start : start + block], values[:, start : start + block])
    shown, lines = drawn(curve, seen)
    known = ~np.isnan(lines[0])
    truth = np.stack([np.sin(2 * np.pi * 3.0 * shown), 0.1 * shown])
    np.testing.assert_allclose(lines[:, known], truth[:, known], rtol=0, atol=1e-12)
    assert (np.diff(shown) > 0).all()


@pytest.mark.parametrize(("seen", "worst"), [((0.0, 1.0), 0.4), ((0.2, 0.4), 0.1), ((0.5, 0.52), 1e-9)])
def test_the_line_is_finer_where_it_is_zoomed_into(seen: tuple[float, float], worst: float) -> None:
    """A 10 Hz ring in a 10 s window: the closer the zoom, the closer the line between the points is to the signal."""
    time, values = ring(10_000, 10.0)
    curve = Curve(2, 10.0)
    curve.append(time, values)
    shown, lines = drawn(curve, seen)
    known = ~np.isnan(lines[0])
    inside = (time >= seen[0] * 10 + 0.1) & (time <= min(seen[1] * 10, 9.8) - 0.01)
    between = np.interp(time[inside], shown[known], lines[0, known])
    assert np.abs(between - values[0, inside]).max() <= worst
    assert len(shown) < 6 * STRETCHES


@settings(max_examples=60)
@given(
    st.lists(st.integers(1, 400), min_size=1, max_size=30),
    st.sampled_from([0.1, 0.5, 2.0, 5.0, 30.0]),
    st.integers(0, 99),
)
def test_a_curve_does_not_depend_on_its_blocks_and_loses_no_peak(blocks: list[int], window: float, seed: int) -> None:
    count = sum(blocks)
    time = np.arange(count) * TICK
    values = np.random.default_rng(seed).normal(size=(3, count))
    whole, pieces = Curve(3, window), Curve(3, window)
    whole.append(time, values)
    start = 0
    for block in blocks:
        overlap = max(start - 7, 0)
        pieces.append(time[overlap : start + block], values[:, overlap : start + block])
        start += block
    for one, other in zip(drawn(whole), drawn(pieces), strict=True):
        np.testing.assert_array_equal(one, other)
    lines = drawn(whole)[1]
    inside = values[:, whole.start :]
    np.testing.assert_array_equal(np.nanmax(lines, axis=1), inside.max(axis=1))
    np.testing.assert_array_equal(np.nanmin(lines, axis=1), inside.min(axis=1))


@pytest.mark.parametrize("window", [0.02, 0.1, 1.0, 5.0, 30.0])
def test_the_axis_spans_the_same_time_from_the_first_sample_on(window: float) -> None:
    curve = Curve(1, window)
    for start in range(0, 40_000, 997):
        time = (start + np.arange(997)) * TICK
        curve.append(time, np.zeros((1, 997)))
        shown, _ = drawn(curve)
        assert shown[-1] - shown[0] == pytest.approx(STRETCHES * curve.stretch * TICK)
        assert shown[0] - 1e-9 <= time[-1] <= shown[-1] + 1e-9


def test_a_gap_in_time_stays_empty() -> None:
    curve = Curve(1, 1.0)
    curve.append(np.arange(100) * TICK, np.ones((1, 100)))
    curve.append((np.arange(100) + 500) * TICK, np.ones((1, 100)))
    time, lines = drawn(curve)
    inside = (time > 0.0995) & (time < 0.4995)
    assert inside.sum() >= 2
    assert np.isnan(lines[0, inside]).all()
    assert (lines[0, (time < 0.0995) | ((time > 0.4995) & (time < 0.5995))] == 1).all()


def test_clearing_a_curve_removes_its_samples() -> None:
    curve = Curve(1, 1.0)
    curve.append(np.arange(100) * TICK, np.ones((1, 100)))
    curve.clear()
    assert curve.newest == -1
    assert np.isnan(curve.block(curve.start)).all()


@pytest.mark.filterwarnings("error")
def test_numbers_too_large_for_a_chart_are_drawn_at_its_edge() -> None:
    line = np.array([1e300, -np.inf, np.nan, 2.5])
    _, drawn = compact(np.arange(4.0), [line], 1.0)
    assert drawn.dtype == np.float32
    assert np.array_equal(np.isfinite(drawn), [True, True, False, True])
    assert drawn[0] > 1e38
    assert drawn[1] < -1e38
    assert drawn[3] == 2.5


def test_hours_without_samples_take_no_memory() -> None:
    time, values = ring(2000)
    curve = Curve(2, 1.0)
    curve.append(time, values)
    tracemalloc.start()
    curve.append(time + 8 * 3600, values)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1e6
    shown, lines = drawn(curve)
    known = ~np.isnan(lines[0])
    assert shown[known][-1] == pytest.approx(8 * 3600 + time[-1])
    np.testing.assert_array_equal(lines[1][known], 0.1 * time[np.rint((shown[known] - 8 * 3600) / TICK).astype(int)])
