"""Make the golden recordings of the present format: `python tests/recording/golden/make.py`.

Run it once, when a format is new, and keep what it made as it is. The recordings hold all that a recording can: sliders,
taps, pulls on beam and link, sampled control with noise and delay, one arm, and a run that continues from another.
"""

import hashlib
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from flexlab.analysis.resume import resume
from flexlab.presets import load_preset
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.formats import FORMAT
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Origin

FRAME = 0.0692
"""Wall-clock time between two commands, s: not a multiple of the sample period."""

COMMANDS = (
    ChangeScenario({"payload.bending_stiffness": 61.0}),
    Tap(0.2, (0.02, 0.05)),
    Pull(0.02, (0.1, 0.8), 30.0),
    ChangeScenario({"trajectory.frequency": (0.9, 0.8, 0.7)}),
    Pull(0.3, (-0.8, 0.5), 40.0, link=(1, 2)),
    ChangeScenario({"gravity": 1.0, "payload.damping.coefficient": 0.05}),
    Pull(0.0, (0.0, 0.0), 0.0),
)

NOISY = {
    "controller.control_period": 0.002,
    "controller.input_delay": 1,
    "controller.sensor_noise.pose": (1e-4, 1e-4, 1e-4),
    "controller.sensor_noise.pose_rate": (1e-3, 1e-3, 1e-3),
    "controller.sensor_noise.seed": 7,
}


def clock_of(time: list[float]) -> Callable[[], float]:
    """A clock that shows `time[0]`."""
    return lambda: time[0]


def record(logs: Path, name: str, scenario: Scenario, origin: Origin | None = None) -> Path:
    """Record half a second of a lab in which all of `COMMANDS` are given."""
    time = [0.0]
    recorder = Recorder(logs, queue_rows=10**6)
    runner = Runner(scenario, name, [recorder], clock=clock_of(time), origin=origin)
    for command in (*COMMANDS, None):
        time[0] += FRAME
        runner.frame()
        if command is not None:
            runner.submit(command)
    runner.stop()
    recorder.close(60.0)
    return max(logs.glob(f"*-{name}.rrd"))


def main(folder: Path) -> None:
    """Write the recordings and their facts into `folder`."""
    folder.mkdir()
    with TemporaryDirectory() as place:
        logs = Path(place)
        noisy = load_preset("vibration-damping").replace(NOISY)
        made = {name: record(logs, name, load_preset(name)) for name in ("paper", "single-arm")}
        made["sampled-control"] = record(logs, "noisy", noisy)
        made["continued"] = record(logs, "continued", *resume(read_recording(made["sampled-control"]), 0.2))
        facts = {}
        for name, path in made.items():
            shutil.copy(path, folder / f"{name}.rrd")
            recording = read_recording(path)
            signals = recording.samples.signals()
            facts[name] = {
                "samples": len(recording.samples),
                "status": str(recording.status),
                "events": [event.text for event in recording.events],
                "sha256": {
                    n: hashlib.sha256(np.ascontiguousarray(a).tobytes()).hexdigest() for n, a in signals.items()
                },
            }
    (folder / "facts.json").write_text(json.dumps(facts, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / f"format-{FORMAT}")
