"""Paths in plain Python: they follow their function, in this process and in another, and failures are reported."""

import re
from pathlib import Path

import numpy as np
import pytest
from own_path_text import ROUND, forget_own_paths

import flexlab
from flexlab import OwnPath, option
from flexlab.analysis.replay import replay
from flexlab.control.motion import poses
from flexlab.control.path import build_motion, forget_path, paths
from flexlab.errors import ScenarioError
from flexlab.lab.panel.sections import entries
from flexlab.own import endless_calls, hosts
from flexlab.own.files import PATH_FILES, path_kind
from flexlab.own.path import add_own_path, sampled
from flexlab.own.reading import TextProblem
from flexlab.presets import load_preset, scenario_text
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.run_files import list_runs
from flexlab.scenario import Scenario, parse_scenario
from flexlab.scenario.field_text import options
from flexlab.server.scenario_links import decode_scenario, encode_scenario
from flexlab.sim.commands import ChangeScenario, StepOnce
from flexlab.sim.runner import Runner
from flexlab.sim.world import World


def scenario(source: str = ROUND, file: str = "round_trip.py", **changes: object) -> Scenario:
    path = add_own_path(source, file)
    return load_preset("paper").replace({"trajectory.kind": path.kind, **changes})


def moving(body: str, lasts: str = "duration = 1.0") -> str:
    """A path whose `position` is `body`, from line 6 on."""
    lines = "".join(f"        {line}\n" for line in body.split("\n"))
    head = "import os, time\nimport numpy as np\nfrom flexlab import OwnPath, option\n"
    return f"{head}class Bad(OwnPath):\n    {lasts}\n    def position(self, t):\n{lines}"


def test_the_target_follows_the_function_and_its_derivatives_and_repeats():
    motion = build_motion(scenario().trajectory)
    t = np.array([0.0, 0.3, 1.999, 2.0, 2.3, 201.7])
    w, turn = np.pi, np.pi * t
    x_d = np.stack([0.1 * np.sin(turn), 0.75 + 0.05 * np.cos(turn), 0.1 * np.sin(turn)], axis=1)
    v_d = w * np.stack([0.1 * np.cos(turn), -0.05 * np.sin(turn), 0.1 * np.cos(turn)], axis=1)
    found = poses(motion, t)
    np.testing.assert_allclose(found[:, 0], x_d, rtol=0, atol=2e-9)
    np.testing.assert_allclose(found[:, 1], v_d, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[:, 2], -w * w * (x_d - [0, 0.75, 0]), rtol=0, atol=1e-4)


def test_a_path_is_held_at_its_end_and_may_begin_in_motion():
    path = scenario(moving("return 0.1 * t, 0.7 + 0.1 * t**2, 0.0")).trajectory
    assert (path.span, path.end) == (1.0, 1.0)
    found = poses(build_motion(path), np.array([0.0, 0.5, 5.0]))
    np.testing.assert_allclose(found[:, 0], [[0, 0.7, 0], [0.05, 0.725, 0], [0.1, 0.8, 0]], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], [[0.1, 0, 0], [0.1, 0.1, 0], [0, 0, 0]], rtol=0, atol=1e-7)


def test_a_separate_process_gives_the_same_bits():
    here = scenario().trajectory.table
    forget_own_paths()
    hosts.run_apart()
    assert scenario().trajectory.table == here


def test_options_are_fields_with_sliders_and_a_change_evaluates_the_function_again():
    chosen = scenario()
    names = [entry.name for entry in entries(chosen, "trajectory")]
    assert names[:2] == ["Radius R", "Centre"]
    assert "round-trip" in options("trajectory.kind")
    assert type(chosen.trajectory).__doc__ == "An ellipse, once in a period."
    wider = chosen.replace({"trajectory.radius": 0.2, "trajectory.period": 4.0})
    assert wider.trajectory.slowest_period == 4.0
    np.testing.assert_allclose(wider.trajectory.reach[0], 0.2, rtol=1e-4)
    with pytest.raises(ScenarioError, match=r"radius = 3 m is outside .* 0 to 2 m"):
        chosen.replace({"trajectory.radius": 3.0})


def test_after_a_change_in_motion_the_target_goes_on_from_its_place():
    world = World(scenario())
    world.advance(300)
    before = world.observe().desired_pose
    world.apply(ChangeScenario({"trajectory.period": 4.0}))
    np.testing.assert_allclose(world.observe().desired_pose, before, rtol=0, atol=1e-8)
    after = world.advance(50)
    turn = 2 * np.pi * (0.3 / 2.0 + (after.time - 0.3) / 4.0)
    x_d = np.stack([0.1 * np.sin(turn), 0.75 + 0.05 * np.cos(turn), 0.1 * np.sin(turn)], axis=1)
    np.testing.assert_allclose(after.desired_pose, x_d, rtol=0, atol=1e-8)


def test_a_recording_replays_without_the_code_even_after_changes(tmp_path: Path):
    own = scenario()
    recorder = Recorder(tmp_path)
    runner = Runner(own, "own", consumers=[recorder], playing=False)
    changes = ({"trajectory.radius": 0.12}, {"trajectory.kind": "sine"}, {"trajectory.kind": "round-trip"})
    for at, change in enumerate(changes):
        runner.submit(StepOnce(30))
        while round(1000 * runner.snapshot.latest.time[0]) < 30 * (at + 1):
            runner.frame()
        runner.submit(ChangeScenario(change))
        while runner.snapshot.scenario.get(next(iter(change))) != next(iter(change.values())):
            runner.frame()
    runner.submit(StepOnce(30))
    while round(1000 * runner.snapshot.latest.time[0]) < 120:
        runner.frame()
    runner.stop()
    recorder.close(60)
    forget_own_paths()  # Neither known nor allowed to run any more.
    recording = read_recording(list_runs(tmp_path)[0])
    assert len(recording.samples) == 121
    assert recording.scenario.trajectory.source == ROUND
    texts = [event.text for event in recording.events]
    assert "trajectory.radius = 0.12" in texts
    assert replay(recording).identical


def test_without_permission_it_runs_and_its_options_cannot_be_changed():
    data = scenario().model_dump(mode="json")
    text = scenario_text(scenario())
    link = encode_scenario(scenario())
    assert decode_scenario(link) == scenario()
    forget_own_paths()
    assert scenario_text(parse_scenario(data)) == text
    assert flexlab.simulate(data, 0.02).status == "finished"
    for changed in ({"radius": 0.2}, {"table": "AAAA"}, {"table": ""}):
        with pytest.raises(
            ScenarioError, match="round-trip came with this scenario as Python code, which does not run"
        ):
            parse_scenario({**data, "trajectory": {**data["trajectory"], **changed}})
    with pytest.raises(ScenarioError, match="does not run by itself"):
        decode_scenario(link)


def test_an_older_text_of_a_path_gets_a_name_of_its_own():
    old = scenario().model_dump(mode="json")
    add_own_path(ROUND.replace("high=2, symbol", "high=1, symbol"), "round_trip.py")
    kept = parse_scenario(old)
    assert kept.trajectory.kind.startswith("round-trip-")
    assert kept.trajectory.table == old["trajectory"]["table"]


BAD = {
    "exception": (moving("x = 1\nreturn {}['grip']"), "bad.py, line 8: KeyError: 'grip'"),
    "not finite": (moving("y = np.nan\nreturn 0, y, 0"), "bad.py, line 8: position(0) returned (0, nan, 0), which is"),
    "wrong shape": (moving("if t > 0.5:\n    return 0.0, 0.7\nreturn 0, 0.7, 0"), "bad.py, line 8: position(0.5"),
    "nothing": (moving("pass"), "bad.py, line 7: position(0) returned nothing"),
    "exit": (moving("raise SystemExit"), "bad.py, line 7: SystemExit"),
    "text": (moving("return 'abc'"), "bad.py, line 7: position(0) returned 'abc'"),
    "corner": (moving("return 0.1 * abs(t - 0.3), 0.7, 0"), "bad.py: near t = 0.3"),
    "jump": (moving("return 0, 0.7 + 0.1 * (t > 0.6), 0"), "bad.py: near t = 0.6"),
    "far": (moving("return 1e9 * t, 0.7, 0"), "bad.py: a pose within its 1 s is more than 1000000 m"),
    "not round": (moving("return 0.1 * t, 0.7, 0", "period = 2.0"), "after its period of 2 s .*: x differs by 0.2 m"),
    "length": (
        moving("return 0, 0.7, 0", "def duration(self): return -3"),
        "bad.py, line 5: duration = -3 s is outside 0.01 to 1000 s",
    ),
}
APART = {
    "stall": (moving("if t > 0.5:\n    time.sleep(0.1)\nreturn 0, 0.7, 0"), "bad.py, line 8: position took longer"),
    "endless loop": (moving("while t > 0.5:\n    pass\nreturn 0, 0.7, 0"), "bad.py, line [78]: position took longer"),
    "os._exit": (moving("if t > 0.5:\n    os._exit(3)\nreturn 0, 0.7, 0"), "bad.py, line 8: it ended its own process"),
    "memory of 2 GB": (moving("x = np.ones(250_000_000)\nreturn 0, 0.7, 0"), "bad.py, line 7: it needs more memory"),
    "crash": (moving("import ctypes\nctypes.string_at(0)\nreturn 0, 0.7, 0"), "bad.py, line 8: its process ended"),
}


@pytest.mark.parametrize("wrong", BAD)
def test_an_error_in_a_path_is_reported_with_its_place(wrong: str):
    source, said = BAD[wrong]
    with pytest.raises(ScenarioError) as caught:
        scenario(source, "/somewhere/bad.py")
    assert_says(str(caught.value), said)


@pytest.mark.parametrize("wrong", APART)
def test_harmful_code_ends_only_the_process_of_the_path(wrong: str):
    hosts.run_apart()
    source, said = APART[wrong]
    with pytest.raises(ScenarioError) as caught:
        scenario(source, "/somewhere/bad.py")
    assert_says(str(caught.value), said)


def test_an_endless_loop_in_this_process_ends_too(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(endless_calls, "LONGEST_CALL", 0.1)
    with pytest.raises(ScenarioError, match=r"bad.py, line [78]: one call took more than 0.1 s of processor time"):
        scenario(APART["endless loop"][0], "/somewhere/bad.py")


def test_ctrl_c_within_a_path_interrupts_its_caller():
    with pytest.raises(KeyboardInterrupt):
        scenario(moving("import signal\nsignal.raise_signal(signal.SIGINT)\nreturn 0, 0.7, 0"), "/somewhere/bad.py")


def test_a_process_that_ended_is_replaced():
    hosts.run_apart()
    source = moving("if t > 0.5 and self.harm:\n    os._exit(3)\nreturn 0, 0.7, 0").replace(
        "    duration", '    harm = option(0.0, "1", low=0, high=1)\n    duration'
    )
    chosen = scenario(source, "bad.py")
    with pytest.raises(ScenarioError, match="it ended its own process"):
        chosen.replace({"trajectory.harm": 1.0})
    assert chosen.replace({"trajectory.harm": 0.5 - 0.5}) == chosen
    hosts.host("path", source).poses(np.zeros(1), np.zeros(2))


def assert_says(text: str, said: str) -> None:
    assert re.search(said.replace("(", r"\(").replace(")", r"\)").replace("+", r"\+"), text), text


POSITION = "    def position(self, t): ...\n"


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("x = (", r"own.py, line 1: this is not valid Python"),
        ("x = 1\n", "has no class that inherits from OwnPath"),
        ("class A(OwnPath):\n    duration = 1\n", r"line 1: A has no method position"),
        ("class A(OwnPath):\n" + POSITION, "line 1: A says neither duration nor period"),
        ("class A(OwnPath):\n    duration = 1\n    period = 1\n" + POSITION, "line 1: A says duration and period"),
        ("class A(OwnPath):\n    duration = 0\n" + POSITION, "line 2: duration = 0 is outside 0.01 to 1000 s"),
        (
            "class A(OwnPath):\n    duration = 1\n    k = option(5, 'm', low=0, high=1)\n" + POSITION,
            "line 3: k: the def",
        ),
        ("class Sine(OwnPath):\n    duration = 1\n" + POSITION, "a path of flexlab is called sine already"),
        (
            "class A(OwnPath):\n    duration = 1\n    shaper = option(1, 'm', low=0, high=1)\n" + POSITION,
            "shaper is a field of every path",
        ),
    ],
)
def test_an_unusable_declaration_is_refused(source: str, said: str):
    known = list(paths())
    with pytest.raises(ScenarioError, match=said):
        add_own_path(source, "own.py")
    assert list(paths()) == known


def test_a_target_out_of_reach_is_reported_with_its_time():
    text = World(scenario(**{"trajectory.radius": 1.5})).status.text
    assert re.search(r"cannot reach the desired pose .*t = 0\.\d+ s", text), text


def test_the_grid_grows_until_spline_and_function_agree():
    def quick(shares: np.ndarray) -> tuple[float, np.ndarray]:
        x = 0.1 * np.sin(2 * np.pi * 64 * shares)  # Zero at ends and middles of 64 equal intervals.
        return 3.0, np.stack([x, x, x], axis=1)

    rows = sampled(quick, True, "quick.py")
    assert 512 < len(rows) <= 4097
    with pytest.raises(TextProblem, match="turns too sharply"):
        sampled(lambda shares: (3.0, np.sin(4000 * np.pi * shares)[:, None] * np.ones(3)), True, "too_quick.py")


@pytest.mark.parametrize("file", PATH_FILES.files(), ids=lambda path: path.stem)
def test_the_examples_are_followed(file: Path):
    run = flexlab.simulate("paper", 1.5, path=file)
    assert run.status == "finished"
    assert np.abs(run.tracking_error[500:]).max() < 2e-3
    assert flexlab.simulate("paper", 0.01, path=path_kind(file)).status == "finished"
    assert len(file.read_text().splitlines()) < 40


class PathOfATest(OwnPath):
    """Back and forth."""

    width = option(0.1, "m", low=0, high=1)
    period = 2.0

    def position(self, t):
        return self.width * np.sin(np.pi * t), 0.75, 0.0


def test_a_class_is_a_path_whose_recording_holds_its_text(tmp_path: Path):
    run = flexlab.simulate("paper", 0.1, path=PathOfATest)
    assert run.status == "finished"
    file = write_run(run, tmp_path, "own")
    forget_own_paths()
    recording = read_recording(file)
    assert "class PathOfATest" in recording.scenario.trajectory.source
    assert replay(recording).identical


def test_the_path_of_the_readme_works(root: Path, tmp_path: Path):
    code = re.findall(r"```python\n(.*?)```", (root / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "mine.py").write_text(next(text for text in code if "OwnPath" in text))
    assert flexlab.simulate("paper", 0.05, path=tmp_path / "mine.py").status == "finished"


def test_a_file_may_hold_a_kernel_instead_and_other_arguments_are_refused(tmp_path: Path):
    assert path_kind(Path(__file__).parent / "own_paths" / "spiral.py") == "spiral"
    forget_path("spiral")
    with pytest.raises(ScenarioError, match="There is no file"):
        path_kind(tmp_path / "none.py")
    with pytest.raises(ScenarioError, match="not a path: give a name"):
        path_kind(3)
    assert not any(kind.startswith("round") for kind in paths())
