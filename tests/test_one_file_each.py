"""What the guide for contributors promises: a metric, a signal, a damping and a lesson touch one file each.

Each is added to a copy of flexlab, in the one file that the guide names, and then shows wherever the others show. The copy
runs as plain Python: nothing has to be compiled for it.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

LEFT_OUT = shutil.ignore_patterns("__pycache__", "*.pyc", "*.nbi", "*.nbc")


@pytest.fixture
def copy(tmp_path: Path, root: Path) -> Path:
    """A copy of flexlab that may be changed."""
    for folder in ("flexlab", "presets", "web_assets"):
        shutil.copytree(root / folder, tmp_path / folder, ignore=LEFT_OUT)
    return tmp_path


def run(copy: Path, program: str) -> Any:
    """What a program prints that runs with the copy, as JSON."""
    environment = os.environ | {"PYTHONPATH": str(copy), "NUMBA_DISABLE_JIT": "1", "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=copy, env=environment, capture_output=True, text=True, encoding="utf-8"
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def insert(file: Path, before: str, text: str) -> None:
    """Write `text` ahead of the only place where `before` stands."""
    source = file.read_text(encoding="utf-8")
    assert source.count(before) == 1
    file.write_text(source.replace(before, text + before), encoding="utf-8")


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


def test_a_metric_is_one_file(copy: Path):
    (copy / "flexlab/analysis/metrics/peak_speed.py").write_text(METRIC, encoding="utf-8")
    found = run(
        copy,
        """
import json
from pathlib import Path
import flexlab
from flexlab.analysis.run_summary import note_metrics
from flexlab.cli.runs_listing import FIELDS
from flexlab.recording.headless import write_run
from flexlab.recording.store.run_index import list_rows

run = flexlab.simulate("smooth-start", 0.004)
path = write_run(run, Path("logs"), "run")
note_metrics(path)
(row,) = list_rows(Path("logs"))
print(json.dumps([run.metrics.peak_speed, [row.key for row in run.metrics.rows], row.metrics, list(FIELDS)]))
""",
    )
    assert found[0] > 0.1
    assert "Peak speed [m/s]" in found[1]
    assert "Peak speed [m/s]" in found[2]
    assert "peak_speed" in found[3]


DAMPING = '''
class HighPassDamping(DampingKind):
    """Damps fast modes only."""

    kind: Literal["high-pass"] = "high-pass"
    rate: Number = quantity(5.0, title="Damping of fast modes", symbol="d", unit="1/s", low=0, high=100, slider=(0, 50))

    def modal(self, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
        """VᵀDV."""
        return np.diag(np.where(omega > 2 * omega[0], self.rate, 0.0))


'''


def test_a_damping_is_one_class_in_one_file(copy: Path):
    insert(copy / "flexlab/scenario/damping.py", "Damping = Annotated[Any,", DAMPING.lstrip("\n"))
    found = run(
        copy,
        """
import json
from flexlab.lab.panel.sections import entries
from flexlab.presets import load_preset
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.world import World

scenario = load_preset("paper").replace({"payload.damping.kind": "high-pass", "payload.damping.rate": 20.0})
world = World(scenario)
rates = world.system.plant.damping
world.run(2)
names = [entry.name for entry in entries(scenario, "payload")]
schema = json.dumps(Scenario.model_json_schema())
again = parse_scenario(json.loads(scenario.model_dump_json())) == scenario
print(json.dumps([rates[0, 0], rates[-1, -1], names, "high-pass" in schema, again]))
""",
    )
    assert found[:2] == [0.0, 20.0]
    assert "Damping of fast modes d" in found[2]
    assert found[3:] == [True, True]


DERIVED = '''
    @derived("v", "m/s")
    def speed(self) -> np.ndarray:
        """Speed of the payload's middle."""
        return np.hypot(self.pose_rate[:, 0], self.pose_rate[:, 1])

'''
"""A property of the table, ahead of the first one there."""
READ_BACK = """
import json, pydoc
from pathlib import Path
import numpy as np
import flexlab
from flexlab.analysis.replay import replay
from flexlab.recording.export import export_run
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording

run = flexlab.simulate("paper", 0.004)
recording = read_recording(write_run(run, Path("logs"), "run"))
export_run(run, Path("run.csv"))
head = Path("run.csv").read_text(encoding="utf-8")[:20000]
text = pydoc.render_doc(flexlab.Run, renderer=pydoc.plaintext)
same = np.asarray(recording.samples.NAME).tobytes() == np.asarray(run.NAME).tobytes()
print(json.dumps([np.asarray(run.NAME).tolist(), same, "NAME" in head, "NAME -- " in text, replay(recording).identical]))
"""
NOTICED = (
    READ_BACK.rpartition("print(")[0]
    + """
changed = np.array(recording.samples.NAME)
changed[3] += 1e-9
samples = type(recording.samples)(**(recording.samples.signals() | {"NAME": changed}))
noticed = not replay(recording, [samples]).identical
found = np.asarray(run.NAME).tolist(), same, "NAME" in head, "NAME -- " in text
print(json.dumps([*found, replay(recording).identical, noticed]))
"""
)


def test_a_signal_that_follows_from_others_is_one_property(copy: Path):
    source = (copy / "flexlab/sim/signals.py").read_text(encoding="utf-8")
    first = re.search(r"\n    @derived\(", source)
    assert first is not None
    text = source[: first.start()] + DERIVED.rstrip("\n") + "\n" + source[first.start() :]
    (copy / "flexlab/sim/signals.py").write_text(text, encoding="utf-8")
    values, same, exported, documented, replayed = run(copy, READ_BACK.replace("NAME", "speed"))
    assert len(values) == 5
    assert same
    assert not exported, "tables hold what was simulated; the rest follows from it"
    assert documented
    assert replayed


def test_a_signal_that_is_simulated_is_one_row_and_its_line_in_the_same_file(copy: Path):
    file = copy / "flexlab/sim/signals.py"
    row = '    speed_squared: np.ndarray = row("v²", "m²/s²", "squared speed of the payload")\n'
    insert(file, "    tracking_error: np.ndarray = row(", row)
    insert(file, "    row[SATURATED] = saturated\n", "    row[SPEED] = ws.velocity[0] ** 2 + ws.velocity[1] ** 2\n")
    insert(file, "\n\n@inlined\ndef write_sample(", '\nSPEED = COLUMN["speed_squared"]\n')
    *found, replayed, noticed = run(copy, NOTICED.replace("NAME", "speed_squared"))
    values, same, exported, documented = found
    assert len(values) == 5
    assert values[-1] > 0
    assert same
    assert exported
    assert documented
    assert replayed
    assert noticed, "a replay compares it"


def test_a_signal_of_a_format_that_is_not_written_yet_is_refused(copy: Path):
    row = '    speed_squared: np.ndarray = row("v²", "m²/s²", "squared speed of the payload", since=3)\n'
    insert(copy / "flexlab/sim/signals.py", "    tracking_error: np.ndarray = row(", row)
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
    assert said == "speed_squared: since is above format 2, which is written now: leave it out."


CASE = '''
"""Gravity."""

from flexlab.analysis.leaderboard.case import Case
from flexlab.analysis.leaderboard.case import peak_error

CASE = Case("B8", "Upright", "The paper's sine, upright.", 0.004, (peak_error(),), {"gravity": 9.81})
'''


def test_a_case_of_the_leaderboard_is_one_file(copy: Path):
    (copy / "flexlab/analysis/leaderboard/cases/b8_upright.py").write_text(CASE, encoding="utf-8")
    found = run(
        copy,
        """
import json
import flexlab
from flexlab.analysis.leaderboard.report import report_text
board = flexlab.leaderboard(["pd"], ["B8"], progress=False)
print(json.dumps([board.rows[0].scores["peak"], "B8: Upright" in report_text(board)]))
""",
    )
    assert 0 < found[0] < 0.1
    assert found[1]


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


def test_a_lesson_is_one_file(copy: Path):
    (copy / "web_assets/guide/lessons/11-quiet.md").write_text(LESSON, encoding="utf-8")
    found = run(
        copy,
        """
import json
from flexlab.analysis.lesson_checks import check_lesson
from flexlab.guide import lessons
from flexlab.presets import load_preset
from flexlab.sim.simulate import simulate
newest = lessons()[-1]
run = simulate(load_preset("paper"), 1.0)
print(json.dumps([newest.id, newest.title, newest.text, check_lesson(newest.id, run.scenario, run)]))
""",
    )
    assert found[:2] == ["quiet", "How soon is it quiet?"]
    assert "half a second" in found[2]
    assert found[3] == [True, "It is quiet after 0.44 s ✓"]
