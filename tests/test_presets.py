"""Presets: complete, documented, and read and written without loss; every failure is one sentence."""

import json
import math
import os
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexlab.assets import presets_folder
from flexlab.errors import PresetError, ScenarioError
from flexlab.presets import (
    find_scenario,
    load_preset,
    load_scenario_file,
    preset_names,
    save_scenario,
    scenario_text,
)
from flexlab.scenario import Scenario, parse_scenario
from flexlab.scenario.scenario import FILE_FIELDS

NAMES = sorted(path.stem for path in presets_folder().glob("*.json"))
ASKED_FOR = {"paper", "smooth-start", "soft-beam", "stiff-beam", "large-swing", "slow-adaptation"}


def one_sentence(text: str) -> bool:
    return "\n" not in text and text[-1] in ".?" and ". " not in text


def stored(name: str) -> dict[str, Any]:
    """Return the contents of the file of a built-in preset."""
    return json.loads((presets_folder() / f"{name}.json").read_text(encoding="utf-8"))


def test_presets_come_in_menu_order_with_the_users_own_last(tmp_path: Path):
    assert set(NAMES) >= ASKED_FOR
    orders = {name: stored(name)["menu_order"] for name in NAMES}
    assert len(set(orders.values())) == len(NAMES)
    for name, order in (("zebra", None), ("a-first-try", None), ("late", 2), ("early", 1), ("no-number", "1")):
        data = json.loads(scenario_text(load_preset("paper")))
        (tmp_path / f"{name}.json").write_text(json.dumps(data | ({"menu_order": order} if order else {})))
    (tmp_path / "broken.json").write_text("{")
    own = ["early", "late", "a-first-try", "broken", "no-number", "zebra"]
    assert preset_names(tmp_path) == [*sorted(NAMES, key=lambda name: orders[name]), *own]
    assert load_preset("early", tmp_path) == load_preset("paper")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_preset_whose_file_name_is_not_utf_8_has_a_name_that_is(tmp_path: Path):
    """Archives of other systems bring such names. One of them ended the start page, and its runs could not be recorded."""
    file = tmp_path / os.fsdecode(b"b\xfcrste.json")
    file.write_text('{"title": "A brush"}')
    name = "b\N{REPLACEMENT CHARACTER}rste"
    assert preset_names(tmp_path)[-1] == name
    for byte in (b"\xfc", b"\xfd"):  # Two such names once hid one another.
        (tmp_path / os.fsdecode(b"m" + byte + b"ll.json")).write_text("{}")
    assert sum(one.startswith("m\N{REPLACEMENT CHARACTER}ll") for one in preset_names(tmp_path)) == 2
    assert load_preset(name, tmp_path).title == "A brush"
    assert find_scenario(str(file)) == (name, load_scenario_file(file))


@pytest.mark.parametrize(
    ("text", "reason"),
    [("[" * 100_000, "its parts are nested too deeply"), ("9" * 5000, "a number has more than 4300 digits")],
)
def test_json_that_python_cannot_read_is_refused_without_advice_for_programmers(tmp_path: Path, text: str, reason: str):
    (tmp_path / "odd.json").write_text(f'{{"gravity": {text}}}')
    with pytest.raises(PresetError) as caught:
        load_preset("odd", tmp_path)
    assert str(caught.value) == f"{tmp_path / 'odd.json'} cannot be read as a scenario: {reason}."


def test_a_preset_with_a_new_menu_order_moves(tmp_path: Path):
    for name, order in (("one", 1), ("two", 2)):
        (tmp_path / f"{name}.json").write_text(json.dumps({"menu_order": order}))
    assert preset_names(tmp_path)[-2:] == ["one", "two"]
    (tmp_path / "one.json").write_text(json.dumps({"menu_order": 3}))
    os.utime(tmp_path / "one.json", ns=(0, 0))
    assert preset_names(tmp_path)[-2:] == ["two", "one"]


def test_paper_is_the_default_scenario():
    paper = load_preset("paper")
    assert paper.model_copy(update={"title": "", "watch": ""}) == Scenario()


@pytest.mark.parametrize("name", NAMES)
def test_a_preset_says_what_to_watch(name: str):
    text = (presets_folder() / f"{name}.json").read_text(encoding="utf-8")
    assert list(json.loads(text))[:2] == ["title", "watch"]
    scenario = load_preset(name)
    assert scenario.title
    assert scenario.watch.endswith(".")
    assert scenario.watch.count(". ") == 1, "two sentences"


@pytest.mark.parametrize("name", NAMES)
def test_a_preset_holds_what_differs_from_the_defaults_and_no_more(name: str):
    def leaves(data: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
        for key, value in data.items():
            yield from leaves(value, f"{path}{key}.") if isinstance(value, dict) else [(path + key, value)]

    complete = load_preset(name)
    for path, _ in leaves(stored(name)):
        *parents, last = path.split(".")
        if last in ("title", "watch", "kind", *FILE_FIELDS):
            continue
        data = part = stored(name)
        for parent in parents:
            part = part[parent]
        del part[last]
        try:
            assert parse_scenario(data) != complete, f"{path} has its default value: leave it out"
        except ScenarioError:
            continue  # Not even valid without it.


def test_a_format_number_of_thousands_of_digits_is_a_short_sentence():
    with pytest.raises(ScenarioError, match="is not known here") as caught:
        parse_scenario({"format": int("9" * 4000)})
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("name", "value", "what"),
    [("format", 1.5, "a whole number"), ("format", True, "a whole number"), ("menu_order", "3", "a whole number"),
     ("$schema", 5, "a text")],
)  # fmt: skip
def test_a_field_of_the_file_with_a_wrong_value_is_not_called_unknown(name: str, value: Any, what: str):
    with pytest.raises(ScenarioError) as caught:
        parse_scenario({name: value})
    assert str(caught.value) == f"{name} = {value!r} is not usable: give {what}, or leave it out."
    assert parse_scenario({"format": 1.0}) == Scenario(), "JSON has one kind of number"


def test_a_file_of_a_later_format_is_refused_in_a_sentence(tmp_path: Path):
    file = tmp_path / "later.json"
    file.write_text('{"format": 99}')
    with pytest.raises(ScenarioError, match=r"later\.json: format = 99 .*flexlab reads 1 to"):
        load_scenario_file(file)


def test_soft_beam_rings_at_five_hertz():
    payload = load_preset("soft-beam").payload
    f1 = math.pi / (2 * payload.length**2) * math.sqrt(payload.bending_stiffness / payload.linear_density)
    assert f1 == pytest.approx(5, rel=0.01)


def test_unknown_preset_names_the_presets_and_the_nearest():
    with pytest.raises(PresetError, match=r"paper, .*did you mean soft-beam") as caught:
        load_preset("soft_beam")
    assert one_sentence(str(caught.value))
    with pytest.raises(PresetError) as caught:
        load_preset("")
    assert one_sentence(str(caught.value))


@pytest.mark.parametrize("name", ["../paper", "/etc/passwd", "presets/paper", "."])
def test_a_preset_name_is_not_a_path(name: str):
    with pytest.raises(PresetError):
        load_preset(name)


def test_own_presets_are_added_but_replace_no_built_in_one(tmp_path: Path):
    save_scenario(Scenario(title="mine", gravity=1.0), tmp_path / "mine.json")
    save_scenario(Scenario(gravity=1.0), tmp_path / "paper.json")
    assert "mine" in preset_names(tmp_path)
    assert load_preset("mine", tmp_path).gravity == 1
    assert load_preset("paper", tmp_path).gravity == 0


def test_find_scenario_takes_names_and_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    save_scenario(Scenario(gravity=2.0), "moon.json")
    assert find_scenario("paper") == ("paper", load_preset("paper"))
    assert find_scenario("moon.json") == ("moon", Scenario(gravity=2.0))
    assert find_scenario(str(tmp_path / "moon.json"))[0] == "moon"
    with pytest.raises(PresetError, match=r"no scenario file .*mars\.json"):
        find_scenario("mars.json")


numbers = st.floats(min_value=0.01, max_value=100)


@given(EI=numbers, gravity=st.floats(-50, 50), gain=st.one_of(numbers, st.tuples(numbers, numbers, numbers)))
def test_writing_and_reading_lose_nothing(tmp_path_factory: pytest.TempPathFactory, EI, gravity, gain):
    changes = {"payload.bending_stiffness": EI, "gravity": gravity, "controller.feedback_gain": gain}
    scenario = Scenario(title="θ “quoted”").replace(changes)
    file = tmp_path_factory.getbasetemp() / "any.json"
    save_scenario(scenario, file)
    assert load_scenario_file(file) == scenario
    assert next(iter(json.loads(file.read_text(encoding="utf-8"))["controller"])) == "kind"


def test_a_file_that_begins_with_a_byte_order_mark_is_read(tmp_path: Path):
    (tmp_path / "marked.json").write_text('{"gravity": 1.0}', encoding="utf-8-sig")
    assert load_scenario_file(tmp_path / "marked.json").gravity == 1.0


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "line 1"),
        (b'{\n  "gravity": 1,\n}', "line"),
        (b'{\n  "gravity": 9,81\n}', "line 2"),
        (b"\xff\xfe\x00", "UTF-8"),
        (b"[" * 100_000, "cannot be read"),
        (b'{"gravity": 1, "gravity": 2}', "twice"),
        (b'{"gravity": ' + b"9" * 5000 + b"}", "cannot be read"),
    ],
)
def test_a_broken_file_is_one_sentence_with_its_name(tmp_path: Path, content: bytes, says: str):
    file = tmp_path / "broken.json"
    file.write_bytes(content)
    with pytest.raises(PresetError, match=says) as caught:
        load_scenario_file(file)
    sentence = str(caught.value)
    assert "broken.json" in sentence
    assert one_sentence(sentence.replace("broken.json", "file"))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("[]", "JSON object"),
        ('{"gravity": NaN}', "finite"),
        ('{"gravity": 1e999}', "finite"),
        ('{"gravty": 1}', "gravty is not a scenario field"),
        ('{"payload": {"bending_stiffness": -1}}', "bending_stiffness = -1"),
    ],
)
def test_an_invalid_scenario_is_one_sentence_with_the_file_name(tmp_path: Path, content: str, says: str):
    file = tmp_path / "wrong.json"
    file.write_text(content)
    with pytest.raises(ScenarioError, match=says) as caught:
        load_scenario_file(file)
    assert "wrong.json: " in str(caught.value)
    assert len(caught.value.problems) == 1


def test_a_file_far_too_large_for_a_scenario_is_not_read(tmp_path: Path):
    """Megabytes of fields took seconds to be refused, one by one."""
    fields, path = dict.fromkeys(map(str, range(1000)), 0), tmp_path / "mine.json"
    path.write_text(json.dumps({"payload": fields, "gravity": 9.81}))
    with pytest.raises(ScenarioError, match=r"mine\.json: This has more than 1000 fields, so it is not a scenario"):
        load_scenario_file(path)
    path.write_bytes(b"{}" + bytes(5_000_000))
    with pytest.raises(PresetError, match=r"mine\.json has more than 5 MB: name a file with a scenario\."):
        load_scenario_file(path)


def test_a_folder_or_a_missing_folder_is_one_sentence(tmp_path: Path):
    with pytest.raises(PresetError, match="cannot be read"):
        load_scenario_file(tmp_path)
    with pytest.raises(PresetError, match="cannot be written"):
        save_scenario(Scenario(), tmp_path / "nowhere" / "file.json")


def test_every_preset_can_be_pickled():
    """Studies and private labs compute in other processes, and pickle does not find the parts of composite by name."""
    for name in preset_names():
        assert pickle.loads(pickle.dumps(load_preset(name))) == load_preset(name), name
