"""The runner's pace with a clock set by hand: every round does what is due, and reports what it could not do."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, LoadScenario, Pause, Play, Reset, SetSpeed, StepOnce
from flexlab.sim.pacing import BACKLOG_LIMIT


def time_of(snapshot) -> float:
    return float(snapshot.latest.time[0])


@pytest.mark.parametrize("speed", [1 / 256, 1 / 16, 1.0, 4.0])
def test_simulation_time_follows_wall_time(live, speed: float):
    """Two wall seconds give two seconds times the speed, within a tick; the actual speed agrees."""
    stage = live()
    stage.frame(0.0, SetSpeed(speed))
    snapshot = stage.play(2.0)
    assert time_of(snapshot) == pytest.approx(2.0 * speed, abs=0.001001)
    assert snapshot.target_speed == speed
    assert snapshot.actual_speed == pytest.approx(speed, rel=0.03 if speed > 0.1 else 0.5)
    assert not snapshot.too_slow


def test_backlog_is_dropped_and_flagged(live):
    """After a frame 5 s late, only the limit is made up for, and the flag is set for a second."""
    stage = live()
    stage.play(0.5)
    before = time_of(stage.runner.snapshot)
    snapshot = stage.frame(5.0)
    assert time_of(snapshot) - before == pytest.approx(BACKLOG_LIMIT, abs=0.0011)
    assert snapshot.too_slow
    snapshot = stage.play(1.5)
    assert not snapshot.too_slow
    assert snapshot.actual_speed == pytest.approx(1.0, rel=0.02)
    assert np.array_equal(np.rint(stage.keeper.signal("time") / 0.001), np.arange(len(stage.keeper.signal("time"))))


def test_time_does_not_jump_when_the_speed_changes(live):
    """Slower or faster, time goes on from where it is: no tick is skipped or repeated."""
    stage = live()
    last = time_of(stage.play(0.5))
    for speed in (0.1, 4.0, 1 / 256, 1.0):
        snapshot = stage.frame(0.01, SetSpeed(speed))
        assert 0 <= time_of(snapshot) - last <= 0.0121
        last = time_of(snapshot)
        now = time_of(stage.play(0.5))
        assert now - last == pytest.approx(0.5 * speed, abs=0.002)
        last = now


@pytest.mark.parametrize("speed", [0.0, -1.0, 5.0, 1 / 300, float("nan"), float("inf")])
def test_a_senseless_speed_is_refused_in_a_sentence(live, speed: float):
    """The old speed stays and the run goes on."""
    stage = live()
    stage.play(0.2)
    snapshot = stage.frame(0.0, SetSpeed(speed))
    assert snapshot.target_speed == 1.0
    assert snapshot.events[-1].level == "error"
    assert "1/256 to 4" in snapshot.events[-1].text
    before = time_of(snapshot)
    assert time_of(stage.play(0.2)) == pytest.approx(before + 0.2, abs=0.002)


def test_pause_holds_time_and_play_goes_on_without_a_jump(live):
    """The pause lasts an hour."""
    stage = live()
    stage.play(0.3)
    snapshot = stage.frame(0.0, Pause())
    stopped = time_of(snapshot)
    assert not snapshot.playing
    assert time_of(stage.play(1.0)) == stopped
    assert stage.runner.snapshot.actual_speed == 0.0
    stage.now += 3600
    snapshot = stage.frame(0.0, Play())
    assert snapshot.playing
    assert time_of(snapshot) == stopped
    assert time_of(stage.play(0.3)) == pytest.approx(stopped + 0.3, abs=0.002)
    assert not stage.runner.snapshot.too_slow


def test_single_steps_while_paused_do_exactly_the_ticks_asked_for(live):
    """The newest sample is drawn, and play goes on from there."""
    stage = live(playing=False)
    for ticks, expected in ((1, 0.001), (1, 0.002), (10, 0.012)):
        snapshot = stage.frame(0.5, StepOnce(ticks))
        assert time_of(snapshot) == pytest.approx(expected, abs=1e-15)
        assert np.array_equal(snapshot.display.time, snapshot.latest.time)
    stage.frame(0.0, Play())
    assert time_of(stage.play(0.1)) == pytest.approx(0.112, abs=0.0011)


def test_a_step_while_playing_pauses(live):
    """A person who steps wants to look closely."""
    stage = live()
    stage.play(0.1)
    snapshot = stage.frame(0.0, StepOnce(5))
    assert not snapshot.playing
    assert time_of(stage.play(0.2)) == time_of(snapshot)


@pytest.mark.parametrize("ticks", [0, -3, 10**9])
def test_senseless_steps_are_refused(live, ticks: int):
    """A sentence says why, and time stands still."""
    stage = live(playing=False)
    snapshot = stage.frame(0.1, StepOnce(ticks))
    assert snapshot.events[-1].level == "error"
    assert "choose within it" in snapshot.events[-1].text
    assert time_of(snapshot) == 0.0


@pytest.mark.parametrize("speed", [1 / 256, 1 / 16, 1.0, 4.0])
def test_what_is_drawn_is_never_ahead_of_the_newest_sample(live, speed: float):
    """It moves forward smoothly: never backwards, and never further than a frame's share plus a tick."""
    stage = live()
    stage.frame(0.0, SetSpeed(speed))
    rng = np.random.default_rng(0)
    shown = []
    for _ in range(400):
        snapshot = stage.frame(float(rng.uniform(0.002, 0.03)))
        assert snapshot.display.time[0] <= snapshot.latest.time[0]
        assert snapshot.display.time[0] >= snapshot.latest.time[0] - 0.001001
        shown.append(float(snapshot.display.time[0]))
    steps = np.diff(shown)
    assert np.all(steps >= -1e-12)
    assert steps.max() <= 0.03 * speed + 0.0011


def test_slow_motion_moves_between_samples(live):
    """At 1/256 a sample comes every quarter second: the frames between show interpolated states on a smooth curve."""
    stage = live()
    stage.frame(0.0, SetSpeed(1 / 256))
    stage.play(0.6)
    poses, times = [], []
    for _ in range(60):
        snapshot = stage.frame()
        poses.append(snapshot.display.pose[0])
        times.append(snapshot.display.time[0])
    assert len(np.unique(times)) > 50
    acceleration = np.abs(np.diff(poses, n=2, axis=0)).max()
    assert acceleration < 200 * (1 / 60 / 256) ** 2  # at most the 163 rad/s² of the jerk


@pytest.mark.parametrize("speed", [1.0, 4.0])
@pytest.mark.parametrize(
    "command", [Reset(), LoadScenario(load_preset("soft-beam"), "soft-beam")], ids=["reset", "load"]
)
def test_a_new_run_in_the_middle_of_a_round_starts_at_its_own_pace(live, speed: float, command):
    """A reset that arrives while a late frame is being made up for does not speed up the new run."""
    stage = live()
    stage.frame(0.0, SetSpeed(speed))
    stage.play(0.2)

    def reset_once(samples) -> None:
        stage.keeper.on_block = None
        stage.runner.submit(command)

    stage.keeper.on_block = reset_once
    snapshot = stage.frame(0.14)
    assert snapshot.run_number == 2
    start = stage.now
    for _ in range(6):
        assert time_of(snapshot) <= (stage.now - start) * speed + 0.001
        snapshot = stage.frame()
    # Six frames of 1/60 s later: a tenth of a second, without the rest of the old frame.
    assert time_of(snapshot) == pytest.approx(0.1 * speed, abs=0.003)


def test_every_run_waits_at_its_start_until_it_is_released(live):
    """New labs, presets and resets wait at t = 0, say so, and go on from there without catching up."""
    stage = live(hold_starts=True)
    for run, command in ((1, None), (2, Reset()), (3, LoadScenario(load_preset("soft-beam"), "soft-beam"))):
        snapshot = stage.play(1.0) if command is None else stage.frame(0.01, command)
        snapshot = stage.play(1.0)
        assert (snapshot.run_number, time_of(snapshot), snapshot.waiting, snapshot.playing) == (run, 0.0, True, True)
        assert snapshot.actual_speed == 0
        assert not snapshot.too_slow
        stage.runner.release(run - 1)
        assert time_of(stage.play(0.2)) == 0.0
        stage.runner.release(run)
        snapshot = stage.play(0.5)
        assert time_of(snapshot) == pytest.approx(0.5, abs=0.02)
        assert not snapshot.waiting
        assert not snapshot.too_slow


@pytest.mark.parametrize(("command", "plays"), [(Play(), True), (Pause(), False), (StepOnce(3), False)])
def test_play_pause_and_step_act_at_once_on_a_run_that_waits(live, command, plays: bool):
    stage = live(hold_starts=True)
    snapshot = stage.frame(0.1, command)
    snapshot = stage.play(0.1)
    assert not snapshot.waiting
    assert snapshot.playing == plays
    assert time_of(snapshot) == pytest.approx(
        0.1 if plays else 0.003 if isinstance(command, StepOnce) else 0.0, abs=0.02
    )


def test_dragging_the_mesh_loses_no_time(live):
    """Every value begins a run in which time goes on: after dragging for a second, a second has been simulated."""
    stage = live()
    stage.play(0.5)
    before = time_of(stage.runner.snapshot)
    for frame in range(60):
        change = [ChangeScenario({"payload.element_count": 3 + frame // 3 % 4})] if frame % 3 == 0 else []
        snapshot = stage.frame(1 / 60, *change)
    assert snapshot.run_number > 15
    assert time_of(snapshot) - before == pytest.approx(1.0, abs=0.0021)
    assert snapshot.actual_speed == pytest.approx(1.0, rel=0.03)


def test_dragging_the_length_waits_for_its_first_value_only(live):
    """Every value begins a run at t = 0. The first run waits to be seen; each of the others goes on at once."""
    stage = live(hold_starts=True)
    stage.runner.release(1)
    stage.play(1.0)
    simulated = []
    for value in range(20):
        snapshot = stage.frame(1 / 60, ChangeScenario({"payload.length": 0.5 - 0.001 * (value + 1)}))
        assert snapshot.run_number == value + 2
        assert snapshot.waiting == (value == 0)
        if value == 0:
            stage.runner.release(2)
        stage.frame()
        simulated.append(time_of(stage.frame()))
    assert simulated[1:] == pytest.approx([0.05] * 19, abs=0.0021)
    ends = [status.text for _, status in stage.keeper.ends]
    assert ends[0] == "Ended at t = 0.983 s."
    assert all(text.startswith("Ended at t = 0.0") and text != "Ended at t = 0.000 s." for text in ends[2:])


def test_a_change_right_after_a_reset_still_waits(live):
    """Nobody has seen that run: only values of one drag share a single wait."""
    stage = live(hold_starts=True)
    stage.runner.release(1)
    stage.play(1.0)
    stage.frame(1 / 60, Reset())
    snapshot = stage.frame(1 / 60, ChangeScenario({"payload.length": 0.48}))
    assert (snapshot.run_number, snapshot.waiting) == (3, True)


def test_a_slow_consumer_does_not_slow_the_run(live):
    """It takes 6 ms for every block of samples, as if it waited for a lock: blocks grow, and the run keeps real time."""
    stage = live()

    def slow(samples) -> None:
        stage.now += 0.006

    stage.keeper.on_block = slow
    start, wall = time_of(stage.runner.snapshot), stage.now
    while stage.now < wall + 2:
        snapshot = stage.frame()
    assert time_of(snapshot) - start == pytest.approx(stage.now - wall, abs=0.06)
    assert not snapshot.too_slow
