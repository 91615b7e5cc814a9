"""What can be exported of a scenario: the plant, the law, or the loop that they make; of each its kernel, memory, variables.

Plant and law meet at the instants of a sampled controller: what one has as outputs, the other has as inputs, under the same
names. A law that acts continuously is exported as one that acts at every tick.
"""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba
import numpy as np

from flexlab.control.controller import Controller
from flexlab.control.law import law_of, laws, nothing_derived
from flexlab.control.path import paths
from flexlab.errors import StudyError
from flexlab.fmi.description import Variable, inputs, law_signals, parameters, sample_variables, sensors, torques
from flexlab.fmi.machine_code import result_at
from flexlab.fmi.memory import CLOCK, Memory, arrays_of, lay_out, schemes_of
from flexlab.physics.encoders import begin_reading
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import ETA
from flexlab.quantities import own_numbers
from flexlab.scenario import Scenario
from flexlab.sim.advance import advance
from flexlab.sim.closed_loop import memory_slice
from flexlab.sim.integrators.beam_flow import TICKS
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.law_memory import start_memory
from flexlab.sim.motion import Motion, begin_motion, outlook_of
from flexlab.sim.sampled_control import answer_sensors, control_instant
from flexlab.sim.stepping import observe
from flexlab.sim.termination import DEFLECTION_LIMIT

NEVER = 1 << 40
"""Steps between two control instants of a plant whose torques come from outside."""
BLOCK = 16
"""Most ticks that one call of `advance` goes: of their samples only the last is kept."""


class Called(NamedTuple):
    """A kernel that others call by its address."""

    name: str
    result: Any
    """What numba has compiled of it."""
    word: str = ""
    """Name of the argument that takes the address."""
    gain: int = -1
    """Which of the law's gains it is, where it is one."""


@dataclass(frozen=True)
class Part:
    """A part of a scenario, ready to be written."""

    scenario: Scenario
    tick_period: float
    """s."""
    about: str
    source: str
    """The file in C that moves it."""
    kernel: tuple[str, Any]
    """What that file calls: name, and what numba has compiled of it."""
    called: list[Called]
    memory: Memory
    variables: list[Variable]
    numbers: dict[str, int]
    """What that file knows of it besides."""


def make_part(scenario: Scenario, part: str, tick_period: float) -> Part:
    """A part of a scenario as it begins. Raises `StudyError` or `ScenarioError`."""
    if part not in PARTS:
        raise StudyError(f"part = {part!r} is no part of a scenario: choose {', '.join(PARTS)}.")
    if part != "plant" and hasattr(scenario.controller, "source"):
        raise StudyError(
            f"The control law {scenario.controller.kind} runs in Python, which a unit does without: export --part plant."
        )
    scenario = scenario.anew()
    if part != "loop" and scenario.controller.control_period is None:
        scenario = scenario.replace({"controller.control_period": tick_period})
    motion = begin_motion(scenario, tick_period, (), False)
    if motion.status.failed:
        raise StudyError(motion.status.text)
    return PARTS[part](motion)


def _loop(motion: Motion) -> Part:
    """Plant, law and path."""
    return _world(motion, "Arms, flexible beam, control law and path", _law_and_path(motion, with_rate=True))


def _plant(motion: Motion) -> Part:
    """Arms and beam; the torques of its motors are held until others come: no law acts."""
    called = _path(motion)
    system, sampling = motion.assembly.system, motion.assembly.sampling
    control = system.control._replace(law=0, fastest_rate=0, gains=np.zeros_like(system.control.gains))
    sampling = sampling._replace(steps=NEVER, kernel=0)
    motion.assembly = motion.assembly._replace(system=system._replace(control=control), sampling=sampling)
    return _world(motion, "Arms and flexible beam", called)


def _world(motion: Motion, about: str, called: list[Called]) -> Part:
    """What `advance` moves: a plant, if it calls no law, or a loop."""
    assembly, scenario, is_plant = motion.assembly, motion.scenario, len(called) == 1
    system, sampling, row = assembly.system, assembly.sampling, np.zeros(motion.row_length)
    observe(motion, row)
    good, rows = np.zeros_like(motion.y), np.zeros((BLOCK, motion.row_length))
    limit = DEFLECTION_LIMIT * scenario.payload.length
    values = (
        system, sampling, *assembly.levels.scheme(0), assembly.watch, 0, limit, 0.0, 0, motion.tick_period,
        assembly.step_count, motion.y, good, motion.workspace, rows, False,
    )  # fmt: skip
    arguments = _named(advance, values)
    felt = _sensors(motion)[6:]
    state = {"row": row, "sensors": felt, "gravity": np.array([scenario.gravity]), **_of_control(motion)}
    scratch = {"good": good, "rows": rows, **arrays_of(motion.workspace)}
    memory = lay_out(arguments, state, scratch, *schemes_of(assembly, motion.tick_period))
    variables = sample_variables(scenario, row, memory.places["row"], not is_plant)
    if is_plant:
        variables += sensors(scenario, felt, memory.places["sensors"], "output")
        variables += torques(scenario, system.held_torque, memory.places["torques"], "input")
    if is_plant or (_follows_gains(scenario) and not system.control.sampled):
        # Of what is shown, only the sliding variable would go on with the earlier slope.
        gains = [] if is_plant else [name for name in _gains(scenario) if name != "sliding_slope"]
        variables += parameters(scenario, memory.places["gravity"], memory.places["gains"], gains)
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
        "GAUGES": len(sampling.strain),
        "AT_STRAIN": memory.words[memory.word("sampling.strain.data")],
        "AT_ROW": memory.places["row"],
        "AT_ROWS": memory.places["rows"],
        "AT_SENSORS": memory.places["sensors"],
        "AT_BEAM_RATE": memory.places["ws.beam_rate.data"],
    }
    kernel = "flexlab_advance", _compiled(advance, arguments)
    return Part(scenario, motion.tick_period, about, "world.c", kernel, called, memory, variables, numbers)


def _named(kernel: Any, values: tuple[Any, ...]) -> dict[str, Any]:
    """A kernel's arguments by their names."""
    return dict(zip(inspect.signature(kernel.py_func).parameters, values, strict=True))


def _law(motion: Motion) -> Part:
    """Law and path: it acts once as it begins, and at each of its instants."""
    called, felt = _law_and_path(motion, with_rate=False), _sensors(motion)
    assembly, scenario, y = motion.assembly, motion.scenario, motion.y
    control = assembly.system.control._replace(fastest_rate=0)
    system, sampling = assembly.system._replace(control=control), assembly.sampling._replace(kernel=0)
    # As it was before it acted for the first time, in `begin_motion`.
    system.held_torque[:] = sampling.line[:] = 0.0
    memory_end = memory_slice(system).stop
    y[memory_slice(system).start :] = 0.0
    find_mass_at(system.plant, motion.time, motion.workspace)
    begin_reading(system.plant, sampling.period, y, motion.workspace)
    start_memory(scenario, system, outlook_of(motion, True), y)
    values = (system, sampling, 0, 0.0, felt, y, motion.workspace)
    arguments = _named(answer_sensors, values)
    now = motion.workspace.measured
    state = {"sensors": felt, "gravity": np.array([scenario.gravity]), "measured": now, **_of_control(motion)}
    memory = lay_out(arguments, state, arrays_of(motion.workspace))
    period = scenario.controller.control_period
    variables = [Variable("time", "s", "t: instant of the unit", "independent", CLOCK)]
    variables += torques(scenario, system.held_torque, memory.places["torques"], "output")
    variables += inputs(scenario, memory.places["measured"] + (now.dtype.fields or {})["u"][1])
    variables += law_signals(scenario, memory.places["y"] + 8 * memory_end)
    variables += sensors(scenario, felt, memory.places["sensors"], "input")
    if _follows_gains(scenario):
        variables += parameters(scenario, memory.places["gravity"], memory.places["gains"], _gains(scenario))
    numbers = {"WORD_NUMBER": memory.word("instant"), "WORD_TIME": memory.word("t")}
    kernel = "flexlab_answer", _compiled(answer_sensors, arguments)
    return Part(scenario, period, "Control law and path", "law.c", kernel, called, memory, variables, numbers)


PARTS = {"plant": _plant, "law": _law, "loop": _loop}


def _gains(scenario: Scenario) -> list[str]:
    return list(own_numbers(type(scenario.controller), Controller))


def _follows_gains(scenario: Scenario) -> bool:
    """Whether a law takes its gains and gravity as they are: nothing else, its memory included, was made of them before."""
    law = law_of(scenario.controller)
    return law.derive is nothing_derived and law.start is None


def _of_control(motion: Motion) -> dict[str, np.ndarray]:
    """What changes with time besides a sample, and a law's gains, which may hold addresses."""
    system = motion.assembly.system
    return {
        "y": motion.y,
        "torques": system.held_torque,
        "line": motion.assembly.sampling.line,
        "gains": system.control.gains,
    }


def _sensors(motion: Motion) -> np.ndarray:
    """What a law measures at the present instant, as `answer_sensors` takes it, without noise."""
    y, ws, n = motion.y, motion.workspace, len(motion.assembly.beam.modes.omega)
    observe(motion, np.zeros(motion.row_length))
    strains = [
        sum((a * b for a, b in zip(gauge, y[ETA : ETA + n], strict=True)), 0.0)
        for gauge in motion.assembly.sampling.strain
    ]
    return np.array([*y[:3], *ws.velocity, *ws.beam_rate, *strains])


def _path(motion: Motion) -> list[Called]:
    kernel, address = paths()[motion.scenario.trajectory.kind].kernel, motion.assembly.system.trajectory.kernel
    return [Called("flexlab_path", result_at(kernel, address), "system.trajectory.kernel")]


def _law_and_path(motion: Motion, with_rate: bool) -> list[Called]:
    """All kernels that the engine or the law calls by their addresses; `with_rate`: the engine, too."""
    control, law = motion.assembly.system.control, law_of(motion.scenario.controller)
    found = [*_path(motion), Called("flexlab_law", result_at(law.kernel, control.law), "system.control.law")]
    if with_rate:
        rate = result_at(law.fastest_rate, control.fastest_rate)
        found.append(Called("flexlab_rate", rate, "system.control.fastest_rate"))
    if with_rate and control.sampled:
        instant = result_at(control_instant, motion.assembly.sampling.kernel)
        found.append(Called("flexlab_instant", instant, "sampling.kernel"))
    # A law that calls another one has its addresses among its gains.
    for other in laws().values():
        for kernel, address in zip(
            (other.kernel, other.fastest_rate), other.addresses if other.is_loaded else (), strict=False
        ):
            for gain in np.flatnonzero(control.gains == float(address)):
                found.append(Called(f"flexlab_called_{len(found)}", result_at(kernel, address), gain=int(gain)))
    return found


def _compiled(kernel: Any, arguments: Mapping[str, Any]) -> Any:
    """What numba has compiled of a kernel for these arguments' types."""
    types = tuple(numba.typeof(value) for value in arguments.values())
    if types not in kernel.overloads:
        kernel.compile(types)
    return kernel.overloads[types]
