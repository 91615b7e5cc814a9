"""Wrong physics, one sign at a time, in a copy of the package: `flexlab validate` must notice each.

`python tests/analysis/planted_errors.py` tries all, a minute each, as each compiles the engine anew. The suite tries what needs
no compiling, and that every error can still be planted.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent.parent


class PlantedError(NamedTuple):
    """One sign flipped."""

    name: str
    file: str
    right: str
    wrong: str


PLANTED = (
    PlantedError(
        "payload inertia that an arm drives",
        "control/load_sharing.py",
        "A[1, 2] = s * c * hh, s * hg, -c * hg",
        "A[1, 2] = s * c * hh, s * hg, c * hg",
    ),
    PlantedError(
        "centrifugal force on the beam",
        "physics/dynamics.py",
        "w * w * y[ETA + k] - h * lift",
        "-w * w * y[ETA + k] - h * lift",
    ),
    PlantedError(
        "first moment of the beam",
        "physics/beam.py",
        "(element * l - length / 2) * h_element",
        "(element * l + length / 2) * h_element",
    ),
    PlantedError("bent beam's inertia about θ", "physics/dynamics.py", "= -c * w_bar + s * hg", "= c * w_bar + s * hg"),
    PlantedError(
        "weight of the payload", "physics/dynamics.py", "dy[P + 1] -= plant.m * g", "dy[P + 1] += plant.m * g"
    ),
    PlantedError(
        "Coriolis terms of an arm", "physics/arm.py", "C12, C13, C23 = -arm.mu_12", "C12, C13, C23 = arm.mu_12"
    ),
    PlantedError(
        "torque of the last joint", "physics/arm.py", "on_third = u[2] - arm.reach", "on_third = u[2] + arm.reach"
    ),
    PlantedError("inertia in the internal force", "physics/internal_force.py", "grip -= terms.M", "grip += terms.M"),
    PlantedError(
        "robust term of the law", "control/laws/adaptive_sliding_mode.py", "*= -(K[a] + bound)", "*= -(K[a] - bound)"
    ),
    PlantedError("adaptation", "control/laws/adaptive_sliding_mode.py", "b_rate[1] = s_norm", "b_rate[1] = -s_norm"),
    PlantedError("boundary", "boundaries.py", '"pinned-pinned": (0, -2)', '"pinned-pinned": (0, -1)'),
    PlantedError("stiffness of the beam", "physics/beam.py", "- 4), 6 - 12 * xi", "- 4), 6 + 12 * xi"),
    PlantedError("damping of the beam", "scenario/damping.py", "self.coefficient * (V.T", "-self.coefficient * (V.T"),
    PlantedError("joint rates", "physics/arm.py", "J[1, 2] = second * c1", "J[1, 2] = -second * c1"),
    PlantedError(
        "inertia of an arm", "physics/arm.py", "M23 = arm.mu_23 * arm.tip * (c2", "M23 = arm.mu_23 * arm.tip * (-c2"
    ),
    PlantedError("weight of an arm", "physics/arm.py", "G[a] = g * (", "G[a] = -g * ("),
    PlantedError("acceleration of the path", "control/paths/sine.py", "= -amplitude * rate", "= amplitude * rate"),
)


def planted_text(error: PlantedError) -> str:
    """The file with the error. Raises ValueError if there is no single place for it."""
    text = (ROOT / "flexlab" / error.file).read_text(encoding="utf-8")
    if text.count(error.right) != 1:
        raise ValueError(f"{error.file} has no single {error.right!r}: plant {error.name} elsewhere")
    return text.replace(error.right, error.wrong)


def validate_with(error: PlantedError | None, folder: Path) -> subprocess.CompletedProcess[str]:
    """`flexlab validate` of a copy of the package in `folder`, with an error or without; its machine code goes there, too."""
    package = folder / "flexlab"
    shutil.copytree(ROOT / "flexlab", package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("presets", "web_assets"):
        (folder / name).symlink_to(ROOT / name)
    if error is not None:
        file = package / error.file
        file.write_text(planted_text(error), encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache"), "COLUMNS": "200"}
    return subprocess.run(
        [sys.executable, "-m", "flexlab", "validate", "--to", "report.html"],
        cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8", check=False, timeout=280,
    )  # fmt: skip


if __name__ == "__main__":
    passed = 0
    for planted in PLANTED:
        with tempfile.TemporaryDirectory() as place:
            done = validate_with(planted, Path(place))
            failed = [line.split("  ")[0] for line in done.stdout.splitlines() if line.rstrip().endswith("NO")]
            passed += done.returncode == 0
            print(f"{planted.name}: exit {done.returncode}, {len(failed)} statements fail: {failed[:3]}", flush=True)
    sys.exit(f"{passed} errors pass unnoticed." if passed else 0)
