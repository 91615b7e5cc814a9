"""Wrong physics, one sign at a time, in a copy of the package: `flexlab validate` must notice each.

The suite tries the first few, as each compiles the engine anew; `python tests/analysis/planted_errors.py` tries all.
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
)


def validate_with(error: PlantedError | None, folder: Path) -> subprocess.CompletedProcess[str]:
    """`flexlab validate` of a copy of the package in `folder`, with an error or without; its machine code goes there, too."""
    package = folder / "flexlab"
    shutil.copytree(ROOT / "flexlab", package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("presets", "web_assets"):
        (folder / name).symlink_to(ROOT / name)
    if error is not None:
        file = package / error.file
        text = file.read_text(encoding="utf-8")
        assert text.count(error.right) == 1, f"{error.file} has no single {error.right!r}"
        file.write_text(text.replace(error.right, error.wrong), encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache"), "COLUMNS": "200"}
    return subprocess.run(
        [sys.executable, "-m", "flexlab", "validate", "--to", "report.html"],
        cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8", check=False, timeout=280,
    )  # fmt: skip


if __name__ == "__main__":
    for planted in PLANTED:
        with tempfile.TemporaryDirectory() as place:
            done = validate_with(planted, Path(place))
            failed = [line.split("  ")[0] for line in done.stdout.splitlines() if line.rstrip().endswith("NO")]
            print(f"{planted.name}: exit {done.returncode}, {len(failed)} statements fail: {failed[:3]}", flush=True)
