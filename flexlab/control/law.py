"""Control laws: their definition and registry. `control.law_kernels` is how the engine calls them.

A law is a file in `control/laws` (or any file, see `add_law_file`) that defines `LAW = Law(...)`: its gains as a scenario
model, its kernel, its memory and its fastest rate. Menus, sliders, recordings and step control follow from that.

    kernel(gains, now, memory, memory_rate, signals)     fills now.u (arms, 3), memory_rate and signals
    fastest_rate(gains, now, memory, S, kappa) -> 1/s    how fast the closed loop's fastest part can move, for the step

`gains`: a record of the model's own fields, numbers and 3-vectors, under the fields' names. `now`: a `LAW_INPUT` record.
`memory`, `memory_rate`, `signals`: vectors of the declared sizes, in the declared order. `S` (3, 3): inertia that the pose
feels at this instant with the beam's momenta held. `kappa` (3,): hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g over the modes kept.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numba
import numpy as np

from flexlab.compiled import MATRIX, VECTOR, kernel_address
from flexlab.control.conditions import Circumstances, Condition
from flexlab.control.controller import Controller
from flexlab.physics.law_input import LAW_INPUT
from flexlab.physics.sensors import gauge_places
from flexlab.quantities import own_numbers
from flexlab.registry import Registry
from flexlab.signal import Signal


@dataclass(frozen=True)
class Memory:
    """A part of a law's memory, the controller's state. A law that takes over keeps the parts that both laws have by name."""

    name: str
    size: int | Callable[[int], int] = 3
    """Length, or length as a function of the number of arms."""

    def length(self, arm_count: int) -> int:
        """Number of values in it."""
        return self.size if isinstance(self.size, int) else self.size(arm_count)


class Start(NamedTuple):
    """What a law knows when it begins."""

    now: Any
    """`LAW_INPUT` record of the present instant: motion, arm terms, believed payload, and in u the inputs in force."""
    gains: Any
    """Record of the gains."""
    wait: float = 0.0
    """Time until the law acts first, s: to the next instant of sampled control; until then the inputs now.u are held."""


BOUND_ESTIMATES = Memory("bound_estimates")
"""b̂ of Eq. (23). Laws that learn nothing keep it unchanged for a later law that does."""
USUAL_GAUGES = tuple(float(place) for place in gauge_places(1.0)[0])


def nothing_derived(_: Any) -> dict[str, np.ndarray]:
    """No constants besides the gains."""
    return {}


def usual_gauges(_: Any) -> tuple[float, ...]:
    """s/L of the gauges of `physics.sensors`, the default."""
    return USUAL_GAUGES


@dataclass(frozen=True)
class Law:
    """A complete control law. The field `kind` of `model` is its name everywhere."""

    model: type[Controller]
    kernel: Callable[..., None]
    fastest_rate: Callable[..., float] | None = None
    memory: tuple[Memory, ...] = (BOUND_ESTIMATES,)
    signals: tuple[Signal, ...] = ()
    """Signals of its own, which the kernel writes."""
    limits: Callable[[Any], dict[str, dict[str, float]]] = lambda _: {}
    """Levels to draw in plots, from the model's gains: signal → label with unit → value."""
    start: Callable[[Start], dict[str, np.ndarray]] | None = None
    """Memory parts that do not start at zero when a run starts or the law takes over in motion."""
    bumpless_transfer: Callable[[Start, Start, dict[str, np.ndarray]], dict[str, np.ndarray]] | None = None
    """Adjusts memory parts to a change of gains or of the believed payload in motion, so that the law's answer jumps by no more
    than the change itself. It takes the `Start` before the change, the `Start` now, and the present memory."""
    sliding_slope: Callable[[Any], np.ndarray] = lambda _: np.zeros(3)
    """Λ (3,), 1/s, of s = ė + Λe in plots, from the model's gains; 0 without a sliding surface."""
    constants: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Further fields of the gains record and their shapes, which `derive` computes from the scenario."""
    derive: Callable[[Any], dict[str, np.ndarray]] = nothing_derived
    untouched: tuple[str, ...] = ()
    """Gains on which `derive` and `start` do not depend."""
    conditions: Callable[[Circumstances], tuple[Condition, ...]] = lambda _: ()
    """Conditions of its stability that can be computed, besides those of all laws (`analysis.law_conditions`)."""
    drives: bool = True
    """Whether the motors work at all."""
    relies_on_masses: bool = False
    """Whether the masses that it believes shape its force and it learns none, so that wrong ones leave more to its feedback."""
    for_settings: Callable[[Any], "Law"] | None = None
    """If memory or signals depend on the settings: the law for a controller's settings."""
    gauges: Callable[[Any], Sequence[float]] = usual_gauges
    """Places of the strain gauges that the sampled law reads, s/L, from the model's settings; `MOST_GAUGES` at most."""
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
        """The last error of a person's own law, as a sentence; empty if there was none."""
        return ""

    def warning(self, settings: Any) -> str:
        """Why runs of a person's own law cannot be repeated, as a sentence; empty as far as is known."""
        return ""

    def is_ready(self, settings: Any) -> bool:
        """Whether a world can use it at once."""
        return True

    def gains(self, scenario: Any) -> np.ndarray:
        """The record of a scenario's gains, flat, as kernels take it."""
        record = np.zeros(1, self.gains_type)
        for name in own_numbers(self.model, Controller):
            record[name] = getattr(scenario.controller, name)
        for name, value in self.derive(scenario).items():
            record[name] = value
        return record.view(np.float64)

    @cached_property
    def addresses(self) -> tuple[int, int]:
        """Addresses of kernel and fastest rate, compiled or loaded when first used."""
        now = numba.from_dtype(LAW_INPUT)
        return (
            kernel_address(self.kernel, self.gains_type, now, VECTOR, VECTOR, VECTOR),
            kernel_address(self.fastest_rate, self.gains_type, now, VECTOR, MATRIX, VECTOR, returns=numba.float64),
        )

    @property
    def is_loaded(self) -> bool:
        """Whether `addresses` are compiled or loaded."""
        return "addresses" in vars(self)

    def memory_slices(self, arm_count: int) -> dict[str, slice]:
        """The place of each part of the memory, by name."""
        slices, at = {}, 0
        for part in self.memory:
            slices[part.name] = slice(at, at + part.length(arm_count))
            at += part.length(arm_count)
        return slices

    def memory_size(self, arm_count: int) -> int:
        """Length of the memory."""
        return sum(part.length(arm_count) for part in self.memory)

    @property
    def signal_count(self) -> int:
        """Number of values in the law's own signals."""
        return sum(signal.fixed_size for signal in self.signals)


def _lacks(law: Law) -> str:
    if law.fastest_rate is not None:
        return ""
    return (
        f"The control law {law.kind!r} does not say its fastest rate, which the step control needs: "
        "give Law(..., fastest_rate=a kernel of gains, now, memory, S and kappa)."
    )


LAWS = Registry(Law, "control law", "LAW", "flexlab.control.laws", _lacks)
laws, add_law, add_law_file, forget_law, on_new_law = LAWS.all, LAWS.add, LAWS.add_file, LAWS.forget, LAWS.on_new


def law_of(controller: Controller) -> Law:
    """The law for the settings of a scenario's controller."""
    law = LAWS[controller.kind]
    return law if law.for_settings is None else law.for_settings(controller)
