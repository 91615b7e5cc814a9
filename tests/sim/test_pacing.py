"""How simulation time follows a wall time that is set by hand."""

import pytest

from flexlab.sim.pacing import BACKLOG_LIMIT, FASTEST, SLOWEST, SPEED_WINDOW, Pacing
from flexlab.sim.snapshot import TICK


def playing(speed: float = 1.0) -> Pacing:
    pacing = Pacing(speed)
    pacing.playing = True
    pacing.anchor(10.0, 0.0)
    return pacing


@pytest.mark.parametrize("speed", [SLOWEST, 0.1, 1.0, FASTEST])
def test_ticks_fall_due_in_proportion_to_wall_time(speed: float):
    """After t seconds in small frames, exactly t · speed / TICK ticks have been due."""
    pacing, tick = playing(speed), 0
    for k in range(1, 601):
        tick += pacing.due_ticks(10.0 + k / 60, tick)
        assert tick == int(k / 60 * speed / TICK + 1e-6)


def test_nothing_is_due_while_paused():
    """The target stands still."""
    pacing = playing()
    pacing.playing = False
    assert pacing.due_ticks(50.0, 0) == 0
    assert pacing.target(50.0) == pacing.target(10.0)


def test_a_short_lag_is_caught_up():
    """Below the limit, every tick is made up for."""
    pacing = playing()
    lag = 0.9 * BACKLOG_LIMIT
    assert pacing.due_ticks(10.0 + lag, 0) == int(lag / TICK + 1e-6)
    assert not pacing.too_slow(10.0 + lag)


@pytest.mark.parametrize("speed", [0.25, 1.0, 4.0])
def test_a_long_lag_is_dropped_and_flagged_for_a_second(speed: float):
    """Only the limit's worth of ticks is due; time goes on from there."""
    pacing = playing(speed)
    due = pacing.due_ticks(15.0, 0)
    assert due == int(BACKLOG_LIMIT * speed / TICK + 1e-6)
    assert pacing.too_slow(15.0)
    assert pacing.too_slow(15.0 + 0.9 * SPEED_WINDOW)
    assert not pacing.too_slow(15.0 + 1.1 * SPEED_WINDOW)
    assert pacing.due_ticks(15.1, due) == pytest.approx(0.1 * speed / TICK, abs=1)
    pacing.playing = False
    assert not pacing.too_slow(15.1), "a run that stands is not slow"


def test_the_actual_speed_is_measured_over_the_last_second():
    """Half speed is measured as a half, and a change is seen after a second."""
    pacing = playing()
    for k in range(240):
        pacing.note(10.0 + k / 60, 0.5 * k / 60)
    assert pacing.actual_speed() == pytest.approx(0.5)
    for k in range(240, 310):
        pacing.note(10.0 + k / 60, 2.0 + 2.0 * (k - 240) / 60)
    assert pacing.actual_speed() == pytest.approx(2.0, rel=0.02)


def test_the_actual_speed_is_zero_while_paused_or_unknown():
    pacing = playing()
    assert pacing.actual_speed() == 0.0
    pacing.note(10.0, 0.0)
    assert pacing.actual_speed() == 0.0
    pacing.note(10.5, 0.5)
    pacing.playing = False
    assert pacing.actual_speed() == 0.0
