"""Control laws in plain Python: they match built-in laws, in this process and in another, and failures are reported."""

import re
import sys
import threading
import time
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from exported import having
from lab_process import Command
from own_law_text import PD, allow_no_own_laws

import flexlab
from flexlab import OwnLaw, gain
from flexlab.analysis.replay import replay
from flexlab.analysis.result import result_hash
from flexlab.api import Run
from flexlab.control.law import forget_law
from flexlab.errors import ScenarioError
from flexlab.lab.panel.sections import entries
from flexlab.own import endless_calls, hosts
from flexlab.own.declaration import NAMES_OF_RUNS
from flexlab.own.files import LAW_FILES, law_kind
from flexlab.own.law import add_own_law
from flexlab.presets import load_preset, save_scenario
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim import samples
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.motion import controller_states
from flexlab.sim.samples import TAKEN
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


def scenario(source: str = PD, file: str = "own_pd.py", **changes: object) -> Scenario:
    law = add_own_law(source, file)
    return load_preset("paper").replace({"controller.kind": law.kind, **changes})


def acting(body: str, above: str = "") -> str:
    """A law whose `act` is `body`, from line 6 on."""
    lines = "".join(f"        {line}\n" for line in body.split("\n"))
    head = "import os, signal, time\nimport numpy as np\nfrom flexlab import OwnLaw, memory\n"
    return f"{head}class Bad(OwnLaw):{above}\n    def act(self, at):\n{lines}"


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
def test_it_gives_the_motion_of_the_built_in_law_to_the_last_bit(apart: bool):
    hosts.run_apart(apart)
    built_in = load_preset("gravity").replace({"controller.kind": "pd", "controller.control_period": 1e-3})
    own = built_in.replace({"controller.kind": add_own_law(PD, "own_pd.py").kind})
    one, other = simulate(built_in, 0.4), simulate(own, 0.4)
    assert other.status == "finished"
    np.testing.assert_array_equal(other.pose, one.pose)
    assert other["push"].shape == other.time.shape
    assert np.abs(other["push"]).max() > 1


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
@pytest.mark.parametrize(
    ("above", "act"),
    [
        ("", "return np.random.normal(size=(2, 3))"),
        ("\n    last = 0.0", "gone, self.last = at.time - self.last, at.time\nreturn np.full((2, 3), gone)"),
        ("\n    sum = memory(1)\n    turns = 0", "self.turns += 1\nself.sum += self.turns\nreturn np.zeros((2, 3))"),
    ],
    ids=["random numbers", "an attribute", "a memory of an attribute"],
)
def test_a_law_that_answers_one_measurement_in_two_ways_is_told_so(above: str, act: str, apart: bool):
    hosts.run_apart(apart)
    run = flexlab.simulate(scenario(acting(act, above), "own_bad.py"), 0.05)
    assert run.status == "finished"
    said = "act gave two answers to the same measurement, so this run cannot be repeated."
    assert said in run.status.text
    assert said in repr(run)


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
def test_a_law_that_keeps_what_it_remembers_in_a_memory_is_not_warned_about(apart: bool):
    hosts.run_apart(apart)
    assert simulate(scenario(), 0.05).status.text == "Finished at t = 0.05 s."


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
def test_a_law_that_computes_in_place_in_its_measurement_acts_as_one_that_does_not(apart: bool):
    """`error = at.pose; error -= at.desired_pose` was said to remember something, or to be random."""
    hosts.run_apart(apart)
    law = "u = at.weights + at.shared(-2e4 * (at.pose - at.desired_pose) - 800 * at.pose_rate)\n"
    spoilt = "for name, found in vars(at).items():\n    if isinstance(found, np.ndarray): found[...] = 7.0\n"
    plain, odd = (
        simulate(scenario(acting(f"{law}{more}return u"), "own_bad.py", gravity=9.81), 0.05) for more in ("", spoilt)
    )
    assert (odd.status.text, result_hash(odd)) == ("Finished at t = 0.05 s.", result_hash(plain))


def test_joint_torques_and_angles_are_those_of_the_arms():
    source = acting(
        "self.angles = at.joint_angles.ravel()\nself.rates = at.joint_rates.ravel()\n"
        "torques = np.arange(6.0).reshape(2, 3)\nself.now = at.time\nreturn at.from_torques(torques)",
        "\n    angles = memory(6)\n    rates = memory(6)\n    now = memory(1)",
    )
    world = World(scenario(source, "bad.py"))
    run = world.run(5)
    parts = controller_states(world.scenario, world.system, world.state().y)
    angles = run.joint_angle.reshape(6, 6)
    np.testing.assert_allclose(np.exp(1j * parts["angles"]), np.exp(1j * angles[5]), rtol=0, atol=1e-12)
    slopes = [np.polyval(np.polyder(np.polyfit(run.time, angle, 5)), 0.005) for angle in angles.T]
    np.testing.assert_allclose(parts["rates"], slopes, atol=1e-4)
    assert parts["now"][0] == pytest.approx(0.005)
    np.testing.assert_allclose(run.joint_torque[0], np.arange(6.0).reshape(2, 3), rtol=0, atol=1e-12)


def test_its_memory_is_part_of_the_state():
    chosen = scenario()
    one, other = World(chosen), World(chosen)
    one.advance(30)
    other.restore(one.state())
    assert one.advance_rows(30).tobytes() == other.advance_rows(30).tobytes()


def test_gains_are_fields_with_sliders_and_ranges():
    chosen = scenario()
    names = [entry.name for entry in entries(chosen, "controller")]
    assert names[:2] == ["Position gain P", "Velocity gain D"]
    assert chosen.controller.control_period == 1e-3
    with pytest.raises(ScenarioError, match=r"velocity_gain = -1 .* 0 to 100000"):
        chosen.replace({"controller.velocity_gain": -1.0})
    assert type(chosen.controller).__doc__ == "PD with weight compensation, which adds up its error."


def test_gains_change_in_motion_and_a_built_in_law_takes_over():
    world = World(scenario())
    world.advance(20)
    world.apply(ChangeScenario({"controller.velocity_gain": 400.0}))
    world.advance(20)
    world.apply(ChangeScenario({"controller.kind": "computed-torque"}))
    assert len(world.advance(20)) == 20
    world.apply(ChangeScenario({"controller.kind": "own-pd"}))
    assert len(world.advance(20)["push"]) == 20


def test_a_recording_holds_its_text_and_replays_only_when_allowed(tmp_path: Path):
    path = write_run(simulate(scenario(), 0.2), tmp_path, "own")
    recording = read_recording(path)
    assert recording.scenario.controller.source == PD
    assert replay(recording).identical
    last_bits = recording.samples.having(joint_torque=recording.samples.joint_torque * (1 + 1e-15))
    rounded = replay(having(recording, last_bits))
    assert rounded.agrees
    assert "its control law is Python code" in rounded.text
    forget_law("own-pd")
    hosts._allowed.clear()
    recording = read_recording(path)  # The law is known by its text, which has not run.
    assert recording.samples["push"].shape == (201,)
    with pytest.raises(ScenarioError, match="does not run by itself"):
        World(recording.scenario)


def test_it_cannot_be_the_slow_part_of_the_composite_law():
    kind = scenario().controller.kind
    with pytest.raises(ScenarioError, match="the slow part cannot be own-pd, a law in Python: choose one of flexlab's"):
        load_preset("paper").replace({"controller.kind": "composite", "controller.slow.kind": kind})


def test_an_older_text_of_a_law_gets_a_name_of_its_own():
    old = scenario().model_dump(mode="json")
    add_own_law(PD.replace('symbol="D")', 'symbol="D")\n    third = gain(1.0, "1", low=0, high=2)'), "own_pd.py")
    kept = parse_scenario(old)
    assert kept.controller.kind.startswith("own-pd-")
    assert simulate(kept, 0.05).status == "finished"
    assert "third" in type(parse_scenario({"controller": {"kind": "own-pd"}}).controller).model_fields


def test_a_scenario_with_an_older_text_of_a_law_is_written_without_warnings():
    before = scenario()
    add_own_law(PD.replace("gain(800.0", "gain(900.0"), "own_pd.py")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        written = before.model_dump(mode="json")
        assert before.model_dump_json()
    assert written["controller"]["velocity_gain"] == 800.0
    assert parse_scenario(written).controller.source == before.controller.source


BAD = {
    "exception": (acting("x = 1\nreturn {}['grip']"), "bad.py, line 7: KeyError: 'grip'"),
    "not finite": (acting("u = at.weights * np.nan\nreturn u"), "bad.py, line 7: act returned [[nan"),
    "wrong shape": (
        acting("if at.time > 0.01:\n    return np.zeros(3)\nreturn at.weights"),
        "bad.py, line 7: .*array (3,)",
    ),
    "nothing": (acting("pass"), "bad.py, line 6: act returned nothing"),
    "exit": (acting("raise SystemExit"), "bad.py, line 6: SystemExit"),
    "no words": (acting("raise type('Mute', (Exception,), {'__str__': lambda self: 1 / 0})"), "bad.py, line 6: Mute."),
    "text": (acting("return 'left'"), "bad.py, line 6: act returned 'left'"),
    "memory": (acting("self.z = np.zeros(5)\nreturn at.weights", "\n    z = memory(2)"), "the memory z became"),
}
APART = {
    "stall": (
        acting("if at.time > 0.02:\n    time.sleep(0.1)\nreturn at.weights"),
        "bad.py, line 7: act did not answer",
    ),
    "endless loop": (
        acting("while at.time > 0.02:\n    pass\nreturn at.weights"),
        "bad.py, line [67]: act did not answer",
    ),
    "os._exit": (
        acting("if at.time > 0.02:\n    os._exit(3)\nreturn at.weights"),
        "bad.py, line 7: it ended its own process",
    ),
    "memory of 2 GB": (acting("x = np.ones(250_000_000)\nreturn at.weights"), "bad.py, line 6: it needs more memory"),
    "crash": (acting("import ctypes\nctypes.string_at(0)\nreturn at.weights"), "bad.py, line 7: its process ended"),
}


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
@pytest.mark.parametrize("wrong", BAD)
def test_an_error_in_a_law_is_reported_with_file_and_line(wrong: str, apart: bool):
    hosts.run_apart(apart)
    source, said = BAD[wrong]
    run = simulate(scenario(source, "bad.py"), 0.05)
    assert run.status == "law failed"
    assert np.isfinite(run.pose).all()
    assert_says(run.status.text, said)


@pytest.mark.parametrize("period", [None, 0.001])
def test_a_law_that_fails_in_its_last_call_has_failed(period: float | None):
    chosen = scenario(acting('if at.time > 0.0499:\n    raise ValueError("too late")\nreturn at.weights'), "bad.py")
    run = simulate(chosen.replace({"controller.control_period": period}), 0.05)
    assert run.status == "law failed"
    assert_says(run.status.text, "too late")
    assert np.isfinite(run.pose).all()


@pytest.mark.parametrize("wrong", APART)
def test_harmful_code_ends_only_the_process_of_the_law(wrong: str):
    hosts.run_apart()
    source, said = APART[wrong]
    chosen = scenario(source, "bad.py")
    began = time.monotonic()
    run = simulate(chosen, 0.5)
    assert run.status == "law failed"
    assert_says(run.status.text, said)
    assert time.monotonic() - began < 30
    assert_says(simulate(chosen, 0.5).status.text, said)  # The same again in a new process.


def test_an_endless_loop_in_this_process_ends_too(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(endless_calls, "LONGEST_CALL", 0.1)
    run = simulate(scenario(APART["endless loop"][0], "bad.py"), 0.05)
    assert run.status == "law failed"
    assert_says(run.status.text, "bad.py, line [67]: one call took more than 0.1 s of processor time")
    assert len(run) == 22


@pytest.mark.parametrize("when", ["at.time > 0.02", "at.time < 0.03"], ids=["on its way", "from the start"])
def test_ctrl_c_within_a_law_interrupts_the_simulation(when: str):
    chosen = scenario(acting(f"if {when}:\n    signal.raise_signal(signal.SIGINT)\nreturn at.weights"), "bad.py")
    with pytest.raises(KeyboardInterrupt):
        simulate(chosen, 0.05)


def assert_says(text: str, said: str) -> None:
    assert re.search(said.replace("(", r"\(").replace(")", r"\)").replace("[[", r"\[\["), text), text


ACT = "    def act(self, at): ...\n"


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("x = (", r"own.py, line 1: this is not valid Python"),
        ("x = 1\n", "has no class that inherit"),
        ("class A(OwnLaw):\n    pass\n", r"line 1: A has no method act"),
        (
            "class A(OwnLaw):\n    k = gain(5.0, 'N', low=0, high=1)\n    def act(self, at): ...\n",
            "line 2: k: the default 5.0",
        ),
        (
            "class A(OwnLaw):\n    k = gain(f(), 'N', low=0, high=1)\n    def act(self, at): ...\n",
            r"line 2: f\(\) is not a number",
        ),
        ("class A(OwnLaw):\n    k = gain(1.0, low=0, high=1)\n" + ACT, "line 2: k: .*unit"),
        ("class A(OwnLaw):\n    m = memory(0)\n" + ACT, "line 2: m = memory"),
        (
            "class A(OwnLaw):\n    period = 5\n    def act(self, at): ...\n",
            "line 2: period = 5 is outside 10⁻⁵ to 0.1 s",
        ),
        (
            "class A(OwnLaw):\n    period = gain(0.02, 's', low=0.001, high=0.1)\n" + ACT,
            "line 1: period of a law is no method, property or gain: write it out, as in period = 0.001",
        ),
        (
            "class A(OwnLaw):\n" + ACT + "class B(A):\n" + ACT,
            r"line \d: B inherits from OwnLaw through another class: inherit directly",
        ),
        ("class A(OwnLaw):\n    m = memory(True)\n" + ACT, "line 2: m = memory"),
        (
            "class A(OwnLaw):\n    k = gain(1.0, 5, low=0, high=1)\n" + ACT,
            "line 2: k: unit, title and symbol are texts",
        ),
        ("class PD(OwnLaw):\n" + ACT, "a control law of flexlab is called pd already"),
        (
            "class A(OwnLaw):\n    model = gain(0.5, '1', low=0, high=1)\n    def act(self, at): ...\n",
            "field of every controller",
        ),
    ],
)
def test_an_unusable_declaration_is_refused(source: str, said: str):
    with pytest.raises(ScenarioError, match=said):
        add_own_law(source, "own.py")


@pytest.mark.parametrize(
    "source",
    [
        "class A(OwnLaw):\n    period = gain(0.02, 's', low=0.001, high=0.1)\n" + ACT,
        "class A(OwnLaw):\n    def period(self): ...\n" + ACT,
        "class A(OwnLaw):\n" + ACT + "class B(A):\n" + ACT,
    ],
)
def test_a_recorded_text_that_files_may_no_longer_have_is_still_read(source: str) -> None:
    """Such laws were recorded before they were refused, and their recordings have to open."""
    with pytest.raises(ScenarioError):
        add_own_law(source, "own.py")
    recorded = parse_scenario({"controller": {"kind": "a", "source": source}})
    assert recorded.controller.kind == "a"
    assert recorded.controller.control_period == 0.001


@pytest.mark.parametrize(
    "name",
    [
        "pose",
        "time",
        "joint_torque",
        "vibration",
        "signals",
        "own",
        "status",
        *(name for name in vars(Run) if name[0] != "_"),
    ],
)
def test_a_readout_may_not_take_a_name_that_every_run_has(name: str):
    source = f"class A(OwnLaw):\n    {name} = readout('N')\n    def act(self, at):\n        return at.weights\n"
    with pytest.raises(
        ScenarioError, match=f"line 2: the law has a signal {name}, which every run has: give its readout"
    ):
        add_own_law(source, "a.py")


def test_names_of_runs_are_known_where_laws_are_read():
    assert {name for name in TAKEN if not name.startswith("__")} == NAMES_OF_RUNS


@pytest.mark.parametrize("name", ["tracking_error", "joint_torque", "kinetic_energy", "metrics"])
def test_a_recorded_readout_in_the_place_of_a_signal_opens_under_its_own_name(name: str, tmp_path: Path):
    """Until 24 November 2026 a readout with the name of a signal was recorded instead of that signal."""
    act = f"        self.{name} = 2.0 + at.time\n        return at.weights\n"
    source = f"class A(OwnLaw):\n    {name} = readout('N')\n    def act(self, at):\n{act}"
    hosts.allow("from flexlab import OwnLaw, readout\n" + source, "a.py")
    chosen = {"controller": {"kind": "a", "source": "from flexlab import OwnLaw, readout\n" + source}}
    run = simulate(parse_scenario(chosen), 0.02)
    signals = run.signals()
    readout = signals[name] = signals.pop(f"{name}_")
    old = samples.Run(**signals, scenario=run.scenario, status=run.status)
    recording = read_recording(write_run(old, tmp_path, "a"))
    np.testing.assert_array_equal(recording.samples[f"{name}_"], readout)
    assert recording.samples.own.keys() == run.own.keys()
    if name == "tracking_error":
        np.testing.assert_array_equal(recording.samples.tracking_error, run.tracking_error)
    assert replay(recording).agrees


@pytest.mark.parametrize(
    "body",
    [
        "return at.weights + 1j",
        "self.m = np.array(1j)\nreturn at.weights",
        "self.s = np.complex128(1j)\nreturn at.weights",
    ],
)
def test_imaginary_parts_are_not_dropped(body: str):
    run = simulate(
        scenario(
            acting(body, "\n    m = memory(1)\n    s = readout('N')").replace("memory\n", "memory, readout\n", 1),
            "bad.py",
        ),
        0.003,
    )
    assert str(run.status) == "law failed"


def test_a_law_that_cannot_be_loaded_is_refused_and_changes_nothing():
    source = "import no_such_library\n" + PD.split("\n", 2)[2]
    world = World(load_preset("paper"))
    law = add_own_law(source, "own.py")
    with pytest.raises(ScenarioError, match=r"own.py, line 1: ModuleNotFoundError"):
        world.apply(ChangeScenario({"controller.kind": law.kind}))
    assert world.scenario.controller.kind == "adaptive-sliding-mode"
    assert len(world.advance(5)) == 5


def test_a_missing_file_is_reported(tmp_path: Path):
    with pytest.raises(ScenarioError, match="There is no file"):
        LAW_FILES.add(tmp_path / "none.py")


@pytest.mark.parametrize("file", LAW_FILES.files(), ids=lambda path: path.stem)
def test_the_examples_keep_the_payload_on_its_path(file: Path):
    run = flexlab.simulate("paper", 2.0, law=file)
    assert run.status == "finished"
    assert np.abs(run.tracking_error[1000:]).max() < 0.01
    again = flexlab.simulate("paper", 0.3, law=law_kind(file))
    np.testing.assert_array_equal(again.pose, run.pose[: len(again)])


def test_there_are_five_examples_and_none_is_longer_than_a_page():
    examples = ["damped_sliding_mode", "mpc", "observed_lqr", "pid", "sampled_lqr"]
    assert [path.stem for path in LAW_FILES.files()] == examples
    assert all(len(path.read_text().splitlines()) < 80 for path in LAW_FILES.files())


class ClassOfATest(OwnLaw):
    """PD."""

    damping = gain(800.0, "N·s/m", low=0, high=1e5)

    def act(self, at):
        common = -self.damping * (at.pose_rate - at.desired_rate) - 20000 * (at.pose - at.desired_pose)
        return at.weights + at.shared(common)


def test_a_class_is_a_law_whose_recording_holds_its_text(tmp_path: Path):
    run = flexlab.simulate("paper", 0.2, law=ClassOfATest)
    assert run.status == "finished"
    source = flexlab.read(run.save(tmp_path)).scenario.controller.source
    assert "damping = gain(800.0" in source
    line = next(number for number, text in enumerate(source.splitlines()) if "class ClassOfATest" in text)
    assert "class ClassOfATest" in Path(__file__).read_text().splitlines()[line]


def test_a_scenario_with_its_law_goes_to_another_process():
    with ProcessPoolExecutor(1, get_context("spawn")) as other:
        again = other.submit(_same, scenario()).result(60)
    assert again == scenario()


def _same(chosen: Scenario) -> Scenario:
    return chosen


def test_the_shell_runs_and_replays_a_law_file(tmp_path: Path, flexlab_command: Command):
    (tmp_path / "mine.py").write_text(PD)
    done = flexlab_command(
        "run", "paper", "--duration", "0.1", "--law", "mine.py", "--set", "controller.velocity_gain=900"
    )
    assert done.returncode == 0, done.stderr
    save_scenario(scenario(), tmp_path / "kept.json")
    allow_no_own_laws()
    hidden = flexlab_command("run", "kept.json", "--duration", "0.1")
    assert hidden.returncode != 0
    assert "does not run by itself" in hidden.stderr
    again = flexlab_command("replay")
    assert again.returncode != 0
    assert "give --run-own-law to let it run" in again.stderr
    assert "class OwnPD" in again.stderr
    assert flexlab_command("replay", "--run-own-law").returncode == 0
    unknown = flexlab_command("run", "paper", "--law", "none.py")
    assert "There is no file none.py" in unknown.stderr


def test_the_law_of_the_readme_works(root: Path, tmp_path: Path):
    code = re.findall(r"```python\n(.*?)```", (root / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "soft_pi.py").write_text(next(text for text in code if "OwnLaw" in text))
    run = flexlab.simulate("paper", 1.0, law=tmp_path / "soft_pi.py")
    assert run.status == "finished"
    assert np.abs(run.tracking_error[500:]).max() < 0.02


def test_a_file_may_hold_a_kernel_instead():
    run = flexlab.simulate("paper", 0.1, law=Path(__file__).parent / "own_laws" / "leaky_integral.py")
    assert run["asked_work"].shape == (101,)
    forget_law("leaky-integral")


def test_threads_that_add_the_same_law_at_once_all_get_it(tmp_path: Path):
    """A thread once found the law known before scenarios could have it, and was told that it "is not one of" them."""
    load_preset("paper")
    begin = threading.Barrier(4)
    switching = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        for number in range(6):
            file = tmp_path / f"law_{number}.py"
            file.write_text(PD.replace("OwnPD", f"OwnPD{number}"), encoding="utf-8")

            def with_law(_: int, file: Path = file) -> Scenario:
                begin.wait()
                return load_preset("paper").replace({"controller.kind": law_kind(file)})

            with ThreadPoolExecutor(4) as threads:
                assert len(set(threads.map(with_law, range(4)))) == 1
    finally:
        sys.setswitchinterval(switching)
