"""Control laws in Python as the engine sees them: a model of their gains, and one kernel that asks for the inputs.

The text runs only if it was allowed (`hosts.allow`), in this process or in one of its own.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numba
import numpy as np
from numba.extending import intrinsic
from pydantic import field_validator

from flexlab.compiled import PLAIN_PYTHON, call_whole_kernel, pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import LAWS, Law, Memory, Start, usual_gauges
from flexlab.control.observers.believed_plant import believed_plant
from flexlab.control.observers.observer import padded
from flexlab.numerics.linear_algebra import product
from flexlab.own import hosts
from flexlab.own.declaration import LONGEST_PERIOD, SHORTEST_PERIOD, Declaration, read_declaration, signal_name
from flexlab.own.execution import ANSWER_BYTES, ANSWERED, ASKED, FAILED, INTERRUPTED, MESSAGE, Channel
from flexlab.own.kinds import MODELS_KEPT, OWN_PLACE, OwnKinds, default_source, flat_numbers, source_field
from flexlab.own.measurement import BELIEVED, MOST_MODES, PLACES
from flexlab.physics.beam import shape_row
from flexlab.physics.law_input import LAW_INPUT, MOST_ARMS
from flexlab.quantities import Number, quantity
from flexlab.signal import Signal

CHANNEL = np.dtype([*((name, "i8") for name in Channel._fields), *MESSAGE.descr])
"""How the kernel reaches a law, and the message itself. `answer`: address of an `AnswerFunction`, 0 for a law in a process of its
own. `late`: address of a function of the message, called when the answer is late; it returns `ANSWERED` if one may still come.
`calls`: socket to the process. `next_turn`, `done`: ends of a pipe with one byte, which a caller takes and puts back."""
MESSAGE_AT = 8 * len(Channel._fields)


class OwnController(Controller):
    """Settings of a control law in Python."""

    source: str = source_field("", "law")

    def __reduce__(self) -> Any:
        """Another process makes the class anew from the text."""
        return _restored, (self.model_dump(),)

    @field_validator("control_period", mode="before")
    @classmethod
    def _own_period(cls, value: Any) -> Any:
        """A law in Python always runs sampled: null means the period of its file."""
        return cls.model_fields["control_period"].default if value is None else value


def _restored(data: dict[str, Any]) -> OwnController:
    return OWN_LAWS.restored(data)


@dataclass(frozen=True, kw_only=True)
class PythonLaw(Law):
    """A law in Python, compared by its declaration: another text with the same declaration is the same law."""

    declaration: Declaration

    @cached_property
    def gains_type(self) -> np.dtype:
        """One type for all laws in Python, so that the kernel is compiled once."""
        return CHANNEL

    def gains(self, scenario: Any) -> np.ndarray:
        """The channel to the law, with the gains in its message. Raises `ScenarioError` if the text may not or cannot run."""
        settings = scenario.controller
        host = hosts.host_of(settings.source, settings.kind)
        record = np.zeros(1, CHANNEL)
        for name, value in host.channel._asdict().items():
            record[name] = value
        record["period"], record["plant"] = settings.control_period, self.derive(scenario)["plant"]
        flat = flat_numbers(settings, self.declaration.settings)
        record["gains"][0, : len(flat)] = flat
        return record.view(np.float64)

    def chosen(self) -> dict[str, Any]:
        """The changes to a scenario that choose this law, with its text for recordings."""
        return {**super().chosen(), "controller.source": default_source(self)}

    def problem(self, settings: Any) -> str:
        """The last problem of its text, as a sentence; empty if there was none."""
        law = hosts.known_law(settings.source)
        return "" if law is None else law.cause

    def warning(self, settings: Any) -> str:
        """Why runs of its text cannot be repeated, as a sentence; empty as far as is known."""
        law = hosts.known_law(settings.source)
        return "" if law is None else law.warning

    def is_ready(self, settings: Any) -> bool:
        """Whether it answers at once, if only with the sentence that it may not run."""
        law = hosts.known_law(settings.source)
        return (law is not None and law.is_ready) or not hosts.is_allowed(settings.source)

    def begin(self, start: Start) -> dict[str, np.ndarray]:
        """The memory at the start of a run, for which the law is made ready: it may have failed in the run before."""
        hosts.make_ready(start.gains)
        return {name: np.full(part.size, float(part.start)) for name, part in self.declaration.memory}


def _told(scenario: Any) -> dict[str, np.ndarray]:
    """The `BELIEVED` record of a scenario, flat."""
    payload, law = scenario.payload, scenario.controller
    noise, mesh = law.sensor_noise, (payload.element_count, payload.boundary)
    count, length = min(MOST_MODES, payload.coordinate_count), payload.length * law.model.length_factor
    gauges = usual_gauges(law)
    plant = believed_plant(scenario, count, gauges)
    shapes = product(np.stack([shape_row(s, length, *mesh) for s in length * np.linspace(-0.5, 0.5, PLACES)]), plant.V)
    parts = {
        "counts": (count, len(gauges)),
        "wanted_force": law.wanted_internal_force if len(scenario.arms) == MOST_ARMS else 0.0,
        "rigid_mass": plant.mass[:3, :3],
        "coupling": plant.mass[:3, 3:],
        "omega": plant.omega,
        "stiffness": plant.stiffness,
        "damping": plant.damping[3:, 3:],
        "loads": np.stack([plant.h, plant.g]),
        "shapes": shapes,
        "strain": plant.strain,
        "gauge_places": length * np.array(gauges),
        "pose_noise": noise.pose,
        "rate_noise": noise.pose_rate,
        "strain_noise": noise.strain,
        "moment_rate_noise": noise.moment_rate,
        "length": length,
    }
    block = np.zeros(1, BELIEVED)
    for name, value in parts.items():
        block[name] = padded(np.asarray(value, float), BELIEVED[name].shape)
    return {"plant": block.view(float)}


@intrinsic
def _address(typing, record):
    """The address of a record."""

    def code(context, builder, signature, values):
        return builder.ptrtoint(values[0], context.get_value_type(numba.int64))

    return numba.int64(record), code


_write = numba.types.ExternalFunction("write", numba.intp(numba.int32, numba.intp, numba.intp))
_read = numba.types.ExternalFunction("read", numba.intp(numba.int32, numba.intp, numba.intp))
MESSAGE_BYTES, INPUT_BYTES = MESSAGE.itemsize, LAW_INPUT.itemsize


def _ask(gains, now):
    """Make one call, of a C function or through another process's socket, without Python's global lock; return its outcome."""
    at, now_at = _address(gains) + MESSAGE_AT, _address(now)
    if gains.answer != 0:
        gains.outcome = ASKED
        call_whole_kernel(gains.answer, (at, now_at))
        if gains.outcome == ASKED:
            gains.outcome = INTERRUPTED
            call_whole_kernel(gains.answer, (at, now_at))
        return gains.outcome
    if _read(np.int32(gains.next_turn), at, 1) != 1:
        return FAILED
    calls = np.int32(gains.calls)
    good = _write(calls, at, MESSAGE_BYTES) == MESSAGE_BYTES and _write(calls, now_at, INPUT_BYTES) == INPUT_BYTES
    if not good:
        call_whole_kernel(gains.late, (at,))
    got = 0
    while good and got < ANSWER_BYTES:
        count = _read(calls, at + got, ANSWER_BYTES - got)
        got += max(count, 0)
        if count <= 0:
            # The time limit has passed or the process has ended: `late` decides whether to wait.
            good = call_whole_kernel(gains.late, (at,)) == ANSWERED
    outcome = gains.outcome if good else FAILED
    _write(np.int32(gains.done), at, 1)
    return outcome


_ask_compiled = numba.njit(nogil=True, error_model="numpy", _nrt=False)(_ask)
ask: Any = hosts.ask_plainly if PLAIN_PYTHON else _ask_compiled


@pluggable
def own_law(gains, now, memory, memory_rate, signals):
    """Fill u_i with the answer of the law's `act`, NaN if it fails. The memory changes at once, as the law only runs sampled."""
    for k in range(len(memory)):
        gains.memory[k] = memory[k]
    good = ask(gains, now) == ANSWERED
    for i in range(now.arm_count):
        for a in range(3):
            now.u[i, a] = gains.inputs[i, a] if good else np.nan
    if good:
        for k in range(len(memory)):
            memory[k] = gains.memory[k]
        for k in range(len(signals)):
            signals[k] = gains.signals[k]


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """0: a sampled law does not change between two control instants."""
    return 0.0


@lru_cache(maxsize=MODELS_KEPT)
def own_law_of(source: str, file: str, kind: str = "") -> PythonLaw:
    """The law that a text declares, under another name if one is given. Raises `ScenarioError` with file and line."""
    declared = read_declaration(source, file)
    period = quantity(declared.period, "Control period", "T_c", "s", low=SHORTEST_PERIOD, high=LONGEST_PERIOD)
    model = OWN_LAWS.model(declared, source, file, kind or declared.kind, control_period=(Number | None, period))
    signals = [
        Signal(signal_name(name), one.symbol or name, (one.unit,), one.title or name.replace("_", " "))
        for name, one in declared.signals
    ]
    parts = tuple(Memory(part, about.size) for part, about in declared.memory)
    law = PythonLaw(
        model, own_law, fastest_rate, parts, tuple(signals), derive=_told, place=OWN_PLACE, declaration=declared
    )
    return replace(law, start=law.begin)


OWN_LAWS = OwnKinds(LAWS, PythonLaw, OwnController, "controller", "law", "controller", "gain", own_law_of)
add_own_law, with_known_law = OWN_LAWS.add, OWN_LAWS.named
