"""Commands to a running lab are taken in order, refused in sentences, and never end the simulation thread."""

import threading

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, LoadScenario, Play, Pull, Reset, SetSpeed, StepOnce, Tap
from flexlab.sim.runner import Runner


def time_of(snapshot) -> float:
    return float(snapshot.latest.time[0])


REFUSED = [
    ChangeScenario({"payload.bending_stiffness": -1.0}),
    ChangeScenario({"payload.bending_stiffness": float("nan")}),
    ChangeScenario({"payload.bending_stiffness": 10**400}),
    ChangeScenario({"payload.element_count": 1e9}),
    ChangeScenario({"payload.element_count": 10**400}),
    ChangeScenario({"payload.element_count": "many"}),
    ChangeScenario({"payload": 5}),
    ChangeScenario({"": 5}),
    ChangeScenario({"payload.": 5}),
    ChangeScenario({"controller.kind": ["pd"]}),
    ChangeScenario({"left_arm": None}),
    ChangeScenario({"trajectory.center": (9.0, 9.0, 0.0)}),
    ChangeScenario({"trajectory.amplitude": (2.0, 2.0, 0.2)}),
    ChangeScenario({"initial.pose": (3.0, 3.0, 0.0)}),
    ChangeScenario({"left_arm.base": (-5.0, 0.0)}),
    Tap(0.0, (float("nan"), 0.0)),
    Tap(0.4, (1.0, 0.0)),
    Pull(0.0, (0.0, 0.0), float("inf")),
    Pull(0.0, (float("inf"), 0.0), 10.0),
    Pull(0.0, ("left", 0.0), 10.0),  # type: ignore[arg-type]
    Tap("middle", (0.0, 1.0)),  # type: ignore[arg-type]
    ChangeScenario({"controller.source": 5}),
    SetSpeed(1e9),
    StepOnce(-1),
]


@pytest.mark.parametrize("command", REFUSED, ids=lambda command: str(command)[:80])
def test_a_refused_command_is_an_event_and_the_run_goes_on(live, command):
    """The event is one sentence at level error; later samples are as if nothing had been asked."""
    asked, quiet = live(), live()
    for stage in (asked, quiet):
        stage.play(0.1)
    snapshot = asked.frame(1 / 60, command)
    quiet.frame()
    assert [event.level for event in snapshot.events] == ["error"]
    assert snapshot.events[0].text.endswith((".", "?"))
    assert "\n" not in snapshot.events[0].text
    assert "could not be carried out" not in snapshot.events[0].text
    assert snapshot.run_number == 1
    assert snapshot.playing
    assert snapshot.status == "running"
    for stage in (asked, quiet):
        stage.play(0.1)
    assert time_of(asked.runner.snapshot) == time_of(quiet.runner.snapshot)
    for name in ("pose", "beam_coordinates", "joint_torque"):
        assert np.array_equal(asked.keeper.signal(name), quiet.keeper.signal(name))


def test_values_of_one_field_in_one_round_become_one_change(live):
    """Of ten changes of one field in one round, only the last one is applied and recorded."""
    stage = live()
    values = [100.0 + k for k in range(10)]
    snapshot = stage.frame(0.01, *[ChangeScenario({"controller.feedback_gain": v}) for v in values])
    assert snapshot.scenario.controller.feedback_gain == values[-1]
    assert [dict(event.command.changes) for event in snapshot.events] == [{"controller.feedback_gain": values[-1]}]


def test_a_bad_value_does_not_stop_the_good_ones_of_its_round(live):
    """Changes of one round are carried out as one, but refused one by one."""
    stage = live()
    good, bad = ChangeScenario({"gravity": 9.81}), ChangeScenario({"payload.bending_stiffness": -1.0})
    snapshot = stage.frame(0.01, good, bad, ChangeScenario({"controller.feedback_gain": 300.0}))
    assert (snapshot.scenario.gravity, snapshot.scenario.controller.feedback_gain) == (9.81, 300.0)
    assert [event.level for event in snapshot.events] == ["info", "error", "info"]


def test_an_event_carries_time_text_and_the_command(live):
    """The recording and the event list need simulation time, a text with value and unit, and the command itself."""
    stage = live()
    stage.play(0.1)
    command = ChangeScenario({"payload.bending_stiffness": 50.0})
    event = stage.frame(0.0, command).events[-1]
    assert event.command is command
    assert event.time == pytest.approx(0.1, abs=0.0011)
    assert "Bending stiffness" in event.text
    assert "50 N·m²" in event.text


def test_reset_starts_a_new_run_from_the_present_scenario(live):
    """The run has a new number and starts at t = 0; the changed scenario is kept."""
    stage = live()
    stage.play(0.1)
    stage.frame(0.0, ChangeScenario({"payload.bending_stiffness": 50.0}))
    snapshot = stage.frame(0.0, Reset())
    assert (snapshot.run_number, time_of(snapshot), snapshot.playing) == (2, 0.0, True)
    assert snapshot.scenario.payload.bending_stiffness == 50.0
    assert time_of(stage.play(0.1)) == pytest.approx(0.1, abs=0.0011)


def test_an_unreachable_scenario_is_a_failed_run_and_the_lab_goes_on(live):
    """Loading it gives a failed status with a sentence and pauses; Play is refused in words; a good scenario plays again."""
    stage = live()
    stage.play(0.1)
    far = load_preset("paper").replace({"trajectory.center": (9.0, 9.0, 0.0)})
    snapshot = stage.frame(0.01, LoadScenario(far, "far"))
    assert snapshot.status == "unreachable"
    assert not snapshot.playing
    assert snapshot.events[-1].level == "error"
    assert "cannot reach" in snapshot.events[-1].text
    snapshot = stage.frame(0.01, Play())
    assert not snapshot.playing
    assert "Reset" in snapshot.events[-1].text
    snapshot = stage.frame(0.01, LoadScenario(load_preset("paper"), "paper"), Play())
    assert snapshot.status == "running"
    assert time_of(stage.play(0.2)) == pytest.approx(0.2, abs=0.002)


def test_divergence_pauses_with_a_sentence_and_a_reset_helps(live):
    """The last good sample stays; a reset with sensible gains runs again."""
    stage = live()
    stage.play(0.1)
    stage.frame(0.0, ChangeScenario({"controller.feedback_gain": 1e6, "simulation.step": 1e-3}))
    snapshot = stage.play(0.3)
    assert snapshot.status.failed
    assert not snapshot.playing
    assert snapshot.events[-1].level == "error"
    assert np.isfinite(snapshot.latest.pose).all()
    assert np.isfinite(stage.keeper.signal("kinetic_energy")).all()
    stage.frame(0.0, ChangeScenario({"controller.feedback_gain": 200.0, "simulation.step": None}))
    stage.frame(0.0, Reset(), Play())
    assert time_of(stage.play(0.2)) == pytest.approx(0.2, abs=0.002)


def test_switching_laws_and_integrators_compiles_nothing(live):
    """They share the same machine code: no new signature of the main kernel appears."""
    from flexlab.sim.advance import advance

    stage = live()
    stage.play(0.05)
    known = len(advance.signatures)
    for kind in ("pd", "computed-torque", "vibration-damping", "none", "adaptive-sliding-mode"):
        stage.frame(0.02, ChangeScenario({"controller.kind": kind}))
        assert stage.runner.snapshot.status == "running"
    for integrator in ("rk4", "generalized-alpha", "etdrk4"):
        stage.frame(0.02, ChangeScenario({"simulation.integrator": integrator}))
    assert len(advance.signatures) == known


def test_the_simulation_thread_survives_an_unforeseen_command():
    """Whatever is submitted, the simulation thread goes on and reports an error event."""
    now, frames = [0.0], threading.Semaphore(0)

    def sleep(_: float) -> None:
        now[0] += 1 / 60
        frames.release()

    runner = Runner(load_preset("paper"), clock=lambda: now[0], sleep=sleep)
    runner.start()
    try:
        for _ in range(3):
            assert frames.acquire(timeout=20)
        runner.submit(Tap(0.0, ("hard", "left")))  # type: ignore[arg-type]
        # With the fake clock, frames pass faster than this thread counts them: wait for the answer.
        while not any(event.level == "error" for event in runner.snapshot.events):
            assert frames.acquire(timeout=20)
            assert runner.snapshot.latest.time[0] < 600, "ten simulated minutes without an answer"
        before = time_of(runner.snapshot)
        while time_of(runner.snapshot) <= before:
            assert frames.acquire(timeout=20)
    finally:
        runner.stop()
