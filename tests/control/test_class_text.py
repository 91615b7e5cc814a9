"""Laws and paths given as classes: the text that is kept contains everything they use from their file."""

import gc
import importlib.util
import linecache
import re
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from own_law_text import PD, forget_own_laws
from own_path_text import ROUND, forget_own_paths

import flexlab
from flexlab.analysis.replay import replay
from flexlab.analysis.sweep.axes import parse_axes
from flexlab.errors import ScenarioError
from flexlab.own import hosts
from flexlab.own.class_text import class_text
from flexlab.own.law import add_own_law
from flexlab.own.path import add_own_path
from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.sim.simulate import simulate

TWO_OF_EACH = '''from __future__ import annotations
from math import cos, pi
import math as m
from flexlab import OwnLaw, OwnPath, gain, option
import numpy

STIFFNESS = 2 * 10_000.0
try:
    from no_such_library import turned
except ImportError:
    turned = 2 * pi


def error_of(at) -> numpy.ndarray:
    return STIFFNESS * (at.pose - at.desired_pose)


class One(OwnLaw):
    """First."""

    damping = gain(800.0, "N·s/m", low=0, high=1e5)

    def act(self, at):
        run = error_of(at) + self.damping * (at.pose_rate - at.desired_rate)
        return at.weights - at.shared(run)


class Other(OwnLaw):
    """Second."""

    damping = gain(400.0, "N·s/m", low=0, high=1e5)

    def act(self, at):
        if at.time > 0.02:
            raise RuntimeError("late")
        return at.weights - at.shared(error_of(at) + self.damping * (at.pose_rate - at.desired_rate))


class Round(OwnPath):
    """Round."""

    period = option(2.0, "s", low=1, high=9)

    def position(self, t):
        return 0.1 * m.sin(turned * t / self.period), 0.75 + 0.1 * cos(turned * t / self.period), 0.0


class Back(OwnPath):
    """Back and forth."""

    period = 2.0

    def position(self, t):
        return 0.1 * m.sin(pi * t), 0.75, 0.0


if __name__ == "__main__":
    raise SystemExit("not to be run")
'''


def module_of(text: str, file: Path) -> ModuleType:
    file.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
def test_several_classes_of_one_file_run_one_after_the_other(apart: bool, tmp_path: Path):
    module = module_of(TWO_OF_EACH, tmp_path / "several_classes.py")
    hosts.run_apart(apart)
    for _ in range(2):
        assert flexlab.simulate("paper", 0.01, law=module.One, path=module.Round).status == "finished"
        assert flexlab.simulate("paper", 0.01, law=module.Other, path=module.Back).status == "finished"


def test_a_variable_in_a_method_does_not_run_the_scripts_line_of_that_name(tmp_path: Path):
    """`run = flexlab.simulate(…)` below a law whose `act` has a variable `run`: the law's text simulated again, and failed."""
    module = module_of(f"{TWO_OF_EACH}\nrun, other = numpy.ones(3) / STIFFNESS, None\n", tmp_path / "script.py")
    assert "other" not in class_text(module.One)
    assert flexlab.simulate("paper", 0.01, law=module.One).status == "finished"


COMPUTED = """import numpy as np
from flexlab import OwnLaw, load_preset, simulate

try:
    scale = 1 / 0
except ZeroDivisionError as error:
    print(error)
    scale = 0.5
P = np.zeros(3)
for axis in range(3):
    P[axis] = scale * 40000.0
D = {"rates": [], "none": None, "far": (float("inf"),)}
D["rates"].append(800.0)


class Computed(OwnLaw):
    def act(self, at):
        error, error_rate = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
        return at.weights - at.shared(P * error + min(D["rates"][0], D["far"][0]) * error_rate)


def run():
    return simulate("paper", 0.05, law=Computed).pose


try:
    first = run()
    P = P / 2
    second = simulate("paper", 0.05, law=Computed).pose
    P[0] = 0.0
    third = simulate("paper", 0.05, law=Computed).pose
except ValueError as error:
    print(error)
"""


def test_values_that_a_script_computes_are_those_of_the_moment(tmp_path: Path):
    """The text had the first value of P, zeros, and the last of a name that the script had bound again: errors of 77 mm."""
    module = module_of(COMPUTED, tmp_path / "computing.py")
    held = load_preset("paper").replace({"controller": {"kind": "pd", "control_period": 0.001}})
    for found, gains in ((module.first, [2e4] * 3), (module.second, [1e4] * 3), (module.third, [0.0, 1e4, 1e4])):
        settings = {"controller.position_gain": gains, "controller.velocity_gain": [800.0] * 3}
        np.testing.assert_allclose(found, simulate(held.replace(settings), 0.05).pose, rtol=0, atol=1e-9)
    text = class_text(module.Computed)
    assert "simulate(" not in text
    assert "1 / 0" not in text


MADE = """from flexlab import OwnLaw

K = 0.0


def make(K):
    class Made(OwnLaw):
        velocity_gain = 800.0
        doubled = 2 * 0.5
        period = 0.001

        def act(self, at):
            error, error_rate = at.pose - at.desired_pose, at.pose_rate - at.desired_rate
            return at.weights - at.shared(self.doubled * K * error + self.velocity_gain * error_rate)

    return Made
"""


def test_a_class_has_the_variables_of_the_function_that_made_it_and_its_present_attributes(tmp_path: Path):
    """K of the file was taken for the function's, and a changed attribute had its first value."""
    made = [module_of(MADE, tmp_path / "making.py").make(K) for K in (1e4, 2e4)]
    held = load_preset("paper").replace({"controller": {"kind": "pd", "control_period": 0.001}})
    made[1].velocity_gain = 400.0
    for law, gains in zip(made, ((1e4, 800.0), (2e4, 400.0)), strict=True):
        settings = {"controller.position_gain": [gains[0]] * 3, "controller.velocity_gain": [gains[1]] * 3}
        expected = simulate(held.replace(settings), 0.05).pose
        np.testing.assert_allclose(flexlab.simulate("paper", 0.05, law=law).pose, expected, rtol=0, atol=1e-9)
    made = module_of(MADE, tmp_path / "making_again.py").make(lambda: 1e4)
    with pytest.raises(
        ScenarioError, match=r"Made uses K, a variable of the function that made it, of which a recording cannot"
    ):
        flexlab.simulate("paper", 0.05, law=made)


def test_two_laws_of_one_name_are_not_compared(tmp_path: Path):
    """Both cells of the sweep had the second law, and the leaderboard left the first one out."""
    made = [module_of(MADE, tmp_path / "comparing.py").make(K) for K in (1e4, 2e4)]
    for compare in (
        lambda: flexlab.sweep("paper", {"controller.kind": ["pd", *made]}, duration=0.05),
        lambda: flexlab.leaderboard(["pd", made[0]], ["B3"], more_laws=made[1:]),
    ):
        with pytest.raises(
            ScenarioError, match=r"Two control laws are called made: give one of the classes another name\."
        ):
            compare()
    assert parse_axes({"controller.kind": [made[0], made[0]]}, load_preset("paper"))[0].values == ("made", "made")


def test_a_period_that_was_changed_after_the_class_was_made_is_refused(tmp_path: Path):
    made = module_of(MADE, tmp_path / "changing.py").make(1e4)
    made.period = 0.002
    with pytest.raises(
        ScenarioError, match=r"Made\.period was changed after the class was made: write it into the class\."
    ):
        flexlab.simulate("paper", 0.05, law=made)


def test_an_error_in_a_class_is_reported_with_the_line_of_its_file(tmp_path: Path):
    module = module_of(TWO_OF_EACH, tmp_path / "lines_of_file.py")
    run = flexlab.simulate("paper", 0.1, law=module.Other)
    line = 1 + next(at for at, text in enumerate(TWO_OF_EACH.split("\n")) if "raise RuntimeError" in text)
    source = run.scenario.controller.source
    law = hosts.known_law(source)
    assert law is not None
    assert law.problem == f"lines_of_file.py, line {line}: RuntimeError: late."
    assert "class One" not in source
    assert "not to be run" not in source


def test_a_recording_of_a_class_replays_without_its_file(tmp_path: Path):
    module = module_of(TWO_OF_EACH, tmp_path / "recorded_class.py")
    run = flexlab.simulate("paper", 0.1, law=module.One, path=module.Round)
    path = write_run(run, tmp_path, "own")
    forget_own_laws()
    forget_own_paths()
    (tmp_path / "recorded_class.py").unlink()
    recording = read_recording(path)
    hosts.allow(recording.scenario.controller.source, "recorded_class.py")
    assert replay(recording).identical


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
def test_the_text_of_an_earlier_recording_runs(apart: bool):
    """Older recordings import `OwnLaw`, `OwnPath` and `Measurement` from the modules that held them at the time."""
    hosts.run_apart(apart)
    law = PD.replace("from flexlab import", "from flexlab.own_laws.declaration import")
    law = law.replace("at):", "at: Measurement):").replace(
        "class OwnPD", "from flexlab.own_laws.measurement import Measurement\n\n\nclass OwnPD"
    )
    path = ROUND.replace("from flexlab import", "from flexlab.own_paths.declaration import")
    wanted = {"controller.kind": add_own_law(law, "law.py").kind, "trajectory.kind": add_own_path(path, "path.py").kind}
    assert simulate(load_preset("paper").replace(wanted), 0.01).status == "finished"


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
def test_a_law_or_path_may_import_everything_from_flexlab(apart: bool):
    hosts.run_apart(apart)
    law, path = (re.sub("from flexlab import .*", "from flexlab import *", text) for text in (PD, ROUND))
    wanted = {"controller.kind": add_own_law(law, "law.py").kind, "trajectory.kind": add_own_path(path, "path.py").kind}
    assert simulate(load_preset("paper").replace(wanted), 0.01).status == "finished"


def test_the_examples_of_the_readme_work_as_classes(root: Path, tmp_path: Path):
    texts = re.findall(r"```python\n(.*?)```", (root / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    law = module_of(next(text for text in texts if "OwnLaw" in text), tmp_path / "law_of_readme.py")
    path = module_of(next(text for text in texts if "OwnPath" in text), tmp_path / "path_of_readme.py")
    run = flexlab.simulate("paper", 0.05, law=law.SoftPI, path=path.Eight)
    assert run.status == "finished"
    forget_own_paths()
    file = flexlab.simulate("paper", 0.05, path=tmp_path / "path_of_readme.py")
    np.testing.assert_array_equal(file.desired_pose, run.desired_pose)


def test_a_class_of_a_notebook_may_use_what_other_cells_define(monkeypatch: pytest.MonkeyPatch):
    cells = (
        "from math import pi\nimport numpy as numbers\nfrom scipy.linalg import solve\n"
        "from flexlab import OwnPath\nWIDTH, FARTHEST = 0.1, float('inf')\n",
        "def phase(t):\n    return pi * t / HALF\n\n\nclass Wave:\n    def at(self, t):\n        return numbers.sin(phase(t))\n",
        "HALF = 1.0\n",
        "class InACell(OwnPath):\n    period = 2.0\n\n    def position(self, t):\n"
        "        return min(WIDTH * float(solve([[1.0]], [Wave().at(t)])[0]), FARTHEST), 0.75, 0.0\n",
    )
    notebook = ModuleType("__main__")  # It has no file, and nothing can import it.
    monkeypatch.setitem(sys.modules, "__main__", notebook)
    for number, cell in enumerate(cells):
        name = f"<cell {number}>"
        linecache.cache[name] = (len(cell), None, cell.splitlines(True), name)
        exec(compile(cell, name, "exec"), vars(notebook))
    run = flexlab.simulate("paper", 0.01, path=notebook.InACell, check=True)
    assert run.desired_pose[-1, 0] == pytest.approx(0.1 * np.sin(0.01 * np.pi), abs=1e-9)


def test_a_class_that_inherits_indirectly_is_refused(tmp_path: Path):
    module = module_of(TWO_OF_EACH + "\n\nclass Third(Other):\n    pass\n", tmp_path / "third_class.py")
    with pytest.raises(ScenarioError, match="Third inherits from OwnLaw through another class: inherit directly"):
        flexlab.simulate("paper", 0.01, law=module.Third)


def test_many_threads_may_ask_for_the_text_of_a_class_at_once(tmp_path: Path):
    law = module_of(TWO_OF_EACH, tmp_path / "asked_at_once.py").One
    text, often = class_text(law), gc.get_threshold()

    def let_others_in(*_: object) -> None:
        time.sleep(1e-5)

    gc.callbacks.append(let_others_in)  # Nothing else switches threads within the parser.
    gc.set_threshold(50)
    try:
        with ThreadPoolExecutor(4) as threads:
            assert set(threads.map(class_text, [law] * 20)) == {text}
    finally:
        gc.set_threshold(*often)
        gc.callbacks.remove(let_others_in)
