"""Typed settings: values, kinds in any order, and a sentence with similar names for what is not a field."""

import pytest

from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.scenario import parse_scenario
from flexlab.scenario.settings import (
    PERIOD,
    USUAL_PERIOD,
    change_settings,
    parse_value,
    settings_from,
    with_period_if_needed,
)


@pytest.mark.parametrize(
    ("text", "value"),
    [("400", 400), ("1e3", 1000.0), ("[1, 2, 3]", [1, 2, 3]), ("null", None), ("pd", "pd"), ("clamped-free", "clamped-free"),
     ('{"kind": "modal"}', {"kind": "modal"}), ("", ""), ("[" * 100_000, "[" * 100_000)],
)  # fmt: skip
def test_a_value_is_json_or_the_text_itself(text: str, value: object):
    assert parse_value(text, "gravity") == value


def test_settings_change_fields_by_path_and_kinds_come_first():
    paper = load_preset("paper")
    changes = settings_from(
        ("controller.position_gain=3000", "gravity = 9.81", "payload.damping.ratio=0.02",
         "payload.damping.kind=modal"),
        law="pd", seed=7,
    )  # fmt: skip
    changed = change_settings(paper, changes)
    assert (changed.controller.kind, changed.controller.position_gain) == ("pd", 3000.0)
    assert (changed.controller.sensor_noise.seed, changed.gravity) == (7, 9.81)
    assert changed.payload.damping.ratio == 0.02
    assert change_settings(paper, {}) == paper


def test_a_kind_comes_before_the_kinds_of_its_parts():
    """The kind of the slow part was lost, in silence, where it was named before the law that has such a part."""
    texts = ("controller.slow.feedback_gain=300", "controller.slow.kind=sliding-mode", "controller.kind=composite")
    slow = change_settings(load_preset("paper"), settings_from(texts)).controller.slow
    assert (slow.kind, slow.feedback_gain) == ("sliding-mode", 300.0)


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        (
            ("feedback_gain=4",),
            "feedback_gain is not a scenario field: did you mean controller.feedback_gain or controller.slow.feedback_gain?",
        ),
        (("controller.feedbck_gain=4",), "did you mean controller.feedback_gain?"),
        (("payload.dampng.kind=modal",), "did you mean payload.damping.kind"),
        (("right_arm.link_mas=3",), "did you mean right_arm.link_mass?"),
        (("controller.position_gain=4",), "is not a scenario field here but one of another kind: choose that kind"),
        (("zzz.yyy=4",), "zzz.yyy is not a scenario field: check the spelling or remove it."),
        (("a" * 10_000 + "=4",), "is not a scenario field: check the spelling"),
        (("payload.bending_stiffness=-3",), "payload.bending_stiffness = -3 N·m² is outside the allowed range 0.001"),
        (("payload.bending_stiffness=soft",), "payload.bending_stiffness = 'soft' needs a finite number"),
        (("controller.kind=pdd",), "is not one of 'adaptive-sliding-mode'"),
        (("gravity=NaN",), "gravity = nan needs a finite number"),
        (("gravity",), "'gravity' is not a setting: write PATH=VALUE, as in controller.feedback_gain=400."),
        (("=3",), "'=3' is not a setting"),
        (("gravity=1", "gravity=2"), "gravity is set twice: give it one value."),
        (
            ('payload={"mesh": {"elements": 4, "elements": 5}}',),
            'payload = {"mesh": {"elements": 4, "elements": 5}}: the field \'elements\' is given twice in one place.',
        ),
        (("simulation.step.a=1",), "did you mean simulation.step?"),
        (("\x1b[31m.b=1",), "is not a scenario field"),
    ],
)
def test_what_cannot_be_set_is_refused_in_one_short_sentence(texts: tuple[str, ...], says: str):
    with pytest.raises(ScenarioError) as caught:
        change_settings(load_preset("paper"), settings_from(texts))
    sentence = str(caught.value)
    assert says in sentence
    assert "\n" not in sentence
    assert "\x1b" not in sentence
    assert len(sentence) < 500


def test_a_law_that_is_set_twice_is_refused():
    with pytest.raises(ScenarioError, match=r"controller\.kind is set twice"):
        settings_from(("controller.kind=pd",), law="none")


def test_the_error_for_a_misspelt_field_suggests_the_one_that_was_meant():
    with pytest.raises(ScenarioError, match=r"payload\.bending_stifness is not a scenario field: did you mean "):
        parse_scenario({"payload": {"bending_stifness": 3}})


@pytest.mark.parametrize(
    ("changes", "period"),
    [
        ({"controller.kind": "lqr"}, USUAL_PERIOD),
        ({"controller.kind": "composite", "controller.observer.kind": "kalman"}, USUAL_PERIOD),
        ({"controller.kind": "composite"}, None),
        ({"controller.kind": "lqr", PERIOD: 0.002}, 0.002),
    ],
)
def test_a_law_that_needs_a_control_period_gets_the_usual_one_if_none_is_set(changes: dict, period: float | None):
    paper = load_preset("paper")
    assert change_settings(paper, with_period_if_needed(paper, changes)).controller.control_period == period
    sampled = paper.replace({PERIOD: 0.005})
    assert with_period_if_needed(sampled, {"controller.kind": "lqr"}) == {"controller.kind": "lqr"}
    assert with_period_if_needed(paper, {"controller.kind": "lqrr"}) == {"controller.kind": "lqrr"}, "wrong stays wrong"
