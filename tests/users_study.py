"""A study as a user writes it for a table in a paper: it uses all of the interface and passes pyright in strict mode."""

from pathlib import Path

import numpy as np

import flexlab
from flexlab.sim.commands import Tap


@flexlab.metric("J", "Work of the motors")
def motor_work(samples: flexlab.Samples) -> float:
    return float(samples.input_work[-1] - samples.input_work[0])


@flexlab.metric("N·m", "RMS joint torque", of="rms")
def rms_torque(samples: flexlab.Samples) -> np.ndarray:
    return np.sqrt(np.mean(samples.joint_torque**2, axis=(1, 2)))


def study(folder: Path) -> dict[str, float]:
    """Run the study and return its results by name."""
    logs, stiffness = folder / "logs", "payload.bending_stiffness"
    paper, figures = flexlab.load_preset("paper"), list[object]()
    run = flexlab.simulate(paper, 0.2, check=True)
    softer = flexlab.simulate(paper.replace({stiffness: 50.0, "controller.kind": "pd"}), 0.2)
    recorded = run.save(logs)
    found = {
        "error": run.metrics.rms_error.y,
        "same": run.metrics["rms_error.y"],
        "work": run.metrics.motor_work,
        "signals": float(run.to_pandas().shape[1]),
        "samples": float(run.to_arrow().num_rows),
    }

    sweep = flexlab.sweep(paper, {stiffness: "50:200:log:2"}, 0.1, folder=folder / "sweep", progress=False)
    found["largest work"] = float(sweep.column("motor_work").max())
    figures.append(sweep.plot("rms_torque"))

    tuned = flexlab.tune(
        paper,
        {"controller.feedback_gain": "50:500:log"},
        cost={"rms_error.y": 1.0, "motor_work": 1e-6},
        limit={"peak_torque": 700.0},
        duration=0.05,
        candidates=8,
        progress=False,
    )
    found["gain"] = float(tuned.tuned.get("controller.feedback_gain"))
    figures.append(tuned.plot("rms_error.y", "peak_torque"))

    both = flexlab.compare(run, softer)
    figures.append(both.plot("motor_work", "rms_error.y"))
    found["runs"] = float(len(both.to_pandas()))

    tapped = flexlab.simulate(flexlab.load_preset("smooth-start"), 1.0, commands=[(0.5, Tap(0.05, (0.0, 0.3)))])
    ring = flexlab.fit(tapped, start=0.5)
    found["frequency"] = ring.ring.first.frequency.value
    figures.append(ring.plot())

    found["replayed"] = float(flexlab.replay(recorded).identical)
    flexlab.export(run, folder / "run.csv")
    results: list[flexlab.Result] = [sweep, tuned, both, ring]
    for number, result in enumerate(results):
        print(result.to_pandas())
        found[f"says where it is from {number}"] = float({"scenario", "version"} <= set(result.table.column_names))
    found["figures"] = float(len(figures))
    return found
