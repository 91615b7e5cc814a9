"""The differences of two scenarios: by field, by part, and as changes from one to the other."""

from hypothesis import given, settings
from hypothesis import strategies as st

from flexlab.presets import load_preset, preset_names
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import change_in_words, changes_towards, differences, part_differences, told

names = st.sampled_from(preset_names())
PAPER = Scenario()


@given(names, names)
@settings(max_examples=30)
def test_the_changes_towards_another_preset_lead_to_it(one: str, other: str):
    present, wanted = load_preset(one), load_preset(other)
    changes = changes_towards(present, wanted)
    # A boundary and the arm that it needs change together, as they do when a preset is chosen.
    assert present.replace(changes) == wanted
    assert (changes == {}) == (present == wanted)


def test_a_changed_kind_is_one_difference_by_part_and_several_by_field():
    other = PAPER.replace({"payload.damping.kind": "modal", "gravity": 9.81})
    assert [path for path, _, _ in part_differences(PAPER, other)] == ["payload.damping", "gravity"]
    found = {path: (old, new) for path, old, new in differences(PAPER, other)}
    assert found == {
        "payload.damping.kind": ("nodal", "modal"),
        "payload.damping.coefficient": (0.1, None),
        "payload.damping.ratio": (None, 0.01),
        "gravity": (0.0, 9.81),
    }
    assert list(changes_towards(PAPER, other)) == ["payload.damping.kind", "payload.damping.ratio", "gravity"]


def test_a_removed_arm_differs_in_each_field_and_texts_do_not_count():
    other = PAPER.replace({"payload.boundary": "clamped-free", "right_arm": None})
    found = {path for path, _, _ in differences(PAPER, other)}
    assert {"payload.boundary", "right_arm.base", "right_arm.elbow"} <= found
    assert differences(PAPER, PAPER.replace({"title": "x", "watch": "y"})) == []


def test_changes_and_events_are_told_with_the_titles_of_fields():
    assert change_in_words("payload.damping.ratio: 0.01 → 0") == "Damping ratio ζ: 0.01 → 0"
    shown = change_in_words("t = 45.149 s: payload.damping.ratio = 0; Gravity along −y g = 9.81 m/s²")
    assert shown == "t = 45.149 s: Damping ratio ζ = 0; Gravity along −y g = 9.81 m/s²"
    assert change_in_words("Load mine.json") == "Load mine.json"


def test_sampling_is_told_beside_another_law_and_what_that_law_alone_has_is_not():
    sampled = PAPER.replace({"controller.kind": "pd", "controller.control_period": 0.001})
    assert {path for path, _, _ in told(differences(PAPER, sampled))} == {
        "controller.kind",
        "controller.control_period",
    }
