"""The variables of a unit, and its model description for FMI 2.0 and 3.0 (https://fmi-standard.org)."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from flexlab.control.controller import Controller
from flexlab.control.law import law_of, nothing_derived
from flexlab.quantities import base_exponents, describe, own_numbers
from flexlab.recording.table_columns import signal_columns, table_columns, to_columns
from flexlab.scenario import Scenario
from flexlab.signal import ARM, AXIS, JOINT
from flexlab.sim.samples import rows_to_samples
from flexlab.sim.signals import ACCELERATION_UNITS, POSE_UNITS, RATE_UNITS, known_signals, own_signals

OF_THE_LAW = {"desired_pose", "tracking_error", "sliding_variable", "bound_estimates", "quasi_static_deflection"}
"""Signals that a plant without its law does not have."""


class Variable(NamedTuple):
    """One number that importers see; its value reference is its index in the list."""

    name: str
    unit: str
    description: str
    causality: str
    place: int
    """Its place in an instance's memory, bytes."""
    start: float | None = None
    low: float = -math.inf
    high: float = math.inf
    is_whole: bool = False

    @property
    def is_settable(self) -> bool:
        """Whether importers can set it."""
        return self.causality in ("input", "parameter")


def sample_variables(scenario: Scenario, row: np.ndarray, place: int, with_law: bool) -> list[Variable]:
    """The time, and each signal of the sample row at `place` as an output.

    Signals that the scenario's law lacks are left out: they are NaN in `row`, the first sample.
    """
    columns = table_columns(scenario)
    numbers = to_columns(rows_to_samples(np.arange(len(row))[None], len(scenario.arms), own_signals(scenario)), columns)
    own, table = {signal.name for signal in law_of(scenario.controller).signals}, known_signals()
    found = []
    for column in columns:
        at = int(numbers[column.name][0])
        if np.isnan(row[at]) or (not with_law and column.signal in OF_THE_LAW | own):
            continue
        signal = table[column.signal]
        about = f"{signal.symbol}: {signal.meaning}{f' [{signal.equation}]' if signal.equation else ''}"
        causality = "independent" if column.part == "time" else "output"
        found.append(Variable(column.part, column.unit, about, causality, place + 8 * at))
    return found


def _in_a_row(about: Sequence[tuple[str, str, str]], place: int, causality: str, start: Any = ()) -> list[Variable]:
    """Consecutive variables (name, unit, description) from `place` on; inputs start with the values `start`."""
    begin = np.ravel(start).tolist() if causality == "input" else [None] * len(about)
    return [Variable(*each, causality, place + 8 * k, begin[k]) for k, each in enumerate(about)]


def torques(scenario: Scenario, start: np.ndarray, place: int, causality: str) -> list[Variable]:
    """The motors' torques (arms, 3) at `place`."""
    about = [
        (f"motor_torque_{side}_{joint}", "N·m", f"torque of the {side} arm's motor {joint}, held over a step")
        for side in ARM.labels[: len(scenario.arms)]
        for joint in JOINT.labels
    ]
    return _in_a_row(about, place, causality, start)


def inputs(scenario: Scenario, place: int) -> list[Variable]:
    """A law's inputs u (arms, 3) at `place`, before torque limits and delay."""
    about = [
        (f"input_{side}_{axis}", unit, f"u, {axis}: force or moment that the {side} arm is to apply at its grip")
        for side in ARM.labels[: len(scenario.arms)]
        for axis, unit in zip(AXIS.labels, ("N", "N", "N·m"), strict=True)
    ]
    return _in_a_row(about, place, "output")


def sensors(scenario: Scenario, start: np.ndarray, place: int, causality: str) -> list[Variable]:
    """A law's measurements at `place`: rates of the beam's moments and the gauges' strains; as a law's inputs also the pose."""
    about = [(f"pose_{axis}", "m" if axis != "theta" else "rad", f"measured pose, {axis}") for axis in AXIS.labels]
    about += [(f"pose_rate_{axis}", "m/s" if axis != "theta" else "rad/s", f"its rate, {axis}") for axis in AXIS.labels]
    about = about if causality == "input" else []
    about += [
        ("beam_moment_rate_h", "kg·m/s", "hᵀq̇: rate of the beam's first moment of deflection"),
        ("beam_moment_rate_g", "kg·m²/s", "gᵀq̇: rate of its second"),
    ]
    law = scenario.controller
    about += [(f"strain_{j}", "1", f"strain at s/L = {at:.4g}") for j, at in enumerate(law_of(law).gauges(law))]
    return _in_a_row(about, place, causality, start)


def law_signals(scenario: Scenario, place: int) -> list[Variable]:
    """The law's own signals at `place`, as outputs."""
    about = [
        (column.part, column.unit, f"{signal.symbol}: {signal.meaning}")
        for signal in law_of(scenario.controller).signals
        for column in signal_columns(signal, scenario)
    ]
    return _in_a_row(about, place, "output")


def desired_motion(start: np.ndarray, place: int) -> list[Variable]:
    """The desired motion at `place`, as inputs: x_d, ẋ_d and ẍ_d (3, 3)."""
    moves_on = "x_d, {}: desired pose, extrapolated with its rate and acceleration until the next step"
    parts = (
        ("pose", POSE_UNITS, moves_on),
        ("rate", RATE_UNITS, "ẋ_d, {}: its rate, extrapolated with the acceleration"),
        ("acceleration", ACCELERATION_UNITS, "ẍ_d, {}: its acceleration"),
    )
    about = [
        (f"desired_{name}_{axis}", unit, text.format(axis))
        for name, units, text in parts
        for axis, unit in zip(AXIS.labels, units, strict=True)
    ]
    return _in_a_row(about, place, "input", start)


class Gain(NamedTuple):
    """A gain that can be tuned."""

    name: str
    """Name of its variable, or the beginning of its variables' names."""
    settings: Any
    """The part of the scenario that has the field."""
    field: str
    place: int
    """Its place in the law's record, bytes."""


def parameters(
    scenario: Scenario, places: Mapping[str, int], gains: Sequence[Gain], is_plant: bool = False
) -> list[Variable]:
    """The variables that can be tuned while a unit runs: gravity, the noise's seed and these gains, at their `places`.

    A law has gravity, too, unless it derives constants: gravity may have gone into them.
    """
    found = []
    if is_plant or (gains and law_of(scenario.controller).derive is nothing_derived):
        about = describe(type(scenario), "gravity")
        title, low, high = about.title, about.low, about.high
        found += [Variable("gravity", about.unit, title, "parameter", places["gravity"], scenario.gravity, low, high)]
    noise = scenario.controller.sensor_noise
    if noise.active and not is_plant:
        about = describe(type(noise), "seed")
        span, title = (float(noise.seed), about.low, about.high), "Seed of the sensors' noise"
        found.append(Variable("noise_seed", "1", title, "parameter", places["seed"], *span, is_whole=True))
    for gain in gains:
        part = type(gain.settings)
        about, size = describe(part, gain.field), own_numbers(part, Controller)[gain.field]
        units, values = about.unit.split(", "), np.broadcast_to(getattr(gain.settings, gain.field), size)
        title = about.title if gain.settings is scenario.controller else f"{about.title} of the slow part"
        for k in range(size):
            # Of two units, the first one is for both directions.
            unit = units[k] if len(units) == size else units[0] if k < 2 else units[-1]
            place = places["gains"] + gain.place + 8 * k
            name = gain.name if size == 1 else f"{gain.name}_{k + 1}"
            found.append(Variable(name, unit, title, "parameter", place, float(values[k]), about.low, about.high))
    return found


class Model(NamedTuple):
    """The contents of a model description besides its variables."""

    name: str
    identifier: str
    token: str
    description: str
    tool: str
    tick_period: float
    duration: float


def model_description(version: int, model: Model, variables: Sequence[Variable]) -> bytes:
    """modelDescription.xml for FMI `version` 2 or 3."""
    third = version == 3
    root = _element(
        None, "fmiModelDescription", fmiVersion="3.0" if third else "2.0", modelName=model.name,
        **{"instantiationToken" if third else "guid": model.token}, description=model.description, license="MIT",
        generationTool=model.tool, variableNamingConvention="flat",
    )  # fmt: skip
    state = "FMUState" if third else "FMUstate"
    _element(
        root, "CoSimulation", modelIdentifier=model.identifier, canHandleVariableCommunicationStepSize="true",
        **{f"canGetAndSet{state}": "true", f"canSerialize{state}": "true"},
        **({"fixedInternalStepSize": repr(model.tick_period)} if third else {}),
    )  # fmt: skip
    parent = _element(root, "UnitDefinitions")
    for unit in sorted({variable.unit for variable in variables}):
        element, exponents = _element(parent, "Unit", name=unit), base_exponents(unit)
        if exponents is not None:
            _element(element, "BaseUnit", **{base: str(power) for base, power in exponents.items()})
    categories = _element(root, "LogCategories")
    _element(categories, "Category", name="logStatusError", description="Refused calls, and why a run stopped")
    step = repr(model.tick_period)
    _element(root, "DefaultExperiment", startTime="0", stopTime=repr(model.duration), stepSize=step)
    _add_variables(root, variables, third)
    structure = _element(root, "ModelStructure")
    outputs = [number for number, variable in enumerate(variables) if variable.causality == "output"]
    # An input acts from the next step on: two units that feed each other make no algebraic loop.
    for name, known in (("Output", {"dependencies": ""}), ("InitialUnknown", {})):
        parent = structure if third else _element(structure, f"{name}s")
        for number in outputs:
            place = {"valueReference": str(number)} if third else {"index": str(number + 1)}
            _element(parent, name if third else "Unknown", **place, **known)
    ElementTree.indent(root)
    return ElementTree.tostring(root, "utf-8", xml_declaration=True)


def _element(parent: Any, tag: str, **attributes: str) -> Any:
    return ElementTree.Element(tag, attributes) if parent is None else ElementTree.SubElement(parent, tag, attributes)


def _add_variables(root: Any, variables: Sequence[Variable], third: bool) -> None:
    parent = _element(root, "ModelVariables")
    for number, variable in enumerate(variables):
        values = {"min": variable.low, "max": variable.high, "start": variable.start}
        known = {name: float(value) for name, value in values.items() if value is not None}
        numbers = {name: repr(value) for name, value in known.items() if math.isfinite(value)}
        variability = {"input": "discrete", "parameter": "tunable"}.get(variable.causality, "continuous")
        about = {"name": variable.name, "valueReference": str(number), "description": variable.description}
        about |= {"causality": variable.causality, "variability": variability}
        if initial := {"output": "calculated", "parameter": "exact"}.get(variable.causality):
            about["initial"] = initial
        if third:
            _element(parent, "Float64", **about, unit=variable.unit, **numbers)
        else:
            _element(_element(parent, "ScalarVariable", **about), "Real", unit=variable.unit, **numbers)
