"""Control laws: what one is, which ones there are, and the one seam between them and the engine.

A law is a file in `control/laws` (or any file, see `add_law_file`) that defines `LAW = Law(...)`: its gains as a scenario
model, its kernel, its memory and its fastest rate. Menus, sliders, recordings and step control follow from that.

    kernel(gains, now, memory, memory_rate, signals)     fills now.u (arms, 3), memory_rate and signals
    fastest_rate(gains, now, memory, S, kappa) -> 1/s    how fast the closed loop's fastest part can move, for the step

`gains`: a record of the model's own fields, numbers and 3-vectors, under the fields' names. `now`: a `LAW_INPUT` record.
`memory`, `memory_rate`, `signals`: vectors of the declared sizes, in the declared order. `S` (3, 3): inertia that the pose
feels at this instant, beam momenta held. `kappa` (3,): hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g over the modes that the plant keeps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np

from flexlab.compiled import MATRIX, VECTOR, call_kernel, call_number_kernel, inlined, kernel_address
from flexlab.control.conditions import Circumstances, Condition
from flexlab.control.controller import Controller
from flexlab.control.load_sharing import BelievedPayload
from flexlab.physics.law_input import LAW_INPUT
from flexlab.physics.strain_gauges import gauge_places
from flexlab.quantities import own_numbers
from flexlab.registry import module_from_file, modules_in
from flexlab.signal import Signal


@dataclass(frozen=True)
class Memory:
    """A part of a law's memory. A law that takes over from another goes on with the parts that both have by name."""

    name: str
    size: int | Callable[[int], int] = 3
    """Length, or length as a function of the number of arms."""

    def length(self, arm_count: int) -> int:
        """Numbers in it."""
        return self.size if isinstance(self.size, int) else self.size(arm_count)


class Start(NamedTuple):
    """What a law may know when it begins."""

    now: Any
    """`LAW_INPUT` record of the present instant: motion, arm terms, believed payload, and the inputs in force as u."""
    gains: Any
    """Record of the gains."""
    wait: float = 0.0
    """Time until the law acts first, s: to the next instant of sampled control; until then the inputs now.u are held."""


BOUND_ESTIMATES = Memory("bound_estimates")
"""b̂ of Eq. (23). Laws that learn nothing keep it as it is, so that a law that goes on with it finds it again."""


USUAL_GAUGES = tuple(float(place) for place in gauge_places(1.0)[0])


def no_slope(_: Any) -> np.ndarray:
    """Λ = 0: of laws without a sliding surface."""
    return np.zeros(3)


def no_limits(_: Any) -> dict[str, dict[str, float]]:
    """Of laws without levels to be shown."""
    return {}


def no_conditions(_: Circumstances) -> tuple[Condition, ...]:
    """Of laws whose own conditions cannot be computed."""
    return ()


def nothing_derived(_: Any) -> dict[str, np.ndarray]:
    """Of laws that need no constants besides their gains."""
    return {}


def usual_gauges(_: Any) -> tuple[float, ...]:
    """s/L of the gauges where a law says nothing else: those of `physics.strain_gauges`."""
    return USUAL_GAUGES


@dataclass(frozen=True)
class Law:
    """One control law, complete. `model`'s field `kind` is its name everywhere."""

    model: type[Controller]
    kernel: Callable[..., None]
    fastest_rate: Callable[..., float] | None = None
    memory: tuple[Memory, ...] = (BOUND_ESTIMATES,)
    signals: tuple[Signal, ...] = ()
    """Signals of its own, which the kernel writes."""
    limits: Callable[[Any], dict[str, dict[str, float]]] = no_limits
    """Levels that mean something in plots, from the model's gains: signal → label with unit → value."""
    start: Callable[[Start], dict[str, np.ndarray]] | None = None
    """Memory parts that do not start at zero, at the start of a run or where the law takes over in motion."""
    carry: Callable[[Start, Start, dict[str, np.ndarray]], dict[str, np.ndarray]] | None = None
    """Memory parts that must follow a change in motion of gains or of the believed payload, so that the law's answer does not
    jump by more than the change: from what was before, what is now, and the present memory."""
    sliding_slope: Callable[[Any], np.ndarray] = no_slope
    """Λ (3,), 1/s, of s = ė + Λe in plots, from the model's gains."""
    constants: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Further fields of the gains record and their shapes, which `derive` computes from the scenario."""
    derive: Callable[[Any], dict[str, np.ndarray]] = nothing_derived
    conditions: Callable[[Circumstances], tuple[Condition, ...]] = no_conditions
    """What its stability needs where that can be computed, besides what holds for all laws (`analysis.law_conditions`)."""
    drives: bool = True
    """Whether the motors work at all."""
    for_settings: Callable[[Any], "Law"] | None = None
    """Of a law whose memory or signals depend on its settings: the law that a controller's settings mean."""
    gauges: Callable[[Any], Sequence[float]] = usual_gauges
    """Where the strain gauges are that the sampled law reads, s/L, from the model's settings; `MOST_GAUGES` at most."""
    place: int = 50
    """Rank in menus."""

    @property
    def kind(self) -> str:
        """The name in scenarios."""
        return self.model.model_fields["kind"].default

    @cached_property
    def gains_type(self) -> np.dtype:
        """The record of gains and constants."""
        own = own_numbers(self.model, Controller)
        fields = [(name, "f8", (size,)) if size > 1 else (name, "f8") for name, size in own.items()]
        fields += [(name, "f8", shape) for name, shape in self.constants.items()]
        return np.dtype(fields or [("none", "f8")])

    def chosen(self) -> dict[str, Any]:
        """The changes to a scenario that choose this law, by path."""
        return {"controller.kind": self.kind}

    def problem(self, settings: Any) -> str:
        """What a law that is a person's own did wrong last, as a sentence; empty: nothing."""
        return ""

    def is_ready(self, settings: Any) -> bool:
        """Whether a world can take it on at once."""
        return True

    def gains(self, scenario: Any) -> np.ndarray:
        """The gains of a scenario's law, flat, as the kernels take them."""
        record = np.zeros(1, self.gains_type)
        for name in own_numbers(self.model, Controller):
            record[name] = getattr(scenario.controller, name)
        for name, value in self.derive(scenario).items():
            record[name] = value
        return record.view(np.float64)

    @cached_property
    def addresses(self) -> tuple[int, int]:
        """Of kernel and fastest rate, compiled or loaded from the cache when first asked for."""
        now = numba.from_dtype(LAW_INPUT)
        return (
            kernel_address(self.kernel, self.gains_type, now, VECTOR, VECTOR, VECTOR),
            kernel_address(self.fastest_rate, self.gains_type, now, VECTOR, MATRIX, VECTOR, returns=numba.float64),
        )

    @property
    def is_loaded(self) -> bool:
        """Whether `addresses` need not compile or load."""
        return "addresses" in vars(self)

    def memory_slices(self, arm_count: int) -> dict[str, slice]:
        """Where the parts of the memory lie."""
        slices, at = {}, 0
        for part in self.memory:
            slices[part.name] = slice(at, at + part.length(arm_count))
            at += part.length(arm_count)
        return slices

    def memory_size(self, arm_count: int) -> int:
        """Numbers in the memory."""
        return sum(part.length(arm_count) for part in self.memory)

    @property
    def signal_count(self) -> int:
        """Numbers in the law's own signals."""
        return sum(signal.fixed_size for signal in self.signals)


class Control(NamedTuple):
    """A control law with its gains, and how its inputs and outputs reach the plant."""

    law: int
    """Address of the law's kernel."""
    fastest_rate: int
    """Address of its fastest rate."""
    gains: np.ndarray
    """The law's record of gains, flat."""
    memory_size: int
    signal_count: int
    """Numbers in the law's own signals."""
    estimates: int
    """Where b̂ stands in the memory, negative if nowhere."""
    sliding_slope: np.ndarray
    """Λ of the sliding variable that is shown, 1/s, (3,)."""
    payload: BelievedPayload
    share: np.ndarray
    """What each arm carries of the common part, 1, (2,)."""
    internal_force: float
    """F_d, N: wanted squeeze of the payload between two arms."""
    torque_limit: np.ndarray
    """N·m per joint, infinite where there is none, (3,)."""
    limited: bool
    sampled: bool
    """Zero-order hold: the inputs are computed by `sim.sampled_control` at the control instants only."""


@inlined
def control_law(control, gravity, x, v, beam_rate, desired, now, memory, memory_rate, signals):
    """Fill now.u (arms, 3), memory_rate and signals for the pose x, its rate v and hᵀq̇, gᵀq̇ in beam_rate (2,).

    The wanted internal force joins in what the law gives. `now`: the `LAW_INPUT` record whose arm terms are those of x and v.
    """
    payload = control.payload
    now.gravity, now.m, now.I = gravity, payload.m, payload.I
    for a in range(3):
        now.x[a], now.v[a], now.kappa[a] = x[a], v[a], payload.kappa[a]
        for order in range(3):
            now.desired[order, a] = desired[order, a]
    for a in range(2):
        now.beam_rate[a], now.share[a] = beam_rate[a], control.share[a]
    for a in range(len(memory_rate)):
        memory_rate[a] = 0.0
    call_kernel(control.law, control.gains, (now, memory, memory_rate, signals))
    if control.internal_force != 0:
        for a in range(2):
            squeeze = control.internal_force * now.trig[a]
            now.u[0, a] += squeeze
            now.u[1, a] -= squeeze


@inlined
def fastest_control_rate(control, now, memory, S, kappa):
    """1/s, of the closed loop's part that the law shapes, at the instant of `now` (its x and v), memory (m,), S (3, 3)."""
    return call_number_kernel(control.fastest_rate, control.gains, (now, memory, S, kappa))


_laws: dict[str, Law] = {}
_built_in = False
"""Whether those of flexlab are in it: a person's own may come first."""
_listeners: list[Callable[[], None]] = []


def add_law(law: Law, instead: bool = False) -> None:
    """Make a law known, `instead` of another one of its kind. Raises ImportError for one that lacks what the engine needs."""
    _enter(law, instead)
    _tell()


def _enter(law: Law, instead: bool = False) -> None:
    global _laws
    if law.fastest_rate is None:
        raise ImportError(
            f"The control law {law.kind!r} does not say its fastest rate, which the step control needs: "
            "give Law(..., fastest_rate=a kernel of gains, now, memory, S and kappa)."
        )
    if not instead and law.kind in _laws and _laws[law.kind] != law:
        raise ImportError(f"Two control laws are called {law.kind!r}: give one of them another kind.")
    # A new table each time: other threads may be reading the present one.
    known = {**_laws, law.kind: law}
    _laws = dict(sorted(known.items(), key=lambda item: (item[1].place, item[0])))


def forget_law(kind: str) -> None:
    """Make an added law unknown again."""
    global _laws
    _laws = {name: law for name, law in _laws.items() if name != kind}
    _tell()


def _tell() -> None:
    for listener in _listeners:
        listener()


def add_law_file(path: Path) -> Law:
    """Make the law of a Python file known, which defines LAW. Raises ImportError, and what the file raises."""
    law = getattr(module_from_file(path), "LAW", None)
    if not isinstance(law, Law):
        raise ImportError(f"{path} defines no control law: it needs LAW = Law(...).")
    add_law(law)
    return law


def on_new_law(listener: Callable[[], None]) -> None:
    """Have `listener` called whenever a law was added or forgotten."""
    _listeners.append(listener)


def laws() -> dict[str, Law]:
    """All control laws by kind, as menus show them."""
    return dict(_known_laws())


def _known_laws() -> dict[str, Law]:
    global _built_in
    if not _built_in:
        _built_in = True
        for module in modules_in("flexlab.control.laws"):
            _enter(module.LAW)
        _tell()
    return _laws


def law_of(controller: Controller) -> Law:
    """The law of a scenario's controller, as its settings mean it."""
    law = _known_laws()[controller.kind]  # type: ignore[attr-defined]
    return law if law.for_settings is None else law.for_settings(controller)
