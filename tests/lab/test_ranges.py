"""Plot ranges grow at once, shrink late and take only round values."""

import pytest

from flexlab.lab.ranges import SHRINK_AFTER, Range, Span, round_up


def test_rounding_up_takes_the_next_round_value() -> None:
    assert [round_up(value) for value in (0.7, 1.0, 1.01, 2.0, 4.9, 5.1, 8.1)] == [0.8, 1, 1.5, 2, 5, 6, 10]
    assert round_up(0.0012) == pytest.approx(0.0015)
    assert round_up(262 * 1.05) == 300, "262 J fill most of their axis"
    assert round_up(0.0) == 0.0
    assert round_up(float("nan")) == 0.0
    assert round_up(float("inf")) == 0.0


def test_a_range_grows_at_once_and_shrinks_late() -> None:
    span = Range(0.1)
    span.fit(17.0)
    limits = [span.limit]
    for _ in range(SHRINK_AFTER):
        span.fit(0.7)
        limits.append(span.limit)
    assert limits == [20.0] * SHRINK_AFTER + [0.8]


def test_a_returning_peak_keeps_the_range() -> None:
    span = Range(0.1)
    span.fit(17.0)
    for _ in range(10):
        for _ in range(SHRINK_AFTER - 1):
            span.fit(0.7)
        span.fit(16.0)
    assert span.limit == 20.0


def test_a_range_never_falls_below_its_least_limit() -> None:
    span = Range(0.1)
    for _ in range(3 * SHRINK_AFTER):
        span.fit(0.0)
    assert span.limit == 0.1


def test_each_side_reaches_as_far_as_its_signals_go() -> None:
    span = Span(0.1)
    assert span.ends == (-0.1, 0.1), "before the first signal"
    span.fit(-0.3, 17.0)
    assert span.ends == (-2.0, 20.0), "a small side keeps room to be read"
    span = Span(0.1)
    span.fit(0.0, 3.0)
    assert span.ends == (0.0, 4.0), "energy does not go below 0"
    span.fit(-0.004, 3.0)
    assert span.ends == (0.0, 4.0), "what nobody can see gets no room"
    span = Span(0.1)
    span.fit(-4.0, -3.0)
    assert span.ends == (-5.0, 0.0)
