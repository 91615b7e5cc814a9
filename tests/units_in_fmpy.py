"""Functional mock-up units in FMPy, an independent importer."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from flexlab.scenario import Scenario
from flexlab.sim.simulate import simulate


def fresh(file: Path, folder: Path) -> Any:
    """Return an instance of a unit that is not yet initialized."""
    about = fmpy.read_model_description(str(file))
    kind = FMU3Slave if about.fmiVersion == "3.0" else FMU2Slave
    unit: Any = kind(
        guid=about.guid,
        unzipDirectory=fmpy.extract(str(file), str(folder)),
        modelIdentifier=about.coSimulation.modelIdentifier,
        instanceName="one",
    )
    unit.numbers = {variable.name: variable.valueReference for variable in about.modelVariables}
    unit.instantiate()
    return unit


def enter(unit: Any) -> None:
    """Enter initialization mode."""
    if isinstance(unit, FMU2Slave):
        unit.setupExperiment()
    unit.enterInitializationMode()


@contextmanager
def instance(file: Path, folder: Path) -> Iterator[Any]:
    """An initialized instance of a unit, at t = 0."""
    unit = fresh(file, folder)
    enter(unit)
    unit.exitInitializationMode()
    yield unit
    unit.terminate()
    unit.freeInstance()


def get(unit: Any, names: Sequence[str]) -> np.ndarray:
    """Read variables of a unit of either version."""
    read = unit.getFloat64 if isinstance(unit, FMU3Slave) else unit.getReal
    return np.array(read([unit.numbers[name] for name in names]))


def put(unit: Any, names: Sequence[str], values: Any) -> None:
    """Set variables of a unit of either version."""
    write = unit.setFloat64 if isinstance(unit, FMU3Slave) else unit.setReal
    write([unit.numbers[name] for name in names], list(values))


def inputs_of(file: Path) -> set[str]:
    """Return the names of a unit's inputs."""
    return {each.name for each in fmpy.read_model_description(str(file)).modelVariables if each.causality == "input"}


def apart(scenario: Scenario, files: tuple[Path, Path], step: float, duration: float, folder: Path) -> float:
    """Return the largest deviation of the pose from `simulate`, m or rad, if plant and law exchange values after each step."""
    run, names, worst = simulate(scenario, duration, step), [sorted(inputs_of(file)) for file in files], 0.0
    with instance(files[0], folder / "plant") as plant, instance(files[1], folder / "law") as law:
        for number in range(1, len(run)):
            for unit in (plant, law):
                unit.doStep((number - 1) * step, step)
            torques, felt = get(law, names[0]), get(plant, names[1])
            put(plant, names[0], torques)
            put(law, names[1], felt)
            pose = get(plant, ["pose_x", "pose_y", "pose_theta"])
            worst = max(worst, float(np.abs(pose - run.pose[number]).max()))
    return worst
