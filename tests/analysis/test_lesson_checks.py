"""Lessons, done as their texts say: each check says no before, yes after, and every number in the texts is measured."""

import re
from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from flexlab.analysis import lesson_checks, lesson_measures
from flexlab.analysis.lesson_checks import CHECKS, SECONDS, Verdict, check_lesson
from flexlab.analysis.metrics import run_metrics
from flexlab.analysis.modes import modes
from flexlab.guide import lessons
from flexlab.presets import load_preset, preset_names
from flexlab.scenario import NoControl, Scenario
from flexlab.sim.commands import ChangeScenario, Tap
from flexlab.sim.samples import Run, Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import Event

LESSONS = {lesson.check: lesson for lesson in lessons()}
EI, K, EPSILON = "payload.bending_stiffness", "controller.feedback_gain", "controller.boundary_layer"
ADAPTATION = "controller.adaptation"


@cache
def run(preset: str, *changes: tuple[float, str, float], duration: float = 3.0) -> Run:
    """A preset with live changes (time in s, path, value)."""
    commands = [(time, ChangeScenario({path: value})) for time, path, value in changes]
    return simulate(load_preset(preset), duration, 0.001, commands)


def verdict(
    check: str, preset: str, *changes: tuple[float, str, float], duration: float = 3.0, until: float | None = None
) -> Verdict:
    """What the lab would show at t = `until`, s: scenario and events as they are then, the last seconds of samples."""
    result, stop = run(preset, *changes, duration=duration), duration if until is None else until
    done = [(time, path, value) for time, path, value in changes if time <= stop]
    scenario = load_preset(preset).replace({path: value for _, path, value in done})
    events = [Event(time, "", ChangeScenario({path: value})) for time, path, value in done]
    return check_lesson(check, scenario, window(result, stop), events)


def window(run: Run, stop: float) -> Samples:
    return between(run, stop - SECONDS, stop)


def between(run: Run, start: float, stop: float) -> Samples:
    first, last = np.searchsorted(run.time, [start - 1e-9, stop + 1e-9])
    return run.slice(int(first), int(last))


def peak(signal: np.ndarray) -> float:
    return float(np.abs(signal).max())


def says(check: str, pattern: str) -> float:
    """The number that a lesson's text gives; line breaks count as spaces."""
    found = re.search(pattern, LESSONS[check].observe.replace("\n", " "))
    assert found, f"{pattern} is not in the lesson {check}"
    return float(found[1])


# The lessons, as a person does them.


def test_why_does_it_ring():
    assert verdict("ring", "paper", until=0.3) == Verdict(False, "Let the run go on to t = 0.6 s.")
    before = verdict("ring", "paper")
    assert not before.done
    assert before.sentence.startswith(
        "The start was wrong by 1.78 m/s and rang the beam at 45.5 Hz (f1 = 44.6 Hz) by up to 1.78 mm"
    )
    after = verdict("ring", "smooth-start", until=0.6)
    assert after.done
    assert "under 2.9 µm" in after.sentence


def test_soft_beam():
    before = verdict("soft-beam", "paper")
    assert not before.done
    assert before.sentence.startswith("EI = 100 N·m²: f1 = 44.6 Hz, and the motion bends the beam by 0.15 mm")
    changes = (2.0, EI, 10.0)
    assert not verdict("soft-beam", "paper", changes, duration=4.0, until=2.5).done
    after = verdict("soft-beam", "paper", changes, duration=4.0)
    assert after.done
    assert "f1 = 14.1 Hz, and the motion bends the beam by 1.51 mm" in after.sentence


def test_what_epsilon_does():
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


def test_why_adaptive():
    faster = (3.0, ADAPTATION, (0.1, 0.1, 0.1))
    before, at_once, after = (
        verdict("adaptation", "weak-feedback", faster, duration=8.0, until=t) for t in (2.9, 3.5, 8.0)
    )
    assert not before.done
    assert "error 1.25 mm RMS" in before.sentence
    assert not at_once.done
    assert after.done


def test_internal_force():
    stiffer = (2.0, K, 1000.0)
    before, at_once, after = (verdict("internal-force", "paper", stiffer, duration=4.0, until=t) for t in (1.9, 2.2, 4))
    assert not before.done
    assert "up to 0.68 N (at the start 311 N)" in before.sentence
    assert not at_once.done
    assert after.done
    assert "up to 0.16 N" in after.sentence


def test_can_vibration_reach_zero():
    before = verdict("vibration", "paper", until=1.0)
    assert not before.done
    assert "within 0.44 s without active damping" in before.sentence
    after = verdict("vibration", "vibration-damping", until=1.0)
    assert after.done
    assert "fell to one per cent within 0.12 s" in after.sentence


# What the texts say.


def test_numbers_of_why_does_it_ring():
    paper, smooth = run("paper"), run("smooth-start")
    path_rate = (paper.desired_pose[1] - paper.desired_pose[0]) / 0.001
    assert np.hypot(*path_rate[:2]) == pytest.approx(says("ring", r"moves at (\S+) m/s"), abs=0.01)
    assert 1e3 * peak(paper.vibration) == pytest.approx(says("ring", r"behind by (\S+) mm"), abs=0.005)
    f1 = lesson_measures.first_frequency(load_preset("paper").payload)
    assert f1 == pytest.approx(says("ring", r"f1 = (\S+) Hz"), abs=0.05)
    ring = says("ring", r"rings at (\S+) Hz")
    assert lesson_measures.ring_frequency(between(paper, 0, 0.3)) == pytest.approx(ring, abs=0.1)
    # The frequency of the whole closed loop, found another way, is raised by the grips that give way.
    loop = modes(load_preset("paper")).pole_frequency
    assert np.abs(loop - ring).min() < 0.1
    assert ring > f1
    assert run_metrics(paper).settling_time == pytest.approx(says("ring", r"per cent in (\S+) s"), abs=0.005)
    assert lesson_checks.UNDAMPED_TIME == pytest.approx(run_metrics(paper).settling_time, abs=0.005)
    assert 1e6 * peak(smooth.vibration) < says("ring", r"under (\d+) µm")


def test_numbers_of_soft_beam():
    errors = []
    for stiffness, hertz, bending in (
        (100.0, r"from (\S+) Hz", r"from (\S+) mm"),
        (10.0, r"to (\S+) Hz", r"mm to (\S+) mm"),
        (1.27, r"and to (\S+) Hz", r"and to (\S+) mm at EI = 1.27"),
    ):
        result = run("paper", (2.0, EI, stiffness), duration=5.0)
        payload = load_preset("paper").payload.model_copy(update={"bending_stiffness": stiffness})
        assert lesson_measures.first_frequency(payload) == pytest.approx(says("soft-beam", hertz), abs=0.05)
        largest = 1e3 * peak(between(result, 4, 5).quasi_static_deflection)
        assert largest == pytest.approx(says("soft-beam", bending), rel=0.02)
        errors.append(1e3 * peak(between(result, 4, 5).tracking_error[:, :2]))
    assert says("soft-beam", r"which is (\S+) %") == pytest.approx(100 * largest / 500, abs=0.05)
    assert min(errors) == pytest.approx(says("soft-beam", r"between (\S+) and"), abs=0.006)
    assert max(errors) == pytest.approx(says("soft-beam", r"between \S+ and (\S+) mm"), abs=0.006)
    scenario = Scenario()
    assert sum(sum(arm.link_mass) for arm in scenario.arms) == says("soft-beam", r"arms weigh (\d+) kg")


def test_numbers_of_what_epsilon_does():
    result = run("fast-adaptation", (2.0, EPSILON, 0.01), (4.0, EPSILON, 0.001), duration=6.0)
    thick, thin, thinnest = (between(result, *span) for span in ((1, 2), (3, 4), (5, 6)))
    errors = [1e3 * peak(part.tracking_error[:, :2]) for part in (thick, thin, thinnest)]
    check = "boundary-layer"
    assert errors[0] == pytest.approx(says(check, r"falls from (\S+) mm"), abs=0.01)
    assert errors[1] == pytest.approx(says(check, r"to (\S+) mm at its peak"), abs=0.01)
    assert errors[2] == pytest.approx(says(check, r"hardly better, (\S+) mm"), abs=0.01)
    jumps = [lesson_measures.torque_jump(part, 0.001) for part in (thick, thin, thinnest)]
    assert jumps[1] == pytest.approx(says(check, r"change by (\S+) N·m \(RMS\) per step"), abs=0.05)
    # Chatter is not smooth in its causes: another compiler may give slightly other jumps.
    assert jumps[2] == pytest.approx(says(check, r"change by (\S+) N·m \(RMS\) at every"), rel=0.1)
    forces = [peak(np.linalg.norm(part.internal_force[:, 0, :2], axis=1)) for part in (thick, thin, thinnest)]
    assert max(forces[:2]) < says(check, r"from under (\S+) N")
    assert forces[2] == pytest.approx(says(check, r"from under \S+ N to (\S+) N"), rel=0.1)
    assert 1e6 * peak(thin.vibration) == pytest.approx(says(check, r"vibration from (\S+) µm"), abs=0.5)
    assert 1e6 * peak(thinnest.vibration) == pytest.approx(says(check, r"vibration from \S+ µm to (\S+) µm"), rel=0.1)


def test_numbers_of_why_adaptive():
    result = run("weak-feedback", (3.0, ADAPTATION, (0.1, 0.1, 0.1)), duration=8.0)

    def rms(start: float, stop: float) -> float:
        return float(np.sqrt(np.mean(np.sum(between(result, start, stop).tracking_error[:, :2] ** 2, axis=1))))

    alone = between(run("weak-feedback", duration=10.0), 9, 10).tracking_error[:, :2]
    settled = float(np.sqrt(np.mean(np.sum(alone**2, axis=1))))
    assert 1e3 * settled == pytest.approx(says("adaptation", r"grows to (\S+) mm RMS"), abs=0.005)
    assert settled == pytest.approx(lesson_checks.UNADAPTED_ERROR, abs=5e-6)
    assert rms(6, 7) < 0.5 * lesson_checks.UNADAPTED_ERROR
    assert np.all(np.diff(result.bound_estimates, axis=0) >= 0), "estimates never shrink"
    slow, paper = (between(run(name), 1, 3) for name in ("slow-adaptation", "paper"))
    assert peak(slow.tracking_error[:, 1]) / peak(paper.tracking_error[:, 1]) - 1 < 0.015


def test_numbers_of_internal_force():
    result = run("paper", (2.0, K, 1000.0), duration=4.0)
    for (start, stop), pattern in (
        ((0, 0.1), r"with (\S+) N\."),
        ((1, 2), r"motion (\S+) N"),
        ((3, 4), r"1000 (\S+) N"),
    ):
        force = peak(np.linalg.norm(between(result, start, stop).internal_force[:, 0, :2], axis=1))
        assert force == pytest.approx(says("internal-force", pattern), rel=0.03)
    assert peak(result.internal_force.sum(axis=1)) < 1e-9


def test_numbers_of_can_vibration_reach_zero():
    paper, damped = run("paper"), run("vibration-damping")
    check = "vibration"
    assert run_metrics(paper).settling_time == pytest.approx(says(check, r"takes (\S+) s"), abs=0.005)
    assert run_metrics(damped).settling_time == pytest.approx(says(check, r"hands with it: (\S+) s"), abs=0.005)
    assert 1e6 * peak(between(damped, 1, 3).vibration) < says(check, r"less than (\S+) µm")
    moments = [peak(result.internal_force[:, 0, 2]) for result in (damped, paper)]
    assert moments[0] == pytest.approx(says(check, r"peaks at (\d+) N·m"), abs=0.5)
    assert moments[1] == pytest.approx(says(check, r"instead of (\d+) N·m"), abs=0.5)
    growth = [peak(damped.tracking_error[:, a]) / peak(paper.tracking_error[:, a]) - 1 for a in range(3)]
    assert 100 * max(growth) == pytest.approx(says(check, r"grows by (\S+) %"), abs=0.05)
    for result in (paper, damped):
        bending = 1e3 * peak(between(result, 1, 3).midspan_deflection)
        assert bending == pytest.approx(says(check, r"bending of (\S+) mm"), abs=0.005)


# Checks are robust: any run, any events, one sentence.


def one_sentence_or_two(verdict: Verdict) -> bool:
    return bool(verdict.sentence) and "\n" not in verdict.sentence and "nan" not in verdict.sentence


@pytest.mark.parametrize("check", list(CHECKS))
@pytest.mark.parametrize("preset", preset_names())
def test_every_check_answers_on_every_preset(check: str, preset: str):
    for until in (0.0, 0.001, 0.3, 3.0):
        assert one_sentence_or_two(verdict(check, preset, until=until))


@pytest.mark.parametrize("check", list(CHECKS))
def test_a_lesson_is_not_done_by_its_first_preset(check: str):
    assert not verdict(check, LESSONS[check].preset).done


@pytest.mark.parametrize("check", list(CHECKS))
def test_a_touch_undoes_a_lesson_that_compares(check: str):
    """A tap on the beam just now: nothing that was measured across it counts."""
    events: Sequence[Event] = [Event(2.9, "", Tap(0.0, (0.0, 1.0))), Event(2.95, "no command", level="error")]
    for preset in ("paper", "smooth-start", "fast-adaptation"):
        assert (
            not check_lesson(check, load_preset(preset), window(run(preset), 3.0), events).done or check == "vibration"
        )


def test_other_controllers_and_resting_paths_get_a_sentence():
    still = Scenario().replace({"trajectory.amplitude": (0.0, 0.0, 0.0), "trajectory.frequency": (0.0, 0.0, 0.0)})
    for scenario in (still, Scenario(controller=NoControl())):
        result = simulate(scenario, 1.5, 0.001)
        for check in CHECKS:
            answer = check_lesson(check, scenario, result.slice(0, len(result)), [])
            assert one_sentence_or_two(answer)
            assert not answer.done


def test_an_empty_run_is_told_to_play():
    result = run("paper")
    for check in CHECKS:
        assert not check_lesson(check, load_preset("paper"), result.slice(0, 0)).done
    with pytest.raises(KeyError):
        check_lesson("no such check", load_preset("paper"), result.slice(0, 5))
