"""What people get wrong at the command line and in Python is answered in one short sentence."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from lab_process import Command
from odd_files import make_odd_folder

from flexlab.cli import main
from flexlab.errors import FlexlabError, PresetError, ScenarioError, StudyError
from flexlab.presets import load_preset, load_scenario_file
from flexlab.recording.headless import write_run
from flexlab.scenario import parse_scenario
from flexlab.sim.commands import Pull, Reset
from flexlab.sim.simulate import simulate

LONGEST_ANSWER = 3000
"""Characters: what fits on a screen."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short recording."""
    return write_run(simulate(load_preset("paper"), duration=0.1), tmp_path_factory.mktemp("logs"), "paper")


@pytest.fixture
def answer(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """A function that runs a command, which must be refused, and returns the error."""
    monkeypatch.chdir(tmp_path)

    def ask(*words: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.count("\n") == 1, said.err
        return said.err

    return ask


def test_a_folder_in_place_of_a_run_is_refused(answer: Callable[..., str], tmp_path: Path):
    (tmp_path / "FOLDER.rrd").mkdir()
    for command in (("logs", "FOLDER.rrd"), ("review", "FOLDER.rrd"), ("replay", "FOLDER.rrd"), ("logs", ".")):
        assert "cannot be read: it is a folder; name a recording in it." in answer(*command), command


def test_comparing_a_run_with_itself_is_pointed_out(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as ended:
        main(["compare", str(recorded), str(recorded), "--save", str(tmp_path / "both.rrd")])
    assert ended.value.code == 0
    assert "B is the same run as A: nothing can differ between them." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--sample-period", "nan"), "--sample-period nan is not usable: give a number of seconds from 10⁻⁶ to 1."),
        (("--sample-period", "inf"), "--sample-period inf is not usable"),
        (("--duration", "nan"), "--duration nan is not usable: give a number of seconds from 0.001 to 1000000."),
        (("--duration", "-1"), "--duration -1 is not usable"),
    ],
)
def test_a_refusal_of_a_time_names_its_option(answer: Callable[..., str], words: tuple[str, ...], says: str):
    assert says in answer("run", "paper", *words)


def test_odd_files_are_listed_without_escape_codes(recorded: Path, tmp_path: Path, flexlab_command: Command):
    make_odd_folder(tmp_path / "logs", recorded)
    outside = subprocess.run(
        [sys.executable, "-m", "flexlab", "logs"], cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True,
        text=True, encoding="utf-8", timeout=200, check=False, env=os.environ | {"PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    told = {(): outside}
    for words in (("--json",), ("--sort", "size"), ("dangling",), ("deep", "infinite", "surrogate", "escapes")):
        told[words] = flexlab_command("logs", *words)
    for words, done in told.items():
        assert done.returncode == 0, (words, done.stderr)
        assert "Traceback" not in done.stderr
        assert "\x1b" not in done.stdout, "no escape code reaches the terminal"
    rows = {row["run"]: row for row in json.loads(told["--json",].stdout)}
    assert "is a link" in rows["link"]["problem"]
    assert rows["good"]["problem"] == ""
    assert rows["infinite"]["duration [s]"] is None


@pytest.mark.parametrize(
    ("commands", "says"),
    [
        (5, "commands = 5 is not a list"),
        ("tap", "commands = 'tap' is not a list"),
        ([Pull(0.1, (0.0, 0.0), 1.0)], "give pairs of a time in s and a command"),
        ([(float("nan"), Pull(0.1, (0.0, 0.0), 1.0))], "commands: time = nan s is not usable"),
        ([("1", Pull(0.1, (0.0, 0.0), 1.0))], "commands: time = '1' s is not usable"),
        ([(1.0, "tap")], "commands: 'tap' is not a command of a world: give one of ChangeScenario, Pull, Tap"),
        ([(1.0, Reset())], "is not a command of a world"),
    ],
)
def test_wrong_commands_for_a_simulation_are_refused(commands: object, says: str):
    with pytest.raises(StudyError) as caught:
        simulate(load_preset("paper"), 0.01, commands=commands)  # type: ignore[arg-type]
    assert says in str(caught.value)


@pytest.mark.parametrize("duration", ["3", None, True, float("nan"), float("inf"), -1.0, 1j, [1.0], 1e300])
def test_an_unusable_duration_is_refused(duration: object):
    with pytest.raises(StudyError, match="duration"):
        simulate(load_preset("paper"), duration)  # type: ignore[arg-type]


def test_many_wrong_fields_make_a_short_answer():
    with pytest.raises(ScenarioError) as caught:
        parse_scenario({f"field_{number}": 1 for number in range(1000)})
    assert len(str(caught.value)) < LONGEST_ANSWER
    assert "980 more fields are wrong" in str(caught.value)
    assert len(caught.value.problems) == 21
    with pytest.raises(ScenarioError) as caught:
        parse_scenario({f"field_{number}": 1 for number in range(1_000_000)})
    assert str(caught.value) == "This has more than 1000 fields, so it is not a scenario: check what it is."


@pytest.mark.parametrize(
    "data",
    [
        {"payload": {"x" * 1_000_000: 1}},
        {"gravity": "x" * 1_000_000},
        {"gravity": [0] * 1_000_000},
        {"gravity": 10**5000},
        {"controller": {"kind": "x" * 100_000}},
        {"initial": {"beam_coordinates": [0.0] * 100_000}},
        {"title": "x" * 1_000_000},
        {"payload": {"damping": {"kind": "nodal", "coefficient": {"a": {"b": {"c": {"d": {"e": {}}}}}}}}},
        {"payload": {"\x1b[31m": 1}},
    ],
)
def test_a_large_wrong_value_makes_a_short_answer(data: dict):
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(data)
    assert len(str(caught.value)) < LONGEST_ANSWER
    assert "\x1b" not in str(caught.value)


def test_a_very_deeply_nested_value_is_refused():
    nested: list = []
    for _ in range(100_000):
        nested = [nested]
    with pytest.raises(FlexlabError):
        parse_scenario({"gravity": nested})


@pytest.mark.parametrize("name", [3, None, "paper\x1b[31m", ["paper"]])
def test_an_unknown_preset_is_refused(name: object):
    with pytest.raises(PresetError, match="There is no preset"):
        load_preset(name)  # type: ignore[arg-type]


def test_a_field_that_is_given_twice_is_refused(tmp_path: Path):
    path = tmp_path / "twice.json"
    path.write_text('{"gravity": 1, "gravity": 2}')
    with pytest.raises(PresetError, match="the field 'gravity' is given twice in one place"):
        load_scenario_file(path)
