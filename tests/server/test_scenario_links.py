"""A link carries a scenario bit for bit; an invalid link is refused in a sentence."""

import base64
import contextlib
import json
import zlib
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexlab.errors import FlexlabError, PresetError, ScenarioError
from flexlab.presets import load_preset, preset_names
from flexlab.server.scenario_links import LONGEST_LINK, LONGEST_TEXT, decode_scenario, encode_scenario


def packed(data: bytes) -> str:
    return base64.urlsafe_b64encode(zlib.compress(data)).decode()


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_fits_into_a_link(name: str):
    scenario = load_preset(name)
    word = encode_scenario(scenario)
    assert decode_scenario(word) == scenario
    assert len(word) < LONGEST_LINK / 3


def places(data: object, above: str = "") -> Iterator[tuple[str, object]]:
    """(Dotted path, value) of each number, switch and list of numbers in a scenario's plain data."""
    for name, value in data.items() if isinstance(data, dict) else ():
        path = f"{above}.{name}" if above else name
        if isinstance(value, dict):
            yield from places(value, path)
        elif isinstance(value, (int, float, list)):
            yield path, value


def others(value: object) -> list[object]:
    """Values near a field's value, some of which are valid."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, list):
        return [[other, *value[1:]] for other in others(value[0])] if value else []
    assert isinstance(value, (int, float))
    return [-value or 1, value + 1, 0.9 * value, value / 2]


@pytest.mark.parametrize("name", ["paper", "composite"])
def test_a_change_of_any_field_survives_a_link(name: str):
    scenario = load_preset(name)
    told: set[str] = set()
    for path, value in places(scenario.model_dump(mode="json")):
        for other in others(value):
            with contextlib.suppress(ScenarioError):
                changed = scenario.replace({path: other})
                assert decode_scenario(encode_scenario(changed)) == changed, path
                told.add(path)
    assert told >= {"left_arm.base", "left_arm.elbow", "right_arm.link_mass", "payload.length"}
    assert len(told) > 50


@given(stiffness=st.floats(1.0, 1000.0), title=st.text(max_size=40))
def test_numbers_keep_every_bit_and_texts_every_letter(stiffness: float, title: str):
    scenario = load_preset("paper").replace({"payload.bending_stiffness": stiffness, "title": title})
    assert decode_scenario(encode_scenario(scenario)) == scenario


def test_a_link_of_an_earlier_version_with_every_field_opens():
    scenario = load_preset("spin-up")
    assert decode_scenario(packed(json.dumps(scenario.model_dump(mode="json")).encode())) == scenario


ROWS = st.lists(
    st.tuples(*[st.one_of(st.floats(-1e6, 1e6), st.decimals(-1000, 1000, places=5).map(float), st.just(-0.0))] * 3),
    min_size=2,
    max_size=20,
)


@given(ROWS)
def test_rows_of_a_table_keep_every_bit(places: list[tuple[float, ...]]):
    rows = tuple((0.1 * k, *place) for k, place in enumerate(places))
    changes = {"trajectory.kind": "table", "trajectory.rows": rows}
    scenario = load_preset("paper").replace(changes)
    assert repr(decode_scenario(encode_scenario(scenario)).trajectory.rows) == repr(scenario.trajectory.rows)


@pytest.mark.parametrize(
    "columns",
    [
        7,
        [],
        [5],
        [[5]],
        [[5], 3],
        [[2], [9, 1]],
        [[1], [0, 1], [0]],
        [[99], [0, 1]],
        [[1], [0, 0.5]],
        [[0], [4, 10**80]],
    ],
)
def test_invalid_columns_of_a_table_are_refused_in_a_sentence(columns: object):
    data = {"trajectory": {"kind": "table", "columns": columns}}
    with pytest.raises(PresetError, match=r"copy it again"):
        decode_scenario(packed(json.dumps(data).encode()))


@pytest.mark.parametrize(
    "word",
    [
        "",
        "nonsense",
        "ä" * 8,
        encode_scenario(load_preset("paper"))[:-5],
        packed(b"{"),
        packed(b"\xff\xfe"),
        packed(b'{"payload": NaN}'),
        packed(b"[" * 100_000),
        packed(b" " * (LONGEST_TEXT + 1)),
        "A" * 10_000,
    ],
)
def test_an_invalid_link_is_refused_in_a_sentence(word: str):
    with pytest.raises(PresetError, match=r"copy it again"):
        decode_scenario(word)


def test_a_field_that_is_given_twice_is_named():
    with pytest.raises(PresetError, match="the field 'gravity' is given twice in one place"):
        decode_scenario(packed(b'{"gravity": 1, "gravity": 2}'))


@pytest.mark.parametrize("data", ["[]", "null", "3", '{"payload": {"length": -1}}', '{"evil": 1}'])
def test_a_link_to_an_invalid_scenario_is_refused(data: str):
    with pytest.raises(ScenarioError):
        decode_scenario(packed(json.dumps(json.loads(data)).encode()))


@given(st.binary(max_size=200))
def test_arbitrary_bytes_raise_nothing_but_flexlab_s_own_errors(data: bytes):
    with pytest.raises(FlexlabError):
        decode_scenario(base64.urlsafe_b64encode(data).decode())
