"""Composite control: any law for the slow motion, and active damping of the beam as the fast part.

    u_i = (slow law) + share_i (ΣM̄_j) [k_v v̂ e2; k_θ ω̂]        v̂, ω̂: estimates of hᵀq̇ and gᵀq̇

The two time scales are those of Siciliano & Book (Int. J. Robotics Research 7(4), 1988): to a slow law the beam is stiff,
and to the beam the slow torques stand still. The beam feels the arms through the acceleration of the virtual link alone,
η̈ + Dη̇ + Ω²η = -h a_lat - g α. With exact rates and no delay, V = ½(η̇ᵀη̇ + ηᵀΩ²η) has V̇ = -η̇ᵀDη̇ - k_v v² - k_θ ω²: every mode
with h_k ≠ 0 (g_k ≠ 0) is damped, whatever the gains k_v, k_θ ≥ 0, and so is the whole where the slow law's closed loop is
stable and slower than the beam (Tikhonov). Assumed: torques act at once, ΣM̄_i outweighs the payload, rates are known.

Sampling and delay violate the first: with torques (d + ½) T_c late, the phase of the feedback turns by ω (d + ½) T_c, and modes
for which that exceeds 90° are driven; at T_c = 1 ms and d = 1 those between 1/(6 T_c) and 1/(2 T_c). An observer predicts over
that time, and needs no sensor of the rates; `control.observers.observer` says what happens to modes outside its model.
`flexlab.modes` gives the stability of the sampled loop.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, create_model, model_validator
from pydantic_core import PydanticCustomError

from flexlab.compiled import attributes, call_kernel, call_number_kernel, pluggable
from flexlab.control.conditions import Circumstances, Condition, fed_modes
from flexlab.control.controller import Controller
from flexlab.control.law import USUAL_GAUGES, Law, Memory, Start, law_of, laws, on_new_law
from flexlab.control.laws.adaptive_sliding_mode import AdaptiveSlidingMode
from flexlab.control.laws.no_control import NoControl
from flexlab.control.laws.vibration_damping import add_link_acceleration
from flexlab.control.observers.believed_plant import BelievedPlant
from flexlab.control.observers.observer import (
    Observer,
    known_observers,
    observer_constants,
    observer_shapes,
    padded,
    predict,
    remember,
    update_estimate,
)
from flexlab.errors import ScenarioError
from flexlab.quantities import Number, Part, either, quantity

MOST_GAINS = 1024
"""The most numbers in the slow part's record of gains and constants."""


class MeasuredRates(Part):
    """The measured hᵀq̇ and gᵀq̇."""

    kind: Literal["measured"] = "measured"


def _own_part(model: type[Controller]) -> Any:
    """A law's own fields as a part of a scenario, without those that all laws share."""
    fields: Any = {
        name: (about.annotation, about)
        for name, about in model.model_fields.items()
        if name not in Controller.model_fields
    }
    part = create_model(f"Slow{model.__name__}", __base__=Part, __module__=__name__, __doc__=model.__doc__, **fields)
    _slow_parts[model] = part
    return part


_slow_parts: dict[type[Controller], type[Part]] = {}
AnySlow = Any
AnyObserver = Any
if not TYPE_CHECKING:
    # `_know_laws` puts the parts of all laws here once they are known.
    AnySlow = Annotated[_own_part(AdaptiveSlidingMode) | _own_part(NoControl), Field(discriminator="kind")]
    AnyObserver = Annotated[either([MeasuredRates, *known_observers()]), Field(discriminator="kind")]


class Composite(Controller):
    """Any law for the slow motion, and active damping of the beam: a_lat = k_v v̂, α = k_θ ω̂, measured or estimated."""

    kind: Literal["composite"] = "composite"
    slow: AnySlow = quantity(_slow_parts[AdaptiveSlidingMode](), "Slow part")
    lateral_vibration_gain: Number = quantity(
        100.0, "Lateral vibration gain", "k_v", "1/(kg·s)", low=0, high=1e5, slider=(0, 300)
    )
    angular_vibration_gain: Number = quantity(
        0.0, "Angular vibration gain", "k_θ", "1/(kg·m²·s)", low=0, high=1e6, slider=(0, 3000)
    )
    observer: AnyObserver = quantity(MeasuredRates(), "Observer")

    @model_validator(mode="before")
    @classmethod
    def _usual_kinds(cls, data: Any) -> Any:
        """Give parts without a kind the default one."""
        if not isinstance(data, dict):
            return data
        slow = data["slow"].get("kind") if isinstance(data.get("slow"), dict) else None
        known = laws().get(slow) if isinstance(slow, str) else None
        if known is not None and type(known) is not Law:
            raise PydanticCustomError(
                "sampling",
                "the slow part cannot be {kind}, a law in Python: choose one of flexlab's, or damp the beam in your own file "
                "with at.beam_rate",
                {"kind": slow},
            )
        usual = {name: cls.model_fields[name].default.kind for name in ("slow", "observer")}
        return data | {
            name: {"kind": kind, **data[name]}
            for name, kind in usual.items()
            if isinstance(data.get(name), dict) and "kind" not in data[name]
        }

    @model_validator(mode="after")
    def _has_instants(self) -> "Composite":
        if isinstance(self.observer, Observer) and self.control_period is None:
            raise PydanticCustomError(
                "sampling",
                "the observer {kind} estimates from one control instant to the next: "
                "give the control period (controller.control_period) a value in s, or choose the observer measured",
                {"kind": self.observer.kind},
            )
        return self


def _know_laws() -> None:
    """Allow any known kernel law without parts of its own as the slow part."""
    known = [law.model for law in laws().values() if type(law) is Law and law.for_settings is None]
    parts = [_slow_parts.get(model) or _own_part(model) for model in known]
    Composite.model_fields["slow"].annotation = either(parts)
    Composite.model_rebuild(force=True)


on_new_law(_know_laws)


def slow_controller(settings: Composite) -> Controller:
    """The slow part as a controller of its own."""
    shared = {name: getattr(settings, name) for name in Controller.model_fields}
    return laws()[settings.slow.kind].model(**shared, **dict(settings.slow))


def _for_settings(settings: Composite) -> Law:
    slow, observer = laws()[settings.slow.kind], settings.observer
    own = (observer.memory(),) if isinstance(observer, Observer) else ()
    known, law = _variants.get((slow.kind, own), (None, LAW))
    if known is not slow:
        law = _with_slow(slow, own)
        _variants[slow.kind, own] = slow, law
    return law


_variants: dict[tuple[str, tuple[Memory, ...]], tuple[Law, Law]] = {}


def _with_slow(slow: Law, own: tuple[Memory, ...]) -> Law:
    """The law with a slow part and an observer's memory."""
    start, transfer = slow.start, slow.bumpless_transfer

    def alone(given: Start) -> Start:
        gains = np.array(given.gains.slow_gains[: int(given.gains.slow_gain_count)])
        return given._replace(gains=attributes(gains, slow.gains_type))

    return replace(
        LAW,
        memory=(*slow.memory, *own),
        signals=slow.signals,
        start=start and (lambda given: start(alone(given))),
        bumpless_transfer=transfer and (lambda before, given, memory: transfer(alone(before), alone(given), memory)),
    )


def _derive(scenario: Any) -> dict[str, Any]:
    """The slow law's addresses and gains, and the observer's constants."""
    settings = scenario.controller
    alone = scenario.model_copy(update={"controller": slow_controller(settings)})
    slow = law_of(alone.controller)
    gains, (kernel, rate) = slow.gains(alone), slow.addresses
    if len(gains) > MOST_GAINS:
        text = f"controller.slow: {slow.kind} has {len(gains)} gains and constants, more than {MOST_GAINS}: choose another."
        raise ScenarioError([("controller.slow", text)])
    found = {
        "slow_kernel": kernel,
        "slow_rate": rate,
        "slow_gains": padded(gains, (MOST_GAINS,)),
        "slow_gain_count": len(gains),
        "slow_memory": slow.memory_size(len(scenario.arms)),
    }
    observer = settings.observer
    if not isinstance(observer, Observer):
        return found
    ahead = settings.input_delay + 0.5 if observer.horizon is None else observer.horizon
    return found | {"observed": 1.0} | observer_constants(scenario, observer, _rates, ahead)


def _rates(plant: BelievedPlant) -> np.ndarray:
    """Rows of (hᵀη̇, gᵀη̇), (2, 2 n)."""
    n = len(plant.mass)
    rows = np.zeros((2, 2 * n))
    rows[0, n + 3 :], rows[1, n + 3 :] = plant.h, plant.g
    return rows


@pluggable
def composite(gains, now, memory, memory_rate, signals):
    """The slow law, and u += (ΣM̄_i)[k_v v̂ e2; k_θ ω̂]."""
    own = int(gains.slow_memory)
    slow_gains = gains.slow_gains[: int(gains.slow_gain_count)]
    call_kernel(int(gains.slow_kernel), slow_gains, (now, memory[:own], memory_rate[:own], signals))
    rate = now.scratch[7]
    rate[0], rate[1] = now.beam_rate[0], now.beam_rate[1]
    if gains.observed > 0:
        estimate = memory_rate[own:]
        update_estimate(gains, now, memory[own:], estimate)
        predict(gains, now, estimate, rate)
        remember(gains, memory[own:], estimate)
    add_link_acceleration(now, gains.lateral_vibration_gain * rate[0], gains.angular_vibration_gain * rate[1])


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """Fastest rate, 1/s: that of the slow law, plus the rate at which the vibration gains damp hᵀq̇ and gᵀq̇."""
    slow_gains = gains.slow_gains[: int(gains.slow_gain_count)]
    own = memory[: int(gains.slow_memory)]
    slow = call_number_kernel(int(gains.slow_rate), slow_gains, (now, own, S, kappa))
    return slow + gains.lateral_vibration_gain * kappa[0] + gains.angular_vibration_gain * kappa[2]


def _sliding_slope(settings: Composite) -> np.ndarray:
    slow = slow_controller(settings)
    return law_of(slow).sliding_slope(slow)


def _limits(settings: Composite) -> dict[str, dict[str, float]]:
    slow = slow_controller(settings)
    return law_of(slow).limits(slow)


def _conditions(around: Circumstances) -> tuple[Condition, ...]:
    """The slow law's conditions, and that late feedback of measured rates drives no mode."""
    settings = around.scenario.controller
    alone = around.scenario.model_copy(update={"controller": slow_controller(settings)})
    slow = law_of(alone.controller).conditions(replace(around, scenario=alone))
    if isinstance(settings.observer, Observer):
        return slow
    return *slow, *fed_modes(around, (settings.lateral_vibration_gain, settings.angular_vibration_gain))


def _gauges(settings: Composite) -> tuple[float, ...]:
    return settings.observer.gauges if isinstance(settings.observer, Observer) else USUAL_GAUGES


LAW = Law(
    Composite,
    composite,
    fastest_rate,
    memory=(),
    sliding_slope=_sliding_slope,
    limits=_limits,
    conditions=_conditions,
    constants={
        "slow_kernel": (),
        "slow_rate": (),
        "slow_gains": (MOST_GAINS,),
        "slow_gain_count": (),
        "slow_memory": (),
        "observed": (),
        **observer_shapes(rows=2),
    },
    derive=_derive,
    untouched=("lateral_vibration_gain", "angular_vibration_gain"),
    for_settings=_for_settings,
    gauges=_gauges,
    place=25,
)
