"""Whatever the data, `parse_scenario` gives a scenario or says in sentences what is wrong with it."""

import json
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario, parse_scenario

PAPER = json.loads(Scenario().model_dump_json())
anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.integers(min_value=10**300, max_value=10**400)
    | st.floats(allow_nan=True, allow_infinity=True)
    | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=8,
)
ODD_NAME = st.sampled_from(["\ud800", PAPER["controller"]["kind"], PAPER["payload"]["damping"]["kind"]])
"""Half a character, and names that pydantic puts into the places of errors."""


def paths(data: dict, before: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found = []
    for name, value in data.items():
        found.append((*before, name))
        if isinstance(value, dict):
            found += paths(value, (*before, name))
    return found


def with_value(path: tuple[str, ...], value: object) -> dict:
    data = json.loads(json.dumps(PAPER))
    inner = data
    for name in path[:-1]:
        inner = inner[name]
    inner[path[-1]] = value
    return data


def parsed(data: object) -> tuple[Scenario | None, list[tuple[str, str]]]:
    """Return the scenario, or None and the problems; any other exception fails the test."""
    try:
        return parse_scenario(data), []
    except ScenarioError as error:
        return None, error.problems


def check(data: object) -> None:
    scenario, problems = parsed(data)
    if scenario is None:
        assert problems
        for _, sentence in problems:
            assert sentence.strip()
            assert "\n" not in sentence
            assert sentence.endswith((".", "?"))
        return
    assert parse_scenario(json.loads(scenario.model_dump_json())) == scenario


@given(anything)
def test_any_data_gives_a_scenario_or_sentences(data):
    check(data)


@settings(max_examples=400)
@given(path=st.sampled_from(paths(PAPER)), value=anything)
def test_any_value_in_any_field_gives_a_scenario_or_sentences(path, value):
    check(with_value(path, value))


@given(path=st.sampled_from(paths(PAPER)), name=st.text(min_size=1, max_size=12) | ODD_NAME)
def test_an_unknown_field_gives_a_sentence_with_its_name_and_is_refused(path, name):
    place = (*path[:-1], name)
    assume(place not in paths(PAPER))
    scenario, problems = parsed(with_value(place, 1.5))
    assert scenario is None
    ((field, sentence),) = problems
    assert sentence.startswith(f"{field} is not a scenario field")
    assert field.startswith(".".join((*path[:-1], "")))
    if name.isidentifier():
        assert field == ".".join(place)
    check(with_value(place, 1.5))


@pytest.mark.parametrize("path", [path for path in paths(PAPER) if path[-1] not in ("title", "watch")])
def test_nan_is_refused_in_every_field(path):
    with pytest.raises(ScenarioError):
        parse_scenario(with_value(path, math.nan))


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        ("payload.bending_stiffness", -1.0, "payload.bending_stiffness = -1 N·m²"),
        ("payload.bending_stiffness", math.nan, "finite number"),
        ("payload.element_count", 1e9, "1 to 64"),
        (
            "controller.feedback_gain",
            1e9,
            "controller.feedback_gain = 10⁹ N·s/m, N·m·s/rad is outside the allowed range",
        ),
        ("payload.boundary", "glued", "pinned-pinned"),
        ("payload", {"mode_count": 5}, "mode_count = 5 is more than the 4 modes that this mesh has"),
        ("left_arm", {"base": (-0.5, 0), "elbow": -1, "link_mass": (8, 0, 4)}, "link 2 has neither mass nor inertia"),
        ("controller.kind", "magic", "controller.kind = 'magic' is not one of 'adaptive-sliding-mode'"),
        ("controller", {}, "controller.kind is missing"),
        ("controller", 5, "it has fields of its own"),
        ("payload", "abc", "payload = 'abc' is not usable: it has fields of its own"),
        ("title", 5, "give a text"),
        ("title", "x" * 300, "title has 300 characters: 120 are the most, shorten it."),
        ("trajectory", {"kind": "table", "rows": 5}, "trajectory.rows = 5 is not usable: give a list."),
        (
            "trajectory",
            {"kind": "table", "rows": []},
            "trajectory.rows = [] has too few usable entries: give 2 or more.",
        ),
        ("joints.encoders.counts", np.float64(4096), "needs a list of numbers"),
        ("controller.torque_limit", np.float32(50), "needs a list of numbers"),
        ("controller.feedback_gain", np.array(50.0), "needs 1 or 3 numbers"),
        ("controller.feedback_gain", "1,5", "= '1,5' needs 1 or 3 numbers (allowed: 0 to "),
        ("controller.feedback_gain", [1, 2], "needs 1 or 3 numbers"),
        ("controller.feedback_gain", [1, 2, np.nan], "needs a finite number"),
        ("controller.kind", np.array([1, 2]), "is not one of"),
        ("trajectory.kind", [1], "is not one of"),
        ("left_arm.elbow", 0, "-1 or 1"),
        ("left_arm.elbow", 2**70, "give a whole number of fewer digits"),
    ],
)
def test_the_sentence_names_field_value_and_range(path: str, value: object, says: str):
    with pytest.raises(ScenarioError) as caught:
        load_preset("paper").replace({path: value})
    assert says in str(caught.value)
    assert path in str(caught.value)


@pytest.mark.parametrize("changes", [None, 5, "gravity=9.81", [("gravity", 9.81)], {5: 1.0}, {None: 1.0}])
def test_changes_must_be_values_by_path(changes: object):
    with pytest.raises(ScenarioError, match="give values by dotted path, as in"):
        load_preset("paper").replace(changes)  # type: ignore[arg-type]  # As somebody may.
