"""Lessons done as their texts say: each check says no before and yes after, and the numbers in the checks are measured."""

import re
from collections.abc import Sequence

import numpy as np
import pytest
from preset_run import run

from flexlab.analysis import lesson_measures
from flexlab.analysis.lesson_checks import Verdict, read_check
from flexlab.analysis.lesson_measures import SECONDS
from flexlab.analysis.metrics import run_metrics
from flexlab.analysis.modes import modes
from flexlab.control.laws.no_control import NoControl
from flexlab.guide import lessons
from flexlab.presets import load_preset, preset_names
from flexlab.recording.course import first_frequency
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Tap
from flexlab.sim.samples import Run, Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import Event

LESSONS = {lesson.id: lesson for lesson in lessons()}
EI, K, EPSILON = "payload.bending_stiffness", "controller.feedback_gain", "controller.boundary_layer"
ADAPTATION = "controller.adaptation"


def verdict(
    check: str, preset: str, *changes: tuple[float, str, float], duration: float = 3.0, until: float | None = None
) -> Verdict:
    """What the lab would show at t = `until`, s, from the scenario, the events and the last seconds of samples at that time."""
    result, stop = run(preset, *changes, duration=duration), duration if until is None else until
    done = [(time, path, value) for time, path, value in changes if time <= stop]
    scenario = load_preset(preset).replace({path: value for _, path, value in done})
    events = [Event(time, "", ChangeScenario({path: value})) for time, path, value in done]
    return read_check(LESSONS[check]).verdict(scenario, window(result, stop), events)


def window(run: Run, stop: float) -> Samples:
    return between(run, stop - SECONDS, stop)


def between(run: Run, start: float, stop: float) -> Samples:
    first, last = np.searchsorted(run.time, [start - 1e-9, stop + 1e-9])
    return run.slice(int(first), int(last))


def peak(signal: np.ndarray) -> float:
    return float(np.abs(signal).max())


# The lessons, done as a student would do them.


def test_the_lesson_on_the_ring_is_done_by_a_smooth_start():
    assert verdict("ring", "paper", until=0.3) == Verdict(False, "Let the run go on to t = 0.6 s.")
    before = verdict("ring", "paper")
    assert not before.done
    assert before.sentence.startswith(
        "The start was wrong by 1.78 m/s and rang the beam at 45.5 Hz (f₁ = 44.6 Hz) by up to 1.78 mm"
    )
    after = verdict("ring", "smooth-start", until=0.6)
    assert after.done
    assert "under 2.9 µm" in after.sentence


def test_the_lesson_on_the_soft_beam_is_done_by_softening_it_and_waiting():
    before = verdict("soft-beam", "paper")
    assert not before.done
    assert before.sentence.startswith("EI = 100 N·m²: f₁ = 44.6 Hz, and the motion bends the beam by 0.15 mm")
    changes = (2.0, EI, 10.0)
    assert not verdict("soft-beam", "paper", changes, duration=4.0, until=2.5).done
    after = verdict("soft-beam", "paper", changes, duration=4.0)
    assert after.done
    assert "f₁ = 14.1 Hz, and the motion bends the beam by 1.51 mm" in after.sentence


def test_the_lesson_on_the_boundary_layer_is_done_by_thinning_it_twice():
    thinner, thinnest = (2.0, EPSILON, 0.01), (4.0, EPSILON, 0.001)
    stages = [
        verdict("boundary-layer", "fast-adaptation", thinner, thinnest, duration=6.0, until=t) for t in (1.9, 3.9, 6)
    ]
    assert [stage.done for stage in stages] == [False, False, True]
    assert "set Boundary layer ε to 0.01" in stages[0].sentence
    assert "set Boundary layer ε to 0.001" in stages[1].sentence
    assert "chatter" in stages[2].sentence
    back = (6.0, EPSILON, 0.1)
    calm = verdict("boundary-layer", "fast-adaptation", thinner, thinnest, back, duration=8.0)
    assert not calm.done


def test_the_lesson_on_adaptation_is_done_by_adapting_faster_and_waiting():
    faster = (3.0, ADAPTATION, (0.1, 0.1, 0.1))
    before, at_once, after = (
        verdict("adaptation", "weak-feedback", faster, duration=8.0, until=t) for t in (2.9, 3.5, 8.0)
    )
    assert not before.done
    assert "error 1.25 mm RMS" in before.sentence
    assert not at_once.done
    assert after.done


def test_the_lesson_on_the_internal_force_is_done_by_a_larger_gain_and_waiting():
    stiffer = (2.0, K, 1000.0)
    before, at_once, after = (verdict("internal-force", "paper", stiffer, duration=4.0, until=t) for t in (1.9, 2.2, 4))
    assert not before.done
    assert "up to 0.68 N (at the start 311 N)" in before.sentence
    assert not at_once.done
    assert after.done
    assert "up to 0.16 N" in after.sentence


def begun(check: str, preset: str, duration: float, **changes: object) -> Verdict:
    """What the lab shows for a run that began with changes."""
    scenario = load_preset(preset).replace({path.replace("__", "."): value for path, value in changes.items()})
    return read_check(LESSONS[check]).verdict(scenario, window(simulate(scenario, duration), duration), [])


CLOCK: dict[str, object] = {"controller__control_period": 0.001, "controller__input_delay": 1}
KALMAN: dict[str, object] = {"controller__kind": "composite", "controller__observer__kind": "kalman"}


def test_the_lesson_on_vibration_is_done_by_an_observer_behind_noisy_gauges():
    before = verdict("vibration", "paper", until=1.0)
    assert not before.done
    assert "within 0.44 s without active damping" in before.sentence
    ideal = verdict("vibration", "vibration-damping", until=1.0)
    assert not ideal.done
    assert "fell to one per cent within 0.12 s, with rates that are known at once" in ideal.sentence
    noisy = {**CLOCK, "controller__sensor_noise__strain": 1e-6}
    measured = begun("vibration", "vibration-damping", 1.0, **noisy)
    assert not measured.done
    assert "within 0.13 s with a clock of 1 ms and 1 ms of delay, but the torques jump by 1" in measured.sentence
    assert not begun("vibration", "vibration-damping", 1.0, **CLOCK, **KALMAN).done
    after = begun("vibration", "vibration-damping", 1.0, **noisy, **KALMAN)
    assert after.done
    assert "within 0.12 s with a clock of 1 ms and 1 ms of delay, from noisy gauges" in after.sentence


def test_the_lesson_on_input_shaping_is_done_by_zvd_made_for_a_wrong_frequency():
    assert not verdict("input-shaping", "soft-beam").done
    stages = [
        begun("input-shaping", "sudden-stop", 1.6, trajectory__shaper=shaper, trajectory__shaper_frequency=hertz)
        for shaper, hertz in (("none", None), ("zv", None), ("zv", 4.0), ("zvd", 4.0))
    ]
    assert [stage.done for stage in stages] == [False, False, False, True]
    assert "3.88 mm of vibration after the stop" in stages[0].sentence
    assert "zv, 101 ms longer: 0.03 mm" in stages[1].sentence
    assert "Made for 4 Hz instead of 4.97 Hz, zv" in stages[2].sentence
    assert "0.14 mm of vibration after the stop" in stages[3].sentence


def test_the_lesson_on_spillover_is_done_by_a_little_damping():
    beam: dict[str, object] = {
        "payload__element_count": 8,
        "payload__damping__kind": "modal",
        "payload__damping__ratio": 0.0,
    }
    stages = [
        begun("spillover", "vibration-damping", 0.1, **changes)
        for changes in (
            CLOCK,
            CLOCK | beam,
            CLOCK | beam | KALMAN,
            CLOCK | beam | KALMAN | {"payload__damping__ratio": 1e-3},
        )
    ]
    assert [stage.done for stage in stages] == [False, False, False, True]
    assert "Set Elements to 8" in stages[0].sentence
    assert "beam mode 3, 401 Hz, grows at 2.65 1/s" in stages[1].sentence
    assert "knows 3 of 16 modes, and beam mode 5, 1122 Hz, grows at 0.23 1/s: spillover" in stages[2].sentence


# What the checks compare with, and what the texts claim without numbers (their numbers: tests/test_numbers_in_texts.py).


def test_the_ring_is_that_of_the_closed_loop():
    """The frequency measured in the run is that of the linearised loop, above that of the beam alone."""
    ring = lesson_measures.ring_frequency(between(run("paper"), 0, 0.3))
    assert np.abs(modes(load_preset("paper")).pole_frequency - ring).min() < 0.1
    assert ring > first_frequency(load_preset("paper").payload)


def number(lesson: str, name: str) -> float:
    """A number that a lesson's check compares with."""
    found = re.search(rf"^{name} = (\S+)$", LESSONS[lesson].check, re.MULTILINE)
    assert found
    return float(found[1])


def test_the_numbers_that_the_checks_compare_with_are_measured():
    assert number("vibration", "undamped") == pytest.approx(run_metrics(run("paper")).settling_time, abs=0.005)
    alone = between(run("weak-feedback", duration=10.0), 9, 10).tracking_error[:, :2]
    assert float(np.sqrt(np.mean(np.sum(alone**2, axis=1)))) == pytest.approx(
        number("adaptation", "unadapted"), abs=5e-6
    )
    left = peak(between(run("paper"), 1, 3).vibration)
    for lesson in ("ring", "vibration", "input-shaping"):
        assert number(lesson, "ringing") / left == pytest.approx(28, abs=0.5)


def test_estimates_grow_until_the_error_is_halved_and_never_shrink():
    result = run("weak-feedback", (3.0, ADAPTATION, (0.1, 0.1, 0.1)), duration=8.0)
    error = between(result, 6, 7).tracking_error[:, :2]
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.5 * number("adaptation", "unadapted")
    assert np.all(np.diff(result.bound_estimates, axis=0) >= 0)


def test_the_internal_forces_of_the_arms_are_opposite():
    assert peak(run("paper", (2.0, K, 1000.0), duration=4.0).internal_force.sum(axis=1)) < 1e-9


# The checks answer any run and any events in a sentence.


def one_sentence_or_two(verdict: Verdict) -> bool:
    return bool(verdict.sentence) and "\n" not in verdict.sentence and "nan" not in verdict.sentence


@pytest.mark.parametrize("check", list(LESSONS))
@pytest.mark.parametrize("preset", preset_names())
def test_every_check_answers_on_every_preset(check: str, preset: str):
    for until in (0.0, 0.001, 0.3, 3.0):
        assert one_sentence_or_two(verdict(check, preset, until=until))


@pytest.mark.parametrize("check", list(LESSONS))
def test_no_lesson_is_done_by_merely_running_its_preset(check: str):
    assert not verdict(check, LESSONS[check].preset).done


@pytest.mark.parametrize("check", list(LESSONS))
def test_no_lesson_but_the_one_on_vibration_is_done_just_after_a_tap(check: str):
    """What was measured across a recent tap on the beam does not count; that lesson looks at the run's beginning."""
    events: Sequence[Event] = [Event(2.9, "", Tap(0.0, (0.0, 1.0))), Event(2.95, "no command", level="error")]
    presets = "paper", "smooth-start", "soft-beam", "composite"  # Without the tap, three lessons would be done.
    verdicts = {
        preset: read_check(LESSONS[check]).verdict(load_preset(preset), window(run(preset), 3.0), events)
        for preset in presets
    }
    done = [preset for preset, verdict in verdicts.items() if verdict.done]
    assert done == (["composite"] if check == "vibration" else [])


def test_other_controllers_and_resting_paths_get_a_sentence():
    still = Scenario().replace({"trajectory.amplitude": (0.0, 0.0, 0.0), "trajectory.frequency": (0.0, 0.0, 0.0)})
    for scenario in (still, Scenario(controller=NoControl())):
        result = simulate(scenario, 1.5, 0.001)
        for check in LESSONS:
            answer = read_check(LESSONS[check]).verdict(scenario, result.slice(0, len(result)), [])
            assert one_sentence_or_two(answer)
            assert not answer.done


def test_no_lesson_is_done_by_an_empty_run():
    result = run("paper")
    for check in LESSONS:
        assert not read_check(LESSONS[check]).verdict(load_preset("paper"), result.slice(0, 0)).done


def test_the_lesson_on_buckling_is_done_by_a_second_squeeze_and_waiting():
    force, preset = "controller.wanted_internal_force", "squeeze-until-it-buckles"
    change = (3.0, force, 40.0)
    assert "squeeze-until-it-buckles" in verdict("buckling", "paper").sentence
    before = verdict("buckling", preset, change, duration=6.0, until=2.9)
    assert not before.done
    assert "set Wanted internal force F_d to 40" in before.sentence
    other = verdict("buckling", preset, (0.0, force, 40.0), duration=3.0)
    assert "set Wanted internal force F_d to 30" in other.sentence
    after = verdict("buckling", preset, change, duration=6.0)
    assert after.done, after.sentence
    assert "π²EI/L² is 50.1 N" in after.sentence
    soon = verdict("buckling", preset, change, duration=6.0, until=4.0)
    assert "80 % of P_cr = 50.1 N. Let the run go on to t = 5.0 s" in soon.sentence
    straight = begun("buckling", preset, 3.0, initial__beam_coordinates=(0.0,) * 8)
    assert "rings no more. Press R, or tap the beam" in straight.sentence
    buckled = verdict("buckling", preset, (0.0, force, 70.0), duration=1.0)
    assert not buckled.done
    assert "it has buckled. Set Wanted internal force F_d to 30, and press R" in buckled.sentence


def test_the_lesson_on_buckling_may_wait_for_half_a_minute():
    """The reader may take that long: the ring that is then left, 30 nm, has the same frequency."""
    late = verdict(
        "buckling", "squeeze-until-it-buckles", (30.0, "controller.wanted_internal_force", 40.0), duration=33.0
    )
    assert late.done, late.sentence


def test_the_lesson_on_spin_up_is_done_without_the_force_along_the_beam():
    assert "one arm" in verdict("spin-up", "paper").sentence
    bent = verdict("spin-up", "spin-up", duration=2.4)
    assert bent.sentence.endswith("Let the run go on to t = 5 s."), "it has not come back to the line yet"
    felt = verdict("spin-up", "spin-up", duration=5.0)
    assert not felt.done
    assert re.search(
        r"takes 15\d % .* lagged by up to 39\.\d\d mm, and was back within 0\.0\d mm of the line", felt.sentence
    ), felt.sentence
    paper = begun("spin-up", "spin-up", 5.0, payload__axial_load="none")
    assert paper.done, paper.sentence
