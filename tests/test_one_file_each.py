"""What the guide for contributors promises: a new metric, signal, damping, observer, case, lesson, study or command is one file.

Each is added to a copy of flexlab, in the one file that the guide names, and then appears wherever the others do. The copy
runs as plain Python, so that nothing has to be compiled, with given steps, as their trials are slow then. One process tries
almost all of them.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.recording.store.formats import FORMAT
from flexlab.sim.simulate import simulate

LEFT_OUT = shutil.ignore_patterns("*.nbi", "*.nbc")
"""Machine code. Python's bytecode is copied: it stays valid except for the files that are changed."""


def run(copy: Path, program: str) -> Any:
    """Run a program with the copy and return the JSON in its last line."""
    environment = os.environ | {"PYTHONPATH": str(copy), "NUMBA_DISABLE_JIT": "1", "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=copy, env=environment, capture_output=True, text=True, encoding="utf-8"
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


METRIC = '''
"""How fast the payload gets."""

import numpy as np

from flexlab.analysis.metrics.metric import Column, Peak, register


@register
class PeakSpeed(Peak):
    """Largest speed of the payload's middle, m/s."""

    name, place = "peak_speed", 55
    columns = (Column("speed", "Peak speed", "speed", "m/s", listed=True),)

    def signal(self, samples):
        """The speed of an instant, (N, 1)."""
        return np.hypot(samples.pose_rate[:, 0], samples.pose_rate[:, 1])[:, None]
'''
DAMPING = '''class HighPassDamping(DampingKind):
    """Damps fast modes only."""

    kind: Literal["high-pass"] = "high-pass"
    rate: Number = quantity(5.0, title="Damping of fast modes", symbol="d", unit="1/s", low=0, high=100, slider=(0, 50))

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV."""
        return np.diag(np.where(omega > 2 * omega[0], self.rate, 0.0))


'''
DERIVED = '''    @derived("v", "m/s", plotted=True)
    def speed(self) -> np.ndarray:
        """Speed of the payload's middle."""
        return np.hypot(self.pose_rate[:, 0], self.pose_rate[:, 1])

'''
CASE = '''
"""Gravity."""

from flexlab.analysis.leaderboard.case import Case
from flexlab.analysis.leaderboard.case import peak_error

CASE = Case("B9", "Upright", "The paper's sine, upright.", 0.004, (peak_error(),), {"gravity": 9.81, "simulation.step": 5e-4})
'''
LESSON = """---
title: How soon is it quiet?
preset: paper
---
Beams ring. How long?

## Do
1. Press R.

## Observe
It rings for half a second.

## Check
seconds = settled(0, 1)
if t < 1: Let the run go on to t = 1 s.
done if seconds < 0.5: It is quiet after {seconds:.2f} s ✓
else: It still rings.
"""
STUDY = '''
"""The first natural frequency of the beam at both ends of what is varied."""

from dataclasses import dataclass

from flexlab.analysis.modes import modes
from flexlab.scenario.settings import change_settings
from flexlab.server.studies import Found, Question, Study, axes_of, whole_of
from flexlab.server.task_book import Outcome


@dataclass
class Ends(Study):
    kind, place, title, what, run_words = "ends", 30, "Ends", "First frequencies.", "run"
    questions = (Question("number", "Mode", "1", range=(1, 2)),)
    scenario: object
    axes: tuple
    number: int

    @classmethod
    def read(cls, form, scenario, duration):
        return cls(scenario, axes_of(form, scenario, counted=False), whole_of(form, "number", "Mode"))

    def job(self):
        return self.frequencies

    def frequencies(self):
        axis = self.axes[0]
        ends = [change_settings(self.scenario, {axis.path: value}) for value in (axis.low, axis.high)]
        found = [modes(end).frequency[self.number - 1] for end in ends]
        return Outcome(list(zip((axis.low, axis.high), map(float, found))))

    def drawing(self, task):
        return task.result and {"points": task.result, "titles": ["value", "f (Hz)"]}

    def found(self, task):
        return Found([(f"Mode {self.number} (Hz)", *(f"{f:.4g}" for _, f in task.result))])


STUDY = Ends
'''
OBSERVER = '''
"""An observer that believes its sensors."""

from typing import Literal

import numpy as np

from flexlab.control.law import USUAL_GAUGES
from flexlab.control.observers.observer import Observer
from flexlab.quantities import Count, Number, Numbers, quantity


class Believing(Observer):
    """Pose and rate as measured; the modes follow the model."""

    kind: Literal["believing"] = "believing"
    observer_modes: Count = quantity(1, "Modes observed", "n_o", "1", low=1, high=2)
    gauges: Numbers = USUAL_GAUGES
    horizon: Number | None = None
    belief: Number = quantity(1.0, "Belief", "b", "1", low=0, high=1, slider=(0, 1))

    def gain(self, scenario, plant, transition, inputs):
        n = len(plant.mass)
        L = np.zeros((2 * n, 6 + len(plant.strain)))
        L[:3, :3] = L[n : n + 3, 3:6] = self.belief * np.eye(3)
        return L
'''
COMMAND = '''"""`flexlab greet NAME`: say good morning."""

import tyro

from flexlab.cli.console import output


def command(name: tyro.conf.Positional[str]) -> int:
    """Greet somebody."""
    output().print(f"Good morning, {name}.")
    return 0
'''
NEW = {
    "flexlab/analysis/metrics/peak_speed.py": METRIC,
    "flexlab/analysis/leaderboard/cases/b8_upright.py": CASE,
    "web_assets/guide/lessons/11-quiet.md": LESSON,
    "flexlab/control/observers/believing.py": OBSERVER,
    "flexlab/server/studies/ends.py": STUDY,
    "flexlab/cli/greet_command.py": COMMAND,
}
"""Files that are added."""
SIGNALS = "flexlab/sim/signals.py"
INSERTED = (
    ("flexlab/scenario/payload.py", "Damping = Annotated[Any,", DAMPING),
    (SIGNALS, "    @derived(", DERIVED),
    # Simulated: a row, and its line in the kernel; once for the payload, once for each arm.
    (SIGNALS, "    tracking_error: np.ndarray = row(", '    speed_squared: np.ndarray = row("v²", "m²/s²", "squared speed")\n'),
    (SIGNALS, "    row[SATURATED] = saturated\n", "    row[SPEED] = ws.velocity[0] ** 2 + ws.velocity[1] ** 2\n"),
    (SIGNALS, "    joint_torque: np.ndarray = row(", '    push: np.ndarray = row("|u|", "N", "push", ARM, plotted=True)\n'),
    (SIGNALS, "        joint_angles(theta, ", "        arm[PUSH] = abs(ws.u[i, 0])\n"),
    (SIGNALS, "\n\n@inlined\ndef write_sample(", '\nSPEED, PUSH = COLUMN["speed_squared"], COLUMN["push"]\n'),
)  # fmt: skip
"""(file, text in it, what is inserted before the first occurrence of that text)."""

PROGRAM = """
import io, json, pydoc
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
import numpy as np
import flexlab
from flexlab.analysis.leaderboard.report import report_text
from flexlab.analysis.lesson_checks import read_check
from flexlab.analysis.replay import replay
from flexlab.analysis.run_summary import note_metrics
from flexlab.cli import main
from flexlab.cli.logs_command import FIELDS
from flexlab.guide import lessons
from flexlab.lab.panel.sections import entries
from flexlab.lab.plots import tabs
from flexlab.presets import load_preset
from flexlab.recording.codec import decode_block, encode_block
from flexlab.recording.export import export_recording, import_run
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.recording.run_info import signals_text
from flexlab.recording.store.run_index import list_rows
from flexlab.scenario import Scenario, parse_scenario
from flexlab.scenario.field_text import options
from flexlab.sim.world import World

run = flexlab.simulate(load_preset("smooth-start").replace({"simulation.step": 5e-4}), 0.004)
path = write_run(run, Path("logs"), "run")
note_metrics(path)
(row,) = list_rows(Path("logs"))
found = {"home": flexlab.__file__}
found["metric"] = [run.metrics.peak_speed, [row.key for row in run.metrics.rows], row.metrics, list(FIELDS)]

recording = read_recording(path)
plots = {plot.title: [plot.labels, plot.values(run.scenario, run).tolist()] for plot in tabs(run.scenario)["Control"]}
found["plots"] = [plots["Speed of the payload's middle v"], plots["Push |u|"], "Squared speed v²" in plots]
table = export_recording(recording, Path("run.csv"))
columns = table.read_text(encoding="utf-8").split("\\n")[1].split(",")
lines = [line.strip(" |") for line in pydoc.render_doc(flexlab.Run, renderer=pydoc.plaintext).splitlines()]
found["replayed"] = replay(recording).identical
for name in ("speed", "speed_squared", "push"):
    signal = np.asarray(run[name] if name != "speed" else run.speed)
    kept = [np.asarray(getattr(samples, name)) for samples in (
        recording.samples, decode_block(encode_block(run.slice(0, len(run))))[0], import_run(table)[0])]
    found[name] = {
        "values": signal.tolist(), "same": [other.tobytes() == signal.tobytes() for other in kept],
        "columns": [word for word in columns if word.split(" ")[0] in (name, name + "_left", name + "_right")],
        "documented": [line for line in lines if line.startswith(name + " -- ")],
        "told": "`" + name + "`" in signals_text(run.scenario),
    }
    if name != "speed":
        changed = signal.copy()
        changed[3] += 1e-9
        other = replace(recording)
        vars(other)["samples"] = type(recording.samples)(**(recording.samples.signals() | {name: changed}))
        found[name]["noticed"] = not replay(other).identical

changes = {"payload.damping.kind": "high-pass", "payload.damping.rate": 20.0, "simulation.step": 5e-4}
scenario = load_preset("paper").replace(changes)
world = World(scenario)
rates = world.system.plant.damping
world.run(2)
names = [entry.name for entry in entries(scenario, "payload")]
again = parse_scenario(json.loads(scenario.model_dump_json())) == scenario
found["damping"] = [rates[0, 0], rates[-1, -1], names, "high-pass" in json.dumps(Scenario.model_json_schema()), again]

found["observer"] = []
for law in ("lqr", "composite"):
    observed = {"controller.kind": law, "controller.control_period": 1e-3, "simulation.step": 5e-4}
    observed |= {"controller.observer.kind": "believing", "controller.observer.belief": 0.5}
    world = World(load_preset("paper").replace(observed))
    names = [entry.name for entry in entries(world.scenario, "controller")]
    again = parse_scenario(json.loads(world.scenario.model_dump_json())) == world.scenario
    found["observer"].append([len(world.run(2)), "Belief b" in names, again, list(options("controller.observer.kind"))])

board = flexlab.leaderboard(["pd"], ["B9"], progress=False)
found["case"] = [board.rows[0].scores["peak"], "B9: Upright" in report_text(board)]
newest, ring = lessons()[-1], read_recording(next(Path("ring").glob("*.rrd")))
checked = read_check(newest).verdict(ring.scenario, ring.samples)
found["lesson"] = [newest.id, newest.title, newest.text, checked]

def said(*words):
    with redirect_stdout(io.StringIO()) as told:
        try:
            main(words)
        except SystemExit as end:
            return end.code, told.getvalue()

found["command"] = [said("greet", "Anna"), said("--help"), said("completion", "bash")]
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def copy(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of flexlab with one more of each, and a run recorded without them."""
    copy = tmp_path_factory.mktemp("copy")
    for folder in ("flexlab", "presets", "web_assets"):
        shutil.copytree(root / folder, copy / folder, ignore=LEFT_OUT)
    for name, text in NEW.items():
        (copy / name).write_text(text, encoding="utf-8")
    write_run(simulate(load_preset("paper"), 1.0), copy / "ring", "paper")
    for name, before, text in INSERTED:
        source = (copy / name).read_text(encoding="utf-8")
        place = source.index(before)
        (copy / name).write_text(source[:place] + text + source[place:], encoding="utf-8")
    return copy


@pytest.fixture(scope="module")
def found(copy: Path) -> dict[str, Any]:
    """What the copy reports about the additions."""
    found = run(copy, PROGRAM)
    assert Path(found["home"]).is_relative_to(copy)
    return found


def test_a_metric_is_one_file(found: dict[str, Any]):
    peak, keys, listed, fields = found["metric"]
    assert peak > 0.1
    assert "Peak speed [m/s]" in keys
    assert "Peak speed [m/s]" in listed
    assert "peak_speed" in fields


def test_a_damping_is_one_class_in_one_file(found: dict[str, Any]):
    first, last, names, in_schema, again = found["damping"]
    assert [first, last] == [0.0, 20.0]
    assert "Damping of fast modes d" in names
    assert in_schema
    assert again


def test_an_observer_is_one_file(found: dict[str, Any]):
    assert found["observer"] == [[3, True, True, ["measured", "believing", "kalman"]]] * 2


def test_a_signal_computed_from_others_is_one_property(found: dict[str, Any]):
    speed = found["speed"]
    assert len(speed["values"]) == 5
    assert all(speed["same"])
    assert speed["columns"] == [], "tables hold what was simulated; the rest follows from it"
    assert speed["documented"] == ["speed -- v: speed of the payload's middle, m/s, (N,)"]
    assert found["replayed"]


@pytest.mark.parametrize(
    ("name", "columns", "documented"),
    [
        ("speed_squared", ["speed_squared [m²/s²]"], "v²: squared speed, m²/s², (N,)"),
        ("push", ["push_left [N]", "push_right [N]"], "|u|: push, N, (N, arms)"),
    ],
)
def test_a_simulated_signal_is_one_row_and_one_line_in_the_same_file(
    found: dict[str, Any], name: str, columns: list[str], documented: str
):
    signal = found[name]
    assert len(signal["values"]) == 5
    assert min(signal["values"][-1] if name == "push" else signal["values"][-1:]) > 0
    assert all(signal["same"]), "recorded, in a block, and in a table"
    assert signal["columns"] == columns
    assert signal["documented"] == [f"{name} -- {documented}"]
    assert signal["told"]
    assert found["replayed"]
    assert signal["noticed"], "a replay compares it"


def test_a_signal_that_says_so_is_plotted(found: dict[str, Any]):
    speed, push, squared_too = found["plots"]
    assert speed == [["v (m/s)"], [found["speed"]["values"]]]
    assert push == [
        ["|u| left (N)", "|u| right (N)"],
        [list(row) for row in zip(*found["push"]["values"], strict=True)],
    ]
    assert not squared_too


def test_a_case_of_the_leaderboard_is_one_file(found: dict[str, Any]):
    peak, reported = found["case"]
    assert 0 < peak < 0.1
    assert reported


def test_a_lesson_is_one_file(found: dict[str, Any]):
    name, title, text, checked = found["lesson"]
    assert [name, title] == ["quiet", "How soon is it quiet?"]
    assert "half a second" in text
    assert checked == [True, "It is quiet after 0.44 s ✓"]


def test_a_study_of_the_page_is_one_file(copy: Path):
    found = run(
        copy,
        """
import json, sys, time
from pathlib import Path
sys.path[:0] = TESTS
from http_client import wait_until
from person import Visitor
from flexlab.presets import load_preset
from flexlab.server.front_server import open_front_server
from flexlab.server.scenario_links import encode_scenario
from flexlab.server.settings import Settings

paper = load_preset("paper")
form = {"scenario": encode_scenario(paper), "name": "paper", "kind": "ends", "duration": "3", "number": "1",
        "field1": "payload.bending_stiffness", "low1": "100", "high1": "400"}
if __name__ == "__main__":
    # Nobody opens a private lab, which would take a processor to itself.
    with open_front_server(Settings(logs=Path("logs"), port=0, private=True), paper, "paper") as server:
        visitor = Visitor(server.url)
        offered = visitor.ask("/studies").text
        address = visitor.post("/studies", *form.items()).headers["Location"]
        wait_until(lambda: not json.loads(visitor.ask(address + "/state").text)["working"], "it is done", 200)
        page, data = visitor.ask(address).text, json.loads(visitor.ask(address + "/data").text)
    print(json.dumps(["<h2>Ends</h2>" in offered, "Mode 1 (Hz)" in page, data["points"]]))
""".replace("TESTS", repr([str(Path(__file__).parent / "server"), str(Path(__file__).parent)])),
    )
    (low, first), (high, second) = found[2]
    assert found[:2] == [True, True]
    assert (low, high) == (100.0, 400.0)
    assert second == pytest.approx(2 * first), "frequencies go with the root of the stiffness"


def test_a_command_is_one_file(found: dict[str, Any]):
    greeted, helped, completed = found["command"]
    assert greeted == [0, "Good morning, Anna.\n"]
    assert "  flexlab greet NAME       say good morning\n" in helped[1]
    assert "greet" in completed[1]


def test_a_signal_since_a_later_format_than_the_present_one_is_refused(copy: Path):
    file = copy / SIGNALS
    before = file.read_text(encoding="utf-8")
    late = f'"squared speed", since={FORMAT + 1})'
    file.write_text(before.replace('"squared speed")', late), encoding="utf-8")
    said = run(
        copy,
        """
import json
try:
    import flexlab.recording.store.formats
    print(json.dumps("nothing"))
except ValueError as error:
    print(json.dumps(str(error)))
""",
    )
    file.write_text(before, encoding="utf-8")
    assert said == f"speed_squared: since is above format {FORMAT}, which is written now: leave it out."
