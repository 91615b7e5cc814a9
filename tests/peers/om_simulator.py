"""The paper's plant and law as FMUs coupled by OMSimulator (https://openmodelica.org), compared with `flexlab.simulate`.

`python tests/peers/om_simulator.py` needs `pip install OMSimulator`, which fetches its binary from openmodelica.org; the suite
makes the same comparison with FMPy. For FMI 2 and 3 and each coupling step it prints how far apart the poses are, and how
far the payload is from its path, mm and mrad.
"""

import csv
import re
import zipfile
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from OMSimulator.capi import Capi  # pyright: ignore[reportMissingImports]

import flexlab

DURATION, TICK = 3.0, 1e-4
"""s."""
STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)
"""Time from one exchange of values to the next, s."""
WEAKLY_COUPLED = 1
"""Type of a system in OMSimulator: all FMUs take a step, then they exchange values."""
POSE = ("pose_x", "pose_y", "pose_theta")


def main() -> None:
    """Print the table."""
    print("FMI  step [ms]  apart [mm, mrad]  off the path from 1 s on [mm, mrad]")
    with TemporaryDirectory() as folder, chdir(folder):
        for version in (2, 3):
            files = {
                part: flexlab.export_fmu("paper", f"{part}{version}.fmu", part, version, TICK).resolve()
                for part in ("plant", "law")
            }
            for step in STEPS:
                run = flexlab.simulate("paper", duration=DURATION, sample_period=step)
                pose = coupled(files, step)
                apart, off = np.abs(pose - run.pose), np.abs(pose - run["desired_pose"])[run.time >= 1]
                print(f"{version:3}  {1e3 * step:9.1f}  {1e3 * apart.max():16.3f}  {1e3 * off.max():35.3f}")


def coupled(files: dict[str, Path], step: float) -> np.ndarray:
    """Poses (N, 3) at all coupling steps of plant and law, which exchange values at each."""
    for done in building(files, step):
        assert done.value == 0, done
    with open("result.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    pose = np.full((round(DURATION / step) + 1, len(POSE)), np.nan)
    for row in rows:  # OMSimulator writes values before and after each exchange; those after it count.
        pose[round(float(row["time"]) / step)] = [float(row[f"model.root.plant.{name}"]) for name in POSE]
    return pose


def building(files: dict[str, Path], step: float) -> Iterator[object]:
    """Make the model, simulate it and delete it; yield the status that OMSimulator returns for each call."""
    yield Capi.setCommandLineOption("--suppressPath=true")
    yield Capi.setTempDirectory(".")
    yield Capi.newModel("model")
    yield Capi.addSystem("model.root", WEAKLY_COUPLED)
    for part, file in files.items():
        yield Capi.addSubModel(f"model.root.{part}", str(file))
    for taker, giver in (("plant", "law"), ("law", "plant")):
        text = zipfile.ZipFile(files[taker]).read("modelDescription.xml").decode()
        for name in re.findall(r'name="([^"]+)"[^>]*causality="input"', text):
            yield Capi.addConnection(f"model.root.{giver}.{name}", f"model.root.{taker}.{name}")
    yield Capi.setFixedStepSize("model.root", step)
    yield Capi.setResultFile("model", "result.csv", 100)
    yield Capi.setStopTime("model", DURATION)
    yield Capi.instantiate("model")
    yield Capi.initialize("model")
    yield Capi.simulate("model")
    yield Capi.terminate("model")
    yield Capi.delete("model")


if __name__ == "__main__":
    main()
