"""Own laws and paths with odd declarations or results: each gets one sentence, and no number is silently changed."""

import csv
import warnings
from pathlib import Path
from typing import Any

import pytest
from exported import export_run

import flexlab
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.own import hosts
from flexlab.own.declaration import read_declaration
from flexlab.own.law import add_own_law
from flexlab.own.path import add_own_path
from flexlab.own.reading import with_data
from flexlab.recording.export import import_run
from flexlab.scenario import parse_scenario

LAW = """import numpy as np
from flexlab import OwnLaw, gain, memory, readout
class Odd(OwnLaw):
    k = gain(1.0, "N", {range})
    m = memory(3)
    s = readout("N")
    def act(self, at):
        {body}
        return at.weights
"""
PATH = """import numpy as np
from flexlab import OwnPath, option
class OddWay(OwnPath):
    size = option(1.0, "m", {range})
    {lasts}
    def position(self, t):
        return {pose}
"""
MASKED = "np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False])"
ODD_THREE = [
    "['1', '2', '3']",
    "np.array(['1', '2', '3'])",
    "[1j, 0, 0]",
    "np.array([1j, 0, 0])",
    "[np.complex64(1j), None, 0]",
    MASKED,
    "np.array([1, 2, 3], 'm8[s]')",
]


def law_text(body: str = "pass", scale: str = "low=0, high=2") -> str:
    return LAW.format(body=body, range=scale)


def path_text(pose: str = "0.0, 0.75, 0.0", scale: str = "low=0, high=2", lasts: str = "duration = 1.0") -> str:
    return PATH.format(pose=pose, range=scale, lasts=lasts)


def test_a_name_that_is_given_twice_has_its_last_meaning():
    text = law_text().replace('s = readout("N")', 's = readout("N")\n    s = readout("m")\n    m = readout("K")')
    declared = read_declaration(text, "odd.py")
    assert [(name, signal.unit) for name, signal in declared.signals] == [("m", "K"), ("s", "m")]
    assert declared.memory == ()


@pytest.mark.parametrize("name", ["period", "on_save"])
@pytest.mark.parametrize("mark", ["@property\n    ", ""])
def test_a_period_that_only_a_run_of_the_text_would_tell_is_refused(name: str, mark: str):
    """A control period written as a property was passed over: the law ran every 1 ms."""
    text = law_text().replace("    def act", f"    {mark}def {name}(self):\n        return 0.01\n    def act")
    with pytest.raises(ScenarioError, match=f"odd.py, line 3: {name} .*: write it out, as in {name} = "):
        add_own_law(text, "odd.py")


def test_a_gain_of_three_numbers_counts_as_three():
    many = "".join(f"    k{number} = gain((1.0, 1.0, 1.0), 'N', low=0, high=2)\n" for number in range(21))
    text = law_text().replace("    m = memory(3)\n", many)
    assert len(read_declaration(text, "odd.py").settings) == 22
    with pytest.raises(ScenarioError, match="Odd declares 65 gains: 64 are the most"):
        read_declaration(text.replace("    k =", "    j = gain(1.0, 'N', low=0, high=2)\n    k ="), "odd.py")


@pytest.mark.parametrize("name", ["_k", "__class__", "__dict__", "model_config", "model_fields", "model_dump"])
def test_a_gain_or_option_may_not_take_a_name_that_its_model_needs(name: str):
    with pytest.raises(ScenarioError, match=f"{name} .*: give the gain another name"):
        add_own_law(law_text().replace("k =", f"{name} ="), "odd.py")
    with pytest.raises(ScenarioError, match=f"{name} .*: give the option another name"):
        add_own_path(path_text().replace("size =", f"{name} ="), "odd.py")
    if name.startswith("_"):
        with pytest.raises(ScenarioError, match=f"{name} .*: give the gain another name"):  # A scenario file.
            parse_scenario({"controller": {"kind": "odd", "source": law_text().replace("k =", f"{name} =")}})


@pytest.mark.parametrize("name", ["reach", "options", "jumps", "middle", "repeats", "slowest_period", "keeping"])
def test_an_option_may_not_take_the_name_of_a_property_of_paths(name: str):
    with pytest.raises(ScenarioError, match=f"{name} is a field of every path: give the option another name"):
        add_own_path(path_text().replace("size =", f"{name} ="), "odd.py")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["jumps", "discontinuities", "keeping", "taken_up", "model_copy", "model_dump"])
def test_a_recorded_text_with_a_setting_of_such_a_name_opens_with_its_value(name: str):
    """flexlab has got some of these properties later."""
    source = path_text("self.size, 0.75, 0.0").replace("size", name)
    hosts.allow(source, "odd.py")
    recorded = parse_scenario({"trajectory": {"source": source, name: 0.5}}).model_dump()["trajectory"]
    recorded[name] = recorded.pop(f"{name}_")
    hosts._allowed.clear()
    assert parse_scenario({"trajectory": recorded}).trajectory.rows[0, 1] == 0.5, "its table, as the text may not run"
    law = law_text(f"self.s = self.{name}").replace("k =", f"{name} =")
    hosts.allow(law, "odd.py")
    run = flexlab.simulate(flexlab.load_preset("paper").replace({"controller": {"source": law, name: 0.5}}), 0.003)
    assert run["s"].tolist() == [0.5] * 4


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["copy", "json", "schema", "validate", "dict", "self", "model_mass"])
def test_a_gain_may_have_a_name_that_its_model_does_not_need(name: str):
    law = add_own_law(law_text().replace("k =", f"{name} ="), "odd.py")
    run = flexlab.simulate(flexlab.load_preset("paper").replace({"controller.kind": law.kind}), duration=0.003)
    assert not run.status.failed


@pytest.mark.parametrize("parts", [500, 3000])
@pytest.mark.parametrize("deep", ["f" + ".a", "f" + "[0]", "f" + "()", "1" + "+1", "1" + "-f"])
def test_a_very_long_expression_is_refused_with_its_line(deep: str, parts: int):
    text = law_text().replace("gain(1.0", f"gain({deep[0] + deep[1:] * parts}")
    with pytest.raises(ScenarioError, match=r"odd.py, line \d+"):
        add_own_law(text, "odd.py")


def test_a_very_long_class_name_is_refused_in_a_short_sentence():
    for add, text in ((add_own_law, law_text()), (add_own_path, path_text().replace("OddWay", "Odd"))):
        with pytest.raises(ScenarioError, match="the name of the class has 150003 characters") as caught:
            add(text.replace("Odd", "Odd" + "x" * 150_000), "odd.py")
        assert len(str(caught.value)) < 200


@pytest.mark.parametrize("text", ["-" * 90_000 + "1", "(" * 90_000])
def test_very_deep_nesting_is_refused_with_the_reason(text: str):
    with pytest.raises(ScenarioError, match=r"odd.py, line 1: this is not valid Python \(.+\)"):
        add_own_law(text, "odd.py")


@pytest.mark.parametrize("unit", ["N, N·m", 'N,=HYPERLINK("http://x.invalid","y")', "N\n=1+1", "=1+1"])
def test_an_odd_unit_is_exported_as_one_cell_and_never_as_a_formula(unit: str, tmp_path: Path):
    law = add_own_law(law_text().replace('readout("N")', f"readout({unit!r})"), "odd.py")
    run = flexlab.simulate(flexlab.load_preset("paper").replace({"controller.kind": law.kind}), duration=0.005)
    file = export_run(run, tmp_path / "run.csv")
    with file.open(encoding="utf-8", newline="") as lines:
        assert lines.readline().startswith("# {")
        rows = list(csv.reader(lines))
    assert {len(row) for row in rows} == {len(rows[0])}
    assert not [cell for row in rows for cell in row if cell[0] in "=+@\t\r"]
    assert len(import_run(file)[0]) == len(run)


@pytest.mark.parametrize(
    ("scale", "says"),
    [
        ("low=0, high=2, slider=(5, 9)", "slider = (5, 9) is not a part of its range: give two numbers within 0 to 2"),
        ("low=0, high=2, slider=(1, 1)", "slider = (1, 1) is not a part"),
        ("low=0, high=2, slider=(2, 1)", "slider = (2, 1) is not a part"),
        ("low=0, high=2, slider=(0, 1, 2)", "is not a part"),
        ("low=0, high=2, slider=1", "slider = 1 is not a part"),
        ("low=0, high=2, slider='01'", "slider = '01' is not a part"),
        ("low=0, high=2, slider=('0', '1')", "is not a part"),
        ("low=0, high=2, logarithmic=True", "begins above 0, and low = 0: give slider=(LOW, HIGH)"),
        ("low=-1, high=2, slider=(0, 1), logarithmic=True", "begins above 0, and slider = (0, 1)"),
        ("low=1, high=2, logarithmic='no'", "logarithmic = 'no' is not usable: give True or False"),
    ],
)
def test_a_slider_has_to_lie_within_the_range(scale: str, says: str):
    for add, text, name in ((add_own_law, law_text(scale=scale), "k"), (add_own_path, path_text(scale=scale), "size")):
        with pytest.raises(ScenarioError) as caught:
            add(text, "odd.py")
        assert str(caught.value).startswith(f"odd.py, line 4: {name}: ")
        assert says in str(caught.value)


@pytest.mark.parametrize(
    "odd",
    [
        "low=0, high=2, slider=(5, 9)",
        "low=0, high=2, slider='01'",
        "low=0, high=2, logarithmic=True",
        "low=0, high=2, title=None",
        "low=0, high=2, symbol=5",
    ],
)
def test_a_recorded_law_with_an_odd_gain_opens_with_a_usual_one(odd: str):
    """Such a gain was accepted when it was recorded."""
    with pytest.raises(ScenarioError, match=r"odd\.py, line 4: k: "):
        add_own_law(law_text(scale=odd), "odd.py")
    scenario = parse_scenario({"controller": {"source": law_text(scale=odd)}})
    about = scenario.about("controller.k")
    assert (scenario.controller.kind, about.slider, about.logarithmic) == ("odd", (0, 2), False)
    assert (about.title, about.unit_text()) == ("K", " N")
    assert about.symbol == ("5" if "symbol" in odd else "")


@pytest.mark.parametrize(
    "change",
    [
        "self.k *= 1.01",
        "self.k = 2",
        "self.k: float = 2",
        "self.k[0] = 2.0",
        "del self.k",
        "a, (self.k, *b) = 1, (2, 3)",
    ],
)
def test_a_method_that_changes_a_gain_or_option_is_refused(change: str):
    """The change was undone at the next call without a word. A recording with such a text opens."""
    law = law_text(f"self.m[0] = self.k\n        self.s, other = self.k, at\n        {change}")
    with pytest.raises(
        ScenarioError, match=r"odd\.py, line 10: no method can change k, .*: use a memory for what changes"
    ):
        add_own_law(law, "odd.py")
    assert parse_scenario({"controller": {"source": law}}).controller.kind == "odd"
    path = path_text().replace("        return", f"        {change.replace('.k', '.size')}\n        return")
    with pytest.raises(ScenarioError, match=r"odd\.py, line 7: no method can change size, .*: use another name"):
        add_own_path(path, "odd.py")


@pytest.mark.parametrize(("unit", "shown"), [("None", ""), ("5", " 5")])
def test_a_recorded_law_with_a_unit_that_is_not_a_text_opens(unit: str, shown: str):
    text = law_text().replace('gain(1.0, "N"', f"gain(1.0, {unit}")
    assert parse_scenario({"controller": {"source": text}}).about("controller.k").unit_text() == shown


def test_a_recorded_law_with_a_very_long_name_opens():
    text = law_text().replace("Odd", "Odd" + "x" * 200)
    assert parse_scenario({"controller": {"source": text}}).controller.kind == "odd" + "x" * 200


@pytest.mark.parametrize("given", ODD_THREE)
@pytest.mark.parametrize(
    "body",
    [
        "return [{}] * 2",
        "self.m = {}",
        "self.s = {}[0:1]",
        "return at.shared({})",
        "return at.inputs_for({})",
        "return at.from_torques([{}] * 2)",
        "at.net_force([{}] * 2)",
    ],
)
def test_a_law_that_does_not_give_real_numbers_fails(given: str, body: str):
    body = body.replace("{}", given)
    if body == f"self.s = {MASKED}[0:1]":
        body = "self.s = np.ma.masked"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        add_own_law(law_text(body), "odd.py")
        run = flexlab.simulate("paper", 0.003, law="odd")
    assert str(run.status) == "law failed", body
    assert "odd.py, line " in run.status.text, run.status.text
    assert "Warning" not in run.status.text, run.status.text


@pytest.mark.parametrize("given", [*ODD_THREE, "'123'", "[10**400, 0, 0]"])
def test_a_path_that_does_not_give_real_numbers_is_refused(given: str):
    add_own_path(path_text(given), "odd.py")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ScenarioError, match=r"odd.py, line 7: position\(0\) returned .* not three finite numbers"):
            flexlab.simulate("paper", 0.003, path="odd-way")


@pytest.mark.parametrize("span", ["'3'", "10**400", "3 + 0j", "np.complex128(3)", "np.ma.masked", "[3.0, 3.0]"])
def test_a_duration_that_is_not_a_real_number_is_refused(span: str):
    add_own_path(path_text(lasts=f"def duration(self): return {span}"), "odd.py")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ScenarioError, match=r"odd.py, line 5: duration = .* is outside"):
            flexlab.simulate("paper", 0.003, path="odd-way")


@pytest.mark.parametrize("name", [None, 5, b"x", ["x"], object(), "a\0b", "\ud800"])
def test_an_odd_name_of_a_data_file_raises_oserror(name: Any):
    with pytest.raises(OSError, match="give the name of a file in the same folder"):
        flexlab.data_file(name)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (f'data_file("{"a" * 300}")', "it cannot be read"),
        (r'data_file("a\0b")', "there is no such file"),
        (r'data_file("\ud800")', "there is no such file"),
        ('data_file(name="x.npy")', "without name= before it"),
    ],
)
def test_data_that_cannot_be_kept_are_refused(call: str, says: str, tmp_path: Path):
    with pytest.raises(FlexlabError, match=says):
        with_data(f"X = {call}\n", tmp_path, "controller.source")


@pytest.mark.parametrize("word", ["law", "path"])
def test_simulate_many_refuses_a_bad_law_or_path_as_simulate_does(word: str, tmp_path: Path):
    bad = tmp_path / "bad.py"
    bad.write_text("class A(OwnLaw):\n    pass\n\n\nclass B(OwnPath):\n    pass\n")
    for given in ("nonsense", bad, str(tmp_path / "none.py"), 5):
        said = []
        for ask in (flexlab.simulate, lambda *words, **named: flexlab.simulate_many([words[0]], *words[1:], **named)):
            with pytest.raises(ScenarioError) as caught:
                ask("paper", 0.002, **{word: given})
            said.append(str(caught.value))
        assert said[0] == said[1]


def test_an_invalid_scenario_among_many_becomes_a_run_that_says_so():
    runs = flexlab.simulate_many(["paper", {"gravity": "x"}], 0.002, law="pd", progress=False)
    assert [str(run.status) for run in runs] == ["finished", "invalid"]


@pytest.mark.parametrize("part", ["controller", "trajectory"])
def test_a_text_with_a_lone_surrogate_is_refused(part: str):
    with pytest.raises(ScenarioError, match="is not valid Python"):
        parse_scenario({part: {"source": "x = '\ud800'\n"}})
