"""Print as JSON the result hashes of runs with every preset, law, path, integrator and change, in this process's environment."""

import json
import sys

import numpy as np

from flexlab.analysis.result import result_hash
from flexlab.control.law import laws
from flexlab.control.path import paths
from flexlab.presets import load_preset, preset_names
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.simulate import simulate

DURATION = 0.1
"""Duration, s: runs that differ at all do so from their first step on, or from a change on."""
SOONER, LATER = 0.03, 0.06

TABLE = tuple((t, 0.1 * t, 0.65 + 0.3 * t * t, 0.2 * t) for t in np.linspace(0.0, 1.0, 12).tolist())
NOISY = {"pose": (1e-4, 1e-4, 1e-4), "pose_rate": (1e-3, 1e-3, 1e-3), "strain": 1e-6, "seed": 7}
BEAMS = {
    "pinned": {"boundary": "pinned-pinned", "element_count": 4},
    "coupled": {"boundary": "clamped-pinned", "element_count": 12, "damping": {"kind": "nodal", "coefficient": 0.05}},
    "fine": {"element_count": 20, "damping": {"kind": "stiffness", "coefficient": 1e-4}},
}
SAMPLED_ONLY = ("lqr",)


def scenarios() -> dict[str, Scenario]:
    """All scenarios to simulate, by name."""
    plain = Scenario()
    found = {f"preset {name}": load_preset(name) for name in preset_names()}
    for kind in laws():
        sampled = {} if kind not in SAMPLED_ONLY else {"controller.control_period": 0.001}
        found[f"law {kind}"] = plain.replace({"controller.kind": kind, **sampled})
    for kind in paths():
        found[f"path {kind}"] = plain.replace({"trajectory.kind": kind})
    rows = {"trajectory.kind": "table", "trajectory.rows": TABLE}
    found |= {f"table {ends}": plain.replace({**rows, "trajectory.ends": ends}) for ends in ("at rest", "free")}
    for shaper in ("zv", "zvd", "ei-shaper"):
        found[f"shaper {shaper}"] = load_preset("sudden-stop").replace({"trajectory.shaper": shaper})
    for name, payload in BEAMS.items():
        found[f"beam {name}"] = plain.replace({f"payload.{field}": value for field, value in payload.items()})
    for name in ("rk4", "etdrk4", "generalized-alpha"):
        found[f"integrator {name}"] = plain.replace({"simulation.integrator": name, "simulation.step": 1e-4})
    found["accuracy"] = plain.replace({"simulation.accuracy": 1e-7})
    noisy = {"controller.control_period": 0.002, "controller.input_delay": 1, "controller.sensor_noise": NOISY}
    found["noise"] = load_preset("vibration-damping").replace(noisy)
    return found


def hashes() -> dict[str, str]:
    """The result hash of every run."""
    found = {name: result_hash(simulate(scenario, DURATION)) for name, scenario in scenarios().items()}
    commands = [
        (SOONER, ChangeScenario({"payload.bending_stiffness": 61.0})),
        (SOONER, Tap(0.2, (0.02, 0.05))),
        (SOONER, Pull(0.02, (0.1, 0.8), 30.0)),
        (LATER, ChangeScenario({"trajectory.frequency": (0.9, 0.8, 0.7), "gravity": 1.0})),
        (LATER, Pull(0.3, (-0.8, 0.5), 40.0, (1, 2))),
        (LATER, ChangeScenario({"trajectory.kind": "rest-to-rest"})),
    ]
    found["changes"] = result_hash(simulate(Scenario(), DURATION, commands=commands))
    return found


if __name__ == "__main__":
    json.dump(hashes(), sys.stdout)
