"""The parts of a scenario that can be exported: plant, law, their loop, or the loop without its path.

Plant and law meet at the instants of a sampled controller: the outputs of one are the inputs of the other, under the same
names. A continuous law is exported as one that acts at every tick.
"""

import inspect
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numba
import numpy as np

from flexlab.compiled import MATRIX, kernel_address, pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import Law, law_of, laws, nothing_derived
from flexlab.control.motion import NO_ROWS, DesiredMotion
from flexlab.control.path import paths
from flexlab.errors import StudyError
from flexlab.fmi.description import (
    Gain,
    Variable,
    desired_motion,
    inputs,
    law_signals,
    parameters,
    sample_variables,
    sensors,
    torques,
)
from flexlab.fmi.machine_code import CLOCK, Memory, arrays_of, lay_out, result_at, schemes_of, words_of
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import ETA
from flexlab.physics.sensors import begin_reading
from flexlab.quantities import own_numbers
from flexlab.scenario import Scenario
from flexlab.sim.advance import advance
from flexlab.sim.closed_loop import memory_slice
from flexlab.sim.integrators.beam_flow import TICKS
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.motion import Motion, begin_motion, start_controller
from flexlab.sim.sampled_control import NEVER_ACTS, answer_sensors, control_instant
from flexlab.sim.step_trial import build_assembly
from flexlab.sim.stepping import observe
from flexlab.sim.target import desired_at
from flexlab.sim.termination import DEFLECTION_LIMIT

BLOCK = 16
"""Most ticks per call of `advance`; only the last sample is kept."""


class Called(NamedTuple):
    """A kernel that others call by its address."""

    name: str
    result: Any
    """Numba's compile result."""
    word: str = ""
    """Name of the argument that takes the address."""
    gain: int = -1
    """Index of the law's gain that holds the address, if one does."""


@dataclass(frozen=True)
class Part:
    """A part of a scenario, ready to be written."""

    scenario: Scenario
    tick_period: float
    """Time between two ticks, s."""
    about: str
    source: str
    """The C file that advances it."""
    kernels: dict[str, Any]
    """Kernels that the file calls: numba's compile results by name."""
    called: list[Called]
    memory: Memory
    variables: list[Variable]
    numbers: dict[str, int]
    """Further constants of the C file."""
    first_words: list[int] = field(default_factory=list)
    """Arguments of the kernel for a sampled law's first action, as indices of the words of `advance`."""


def make_part(scenario: Scenario, part: str, tick_period: float) -> Part:
    """Make a part of a scenario in its initial state. Raises `StudyError` or `ScenarioError`."""
    if not isinstance(part, str) or part not in PARTS:
        raise StudyError(f"part = {part!r:.60} is not a part of a scenario: choose {', '.join(PARTS)}.")
    if part != "plant" and hasattr(scenario.controller, "source"):
        raise StudyError(
            f"The control law {scenario.controller.kind} runs in Python, which a unit cannot hold: export --part plant."
        )
    scenario = scenario.anew()
    if part in ("plant", "law") and scenario.grips.active and scenario.grips.measured_at == "arms":
        raise StudyError(
            f'part = "{part}": plant and law meet at the pose of the payload, and grips.measured_at is arms. '
            "Export --part loop, or choose grips.measured_at payload or grips.model rigid."
        )
    if part in ("plant", "law") and scenario.controller.control_period is None:
        scenario = scenario.replace({"controller.control_period": tick_period})
    motion = begin_motion(build_assembly(scenario, tick_period))
    if motion.status.failed:
        raise StudyError(motion.status.text)
    return PARTS[part](motion)


@pluggable
def given_motion(path, rows, t, desired):
    """The importer's last desired motion, extrapolated with its rate and acceleration."""
    since = t - path.time
    for a in range(3):
        desired[0, a] = path.pose[a] + since * (path.rate[a] + 0.5 * since * path.acceleration[a])
        desired[1, a] = path.rate[a] + since * path.acceleration[a]
        desired[2, a] = path.acceleration[a]


GIVEN = np.dtype([("time", "f8"), ("pose", "f8", (3,)), ("rate", "f8", (3,)), ("acceleration", "f8", (3,))])
"""The record that `given_motion` reads."""


def _loop(motion: Motion) -> Part:
    """Plant, law and path."""
    return _world(motion, "Arms, flexible beam, control law and path", _law_and_path(motion, _path(motion)))


def _follower(motion: Motion) -> Part:
    """Plant and law; the desired motion comes from outside, and begins where the scenario's path does."""
    address = kernel_address(given_motion, GIVEN, MATRIX, numba.float64, MATRIX)
    system, desired = motion.assembly.system, desired_at(motion.assembly.system.trajectory, 0.0)
    numbers = np.array([0.0, *desired.ravel()])
    given = DesiredMotion(address, numbers, NO_ROWS, bending=system.trajectory.bending)
    motion.assembly = motion.assembly._replace(system=system._replace(trajectory=given))
    motion.workspace.desired_time[0] = np.nan
    path = Called("flexlab_path", result_at(given_motion, address), "system.trajectory.kernel")
    return _world(motion, "Arms, flexible beam and control law", _law_and_path(motion, path))


def _plant(motion: Motion) -> Part:
    """Arms and beam; motor torques are held until new ones come, and no law acts."""
    called = [_path(motion)]
    system, sampling = motion.assembly.system, motion.assembly.sampling
    control = system.control._replace(law=0, fastest_rate=0, gains=np.zeros_like(system.control.gains))
    sampling = sampling._replace(steps=NEVER_ACTS, kernel=0)
    motion.assembly = motion.assembly._replace(system=system._replace(control=control), sampling=sampling)
    return _world(motion, "Arms and flexible beam", called)


def _world(motion: Motion, about: str, called: list[Called]) -> Part:
    """A part moved by `advance`: a plant if it calls no law, or a loop."""
    assembly, scenario, is_plant = motion.assembly, motion.scenario, len(called) == 1
    is_follower = called[0].result.signature.args[0] == numba.from_dtype(GIVEN)
    system, sampling, row = assembly.system, assembly.sampling, np.zeros(motion.row_length)
    observe(motion, row)
    good, rows = np.zeros_like(motion.y), np.zeros((BLOCK, motion.row_length))
    limit = DEFLECTION_LIMIT * scenario.payload.length
    values = (
        system, sampling, *assembly.levels.scheme(0), assembly.watch, 0, limit, 0.0, 0, motion.tick_period,
        assembly.step_count, motion.y, good, motion.workspace, rows, False,
    )  # fmt: skip
    arguments = _named(advance, values)
    felt = law_sensors(motion)[6:]
    state = {"row": row, "sensors": felt, **_of_control(motion)}
    if not is_plant and system.control.sampled:
        before_acting(motion)
    scratch = {"good": good, "rows": rows, **arrays_of(motion.workspace)}
    memory = lay_out(arguments, state, scratch, *schemes_of(assembly))
    variables = sample_variables(scenario, row, memory.places["row"], not is_plant)
    if is_plant:
        variables += sensors(scenario, felt, memory.places["sensors"], "output")
        variables += torques(scenario, system.held_torque, memory.places["torques"], "input")
    if is_follower:
        variables = [each for each in variables if not each.name.startswith("desired_")]
        variables += desired_motion(desired_at(system.trajectory, 0.0), memory.places["desired"] + 8)
    # Without the sliding slope: the sliding variable, alone among the outputs, would keep the earlier one.
    variables += parameters(scenario, memory.places, [] if is_plant else _gains(scenario, {"sliding_slope"}), is_plant)
    words = {
        "SAMPLING_STEPS": "sampling.steps", "MOST": "watch.most", "LEVEL": "level", "ORIGIN": "origin", "TICK": "tick",
        "PERIOD": "tick_period", "STEP_COUNT": "step_count", "PRESENT": "first_is_present", "ROWS_SIZE": "rows.size",
        "ROWS_SHAPE": "rows.shape0",
    }  # fmt: skip
    n = len(assembly.beam.modes.omega)
    numbers = {f"WORD_{name}": memory.word(word) for name, word in words.items()} | {
        "WORD_SCHEME": next(k for k, name in enumerate(memory.names) if name.split(".")[0] in Scheme._fields),
        "SCHEME_WORDS": len(memory.schemes[0]),
        "PIECE_COUNT": len(memory.pieces),
        "ROW_LENGTH": motion.row_length,
        "BLOCK": BLOCK,
        "MODES": n,
        "STATE_LENGTH": len(motion.y),
        "FIRST_MODE": ETA,
        "SINCE": ETA + 2 * n + TICKS,
        "COUNTS_TICKS": int(assembly.levels.integrator == "etdrk4"),
        "GAUGES": len(sampling.strain),
        "AT_STRAIN": memory.words[memory.word("sampling.strain.data")],
        "AT_ROW": memory.places["row"],
        "AT_ROWS": memory.places["rows"],
        "AT_SENSORS": memory.places["sensors"],
        "AT_BEAM_RATE": memory.places["ws.beam_rate.data"],
        "AT_GIVEN": memory.places["desired"] if is_follower else 0,
    }
    kernels, first_words = {"flexlab_advance": _compiled(advance, arguments)}, []
    if not is_plant and system.control.sampled:
        first = _named(control_instant, (system, sampling, 0, 0.0, motion.y, motion.workspace))
        kernels["flexlab_first"] = _compiled(control_instant, first)
        at_start = {"instant": "tick", "t": "origin"}
        labels = [name for key, value in first.items() for name, _ in words_of(value, key)]
        first_words = [memory.word(at_start.get(name, name)) for name in labels]
    tick = motion.tick_period
    return Part(scenario, tick, about, "world.c", kernels, called, memory, variables, numbers, first_words)


def _named(kernel: Any, values: tuple[Any, ...]) -> dict[str, Any]:
    return dict(zip(inspect.signature(kernel.py_func).parameters, values, strict=True))


def _law(motion: Motion) -> Part:
    """Law and path; the law acts at the start and at each of its instants."""
    called, felt = _law_and_path(motion, _path(motion), with_rate=False), law_sensors(motion)
    assembly, scenario, y = motion.assembly, motion.scenario, motion.y
    control = assembly.system.control._replace(fastest_rate=0)
    system, sampling = assembly.system._replace(control=control), assembly.sampling._replace(kernel=0)
    before_acting(motion)
    values = (system, sampling, 0, 0.0, felt, y, motion.workspace)
    arguments = _named(answer_sensors, values)
    now = motion.workspace.measured
    state = {"sensors": felt, "measured": now, **_of_control(motion)}
    memory = lay_out(arguments, state, arrays_of(motion.workspace))
    period = scenario.controller.control_period
    variables = [Variable("time", "s", "t: instant of the unit", "independent", CLOCK)]
    variables += torques(scenario, system.held_torque, memory.places["torques"], "output")
    variables += inputs(scenario, memory.places["measured"] + (now.dtype.fields or {})["u"][1])
    variables += law_signals(scenario, memory.places["y"] + 8 * memory_slice(system).stop)
    variables += sensors(scenario, felt, memory.places["sensors"], "input")
    variables += parameters(scenario, memory.places, _gains(scenario))
    numbers = {"WORD_NUMBER": memory.word("instant"), "WORD_TIME": memory.word("t")}
    kernels = {"flexlab_answer": _compiled(answer_sensors, arguments)}
    return Part(scenario, period, "Control law and path", "law.c", kernels, called, memory, variables, numbers)


PARTS = {"plant": _plant, "law": _law, "loop": _loop, "follower": _follower}


def before_acting(motion: Motion) -> None:
    """Undo a sampled law's action in `begin_motion`: a unit's law acts when the unit begins, with its parameters at that time."""
    system, sampling, y = motion.assembly.system, motion.assembly.sampling, motion.y
    system.held_torque[:] = sampling.line[:] = 0.0
    y[memory_slice(system).start :] = 0.0
    find_mass_at(system.plant, motion.time, motion.workspace)
    begin_reading(system.plant, sampling.period, y, motion.workspace)
    start_controller(motion.scenario, system, motion.law_start(True), y)


def _gains(scenario: Scenario, besides: Collection[str] = ()) -> list[Gain]:
    """Gains that a law and its slow part use as they are: nothing, not even the initial memory, was derived from them."""
    settings: Any = scenario.controller
    law, slow = law_of(settings), getattr(settings, "slow", None)
    found = [Gain(name, settings, name, place) for name, place in _untouched(law)]
    if slow is not None:
        begin = (law.gains_type.fields or {})["slow_gains"][1]
        found += [Gain(f"slow_{name}", slow, name, begin + place) for name, place in _untouched(laws()[slow.kind])]
    return [gain for gain in found if gain.field not in besides]


def _untouched(law: Law) -> list[tuple[str, int]]:
    """(name, place in the record, bytes) of the gains from which a law derives nothing."""
    plain = law.derive is nothing_derived and law.start is None
    names = own_numbers(law.model, Controller) if plain else law.untouched
    return [(name, (law.gains_type.fields or {})[name][1]) for name in names]


def _of_control(motion: Motion) -> dict[str, np.ndarray]:
    """State besides the sample, importers' settings, and a law's gains, which may hold addresses."""
    system = motion.assembly.system
    return {
        "gravity": np.array([motion.scenario.gravity]),
        "seed": np.array([float(motion.assembly.sampling.seed)]),
        "desired": system.trajectory.numbers,
        "y": motion.y,
        "torques": system.held_torque,
        "line": motion.assembly.sampling.line,
        "gains": system.control.gains,
    }


def law_sensors(motion: Motion) -> np.ndarray:
    """A law's measurement at this instant, as `answer_sensors` takes it, without noise."""
    y, ws, n = motion.y, motion.workspace, len(motion.assembly.beam.modes.omega)
    observe(motion, np.zeros(motion.row_length))
    strains = [
        sum((a * b for a, b in zip(gauge, y[ETA : ETA + n], strict=True)), 0.0)
        for gauge in motion.assembly.sampling.strain
    ]
    return np.array([*y[:3], *ws.velocity, *ws.beam_rate, *strains])


def _path(motion: Motion) -> Called:
    kernel, address = paths()[motion.scenario.trajectory.kind].kernel, motion.assembly.system.trajectory.kernel
    return Called("flexlab_path", result_at(kernel, address), "system.trajectory.kernel")


def _law_and_path(motion: Motion, path: Called, with_rate: bool = True) -> list[Called]:
    """All kernels that are called by address: path, law and the laws that it calls; with `with_rate` also the engine's."""
    control, law = motion.assembly.system.control, law_of(motion.scenario.controller)
    found = [path, Called("flexlab_law", result_at(law.kernel, control.law), "system.control.law")]
    if with_rate:
        rate = result_at(law.fastest_rate, control.fastest_rate)
        found.append(Called("flexlab_rate", rate, "system.control.fastest_rate"))
    if with_rate and control.sampled:
        instant = result_at(control_instant, motion.assembly.sampling.kernel)
        found.append(Called("flexlab_instant", instant, "sampling.kernel"))
    # A law that calls another one holds the other's addresses among its gains.
    for other in laws().values():
        addresses = other.addresses if other.is_loaded else ()
        for kernel, address in zip((other.kernel, other.fastest_rate), addresses, strict=False):
            for gain in np.flatnonzero(control.gains == float(address)):
                found.append(Called(f"flexlab_called_{len(found)}", result_at(kernel, address), gain=int(gain)))
    return found


def _compiled(kernel: Any, arguments: Mapping[str, Any]) -> Any:
    """Numba's compile result of a kernel for these arguments."""
    types = tuple(numba.typeof(value) for value in arguments.values())
    if types not in kernel.overloads:
        kernel.compile(types)
    return kernel.overloads[types]
