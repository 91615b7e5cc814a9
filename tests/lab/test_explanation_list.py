"""The explanations beside the plots: true of what is on the screen, few, and without flicker."""

from collections.abc import Iterable

import numpy as np
import pytest

from flexlab.analysis.explanations.explanation import EXPLANATIONS, Background, Evidence, Explained, explain
from flexlab.lab.mode_computation import ModeStudy
from flexlab.lab.plots.plots import MISSED, MOST, REWORDED, SEEN, CalmList, list_html
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, Play, Pull, Tap
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import Event

NAMES = list(EXPLANATIONS)


def said(names: Iterable[str], text: str = "One.") -> list[Explained]:
    return [Explained(name, text, "a = b", "Tracking error") for name in names]


def shown(calm: CalmList, names: Iterable[str], text: str = "One.") -> list[str]:
    return [each.name for each in calm.look(said(names, text))]


def test_a_sentence_appears_after_two_hits_and_disappears_after_two_misses():
    calm, one = CalmList(), NAMES[:1]
    assert [shown(calm, one) for _ in range(SEEN)] == [[]] * (SEEN - 1) + [one]
    assert [shown(calm, []) for _ in range(MISSED)] == [one] * (MISSED - 1) + [[]]


def test_a_shown_sentence_survives_single_misses_and_a_single_hit_shows_none():
    calm, one, other = CalmList(), NAMES[0], NAMES[1]
    for _ in range(SEEN):
        shown(calm, [one])
    for k in range(10):
        # The first is missed every other time, the second is never found twice in a row.
        assert shown(calm, [one] if k % 2 else [other]) == [one]


def test_a_shown_sentence_keeps_its_numbers_for_some_checks():
    calm = CalmList()
    texts = [[each.sentence for each in calm.look(said(NAMES[:1], f"{k}."))] for k in range(SEEN + 2 * REWORDED)]
    changes = sum(one != other for one, other in zip(texts[SEEN:], texts[SEEN - 1 :], strict=False))
    assert changes == 2


def test_the_most_important_come_first_and_no_more_than_three():
    calm = CalmList()
    for _ in range(SEEN):
        found = shown(calm, reversed(NAMES))
    assert found == NAMES[:MOST]
    calm.clear()
    assert shown(calm, NAMES) == []


def test_samples_before_a_change_or_a_touch_are_not_explained():
    scenario = load_preset("paper")
    run, about = simulate(scenario, 1.0), Background.of(scenario)
    assert [each.name for each in explain(Evidence.of_run(run, about))] == ["ring", "jerky start"]
    for command in (ChangeScenario({"controller.feedback_gain": 300.0}), Tap(0.0, (0.0, 1.0))):
        later = Evidence.of_run(run, about, events=(Event(0.7, "", command), Event(0.8, "", Play())))
        assert later.samples.time[0] == pytest.approx(0.701), "the sample at the change is the last one before it"
        assert not later.begins
        assert "jerky start" not in [each.name for each in explain(later)]
    held = Event(0.7, "", Pull(0.0, (0.0, 1.0), 500.0))
    pulled = Evidence.of_run(run, about, events=(held, Event(0.8, "", Play())))
    assert explain(pulled) == (), "a hand bends the beam all the while"


def test_a_scenario_whose_modes_are_not_computed_yet_is_not_explained():
    study, paper = ModeStudy(), load_preset("paper")
    assert study.background(paper) is None
    study.ask(paper)
    study.stop()
    about = study.background(paper.replace({"title": "the same"}))
    assert about is not None
    assert study.result is not None
    np.testing.assert_array_equal(about.modes.poles, study.result.poles)
    assert study.background(paper.replace({"payload.bending_stiffness": 10.0})) is None


def test_an_explanation_is_escaped_and_shows_plot_and_equation():
    text = list_html([Explained("x", "<b>1 < 2", "a < b", "Tracking error")])
    assert "&lt;b&gt;1 &lt; 2" in text
    assert "<b>Tracking error.</b>" in text
    assert "a &lt; b" in text
    assert "0.7\xa0mm" in list_html([Explained("x", "The error of 0.7 mm.", "", "Tracking error")])
    assert "fl-why" in list_html([]), "else the plots grow with each new run, and shrink a second later"
