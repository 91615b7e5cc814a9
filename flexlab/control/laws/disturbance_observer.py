"""Feedback on the sliding surface with a momentum observer that cancels disturbances of the rigid model.

    Σu_i = B ṙ + C̄ r + Ḡ - K s - d̂
    d̂ = ℓ (p - p(0) - ∫ (Σu_i + C̄ᵀẋ - Ḡ + (ṁ/m) Ā ẋ + d̂) dt),   p = Bẋ

with e = x - x_d, r = ẋ_d - Λe, s = ẋ - r (3,), C̄ = ΣC̄_i, B = ΣM̄_i + Ā and Ḡ as the controller believes the payload, and ṁ/m,
1/s, as it believes the payload to grow. p in kg·m/s and kg·m²/s, d̂ in N, N, N·m. Memory: p(0) and the integral, (3,) each.
De Luca and Mattone (ICRA 2005) for the observer.
Stability: the plant is B ẍ + C̄ẋ + Ḡ = Σu_i + d, so that dd̂/dt = ℓ (d - d̂): d̂ is d behind a first-order filter of the rate
ℓ, whatever the motion. With ½ (d - d̂)² / ℓ added to ½ sᵀBs, V falls outside a ball whose radius goes as ‖dd/dt‖/(ℓ K): any
K > 0, ℓ > 0 and a d of bounded rate. The beam's vibration is part of d; d̂ follows it with the lag atan(ω/ℓ), so that ℓ should
stay well below the first mode of a weakly damped beam. Sampled, the filter needs ℓ T_c < 2.
The integral takes Σu_i of the first line: what a torque limit removes appears in d̂, and so does what the feed-forward of the
bending and the compensation of friction add, which is meant to cancel a part of d.
"""

from typing import Literal

import numpy as np

from flexlab.compiled import inlined, pluggable
from flexlab.control.conditions import SEPARATION, Circumstances, Condition, n
from flexlab.control.controller import Controller
from flexlab.control.law import Law, Memory, Start
from flexlab.control.law_kernels import drive_arms, share_payload
from flexlab.control.sliding_surface import aim_at_surface, layer_rate, slope_of
from flexlab.quantities import Number, OneOrThree, quantity
from flexlab.signal import AXIS, Signal


class DisturbanceObserver(Controller):
    """Feedback on the sliding surface and a momentum observer of what the rigid model does not know."""

    kind: Literal["disturbance-observer"] = "disturbance-observer"
    feedback_gain: OneOrThree = quantity(
        200.0, "Feedback gain", "K", "N·s/m, N·m·s/rad", low=0, high=1e6, slider=(0, 1000)
    )
    sliding_slope: OneOrThree = quantity(50.0, "Sliding slope", "Λ", "1/s", low=0, high=1e4, slider=(1, 200))
    observer_gain: Number = quantity(20.0, "Observer gain", "ℓ", "1/s", low=0, high=1e4, slider=(0, 200))


@inlined
def momentum(now, A, p):
    """p = (ΣM̄_i + Ā) ẋ (3,); A: scratch (3, 3)."""
    share_payload(now, 1.0, A)
    for a in range(3):
        p[a] = 0.0
        for b in range(3):
            inertia = A[a, b]
            for i in range(now.arm_count):
                inertia += now.M[i, a, b]
            p[a] += inertia * now.v[b]


@inlined
def known_rate(now, A, rate):
    """Add C̄ᵀẋ - Ḡ + ṁ/m Ā ẋ (3,), of arms, payload weight and added material, to `rate`; A: scratch (3, 3)."""
    if now.growth != 0:
        share_payload(now, now.growth, A)
        for a in range(3):
            for b in range(3):
                rate[a] += A[a, b] * now.v[b]
    for i in range(now.arm_count):
        for a in range(3):
            rate[a] -= now.G[i, a]
            for b in range(3):
                rate[a] += now.C[i, b, a] * now.v[b]
    rate[1] -= now.m * now.gravity


@pluggable
def disturbance_observer(gains, now, memory, memory_rate, signals):
    """-K s - d̂; memory: p(0), then the integral."""
    A, d_hat = now.scratch[3:6], now.scratch[6]
    momentum(now, A, d_hat)
    for a in range(3):
        d_hat[a] = gains.observer_gain * (d_hat[a] - memory[a] - memory[3 + a])
        signals[a] = d_hat[a]
    aim_at_surface(gains.sliding_slope, now)
    r_dot, r, feedback = now.scratch[0], now.scratch[1], now.scratch[2]
    for a in range(3):
        feedback[a] = -gains.feedback_gain[a] * feedback[a] - d_hat[a]
    drive_arms(now, r_dot, r, feedback, A)
    rate = memory_rate[3:6]
    for a in range(3):
        rate[a] = d_hat[a]
        for i in range(now.arm_count):
            rate[a] += now.u[i, a]
    known_rate(now, A, rate)


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """Fastest rate of the closed loop, 1/s."""
    return layer_rate(gains.feedback_gain, gains.sliding_slope, 0.0, now, S) + gains.observer_gain


def _momentum_ahead(begin: Start) -> np.ndarray:
    """p (3,) at the next instant at which the law acts, as the model predicts it."""
    now, A, p = begin.now, np.zeros((3, 3)), np.zeros(3)
    rate = np.asarray(now.u)[: now.arm_count].sum(axis=0)
    momentum(now, A, p)
    known_rate(now, A, rate)
    return p + begin.wait * rate


def start(begin: Start) -> dict[str, np.ndarray]:
    """p(0) of the first instant at which the law acts, so that d̂ begins at zero."""
    return {"momentum_at_start": _momentum_ahead(begin)}


def bumpless_transfer(before: Start, begin: Start, memory: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Keep d̂ when the gain or the believed inertia is changed in motion."""
    known = memory["momentum_integral"]
    d_hat = before.gains.observer_gain * (_momentum_ahead(before) - memory["momentum_at_start"] - known)
    passed = d_hat / begin.gains.observer_gain if begin.gains.observer_gain > 0 else np.zeros(3)
    return {"momentum_at_start": _momentum_ahead(begin) - known - passed}


def conditions(around: Circumstances) -> tuple[Condition, ...]:
    """The observer must be slow compared with the beam's first mode."""
    gain, first = around.scenario.controller.observer_gain, float(np.min(around.omega))
    text = f"ℓ ≤ ω₁/{n(SEPARATION)}: the observer follows at {n(gain)} 1/s, a third of the beam's first mode is "
    return (Condition(f"{text}{n(first / SEPARATION)} 1/s.", gain <= first / SEPARATION),)


LAW = Law(
    DisturbanceObserver,
    disturbance_observer,
    fastest_rate,
    (Memory("momentum_at_start"), Memory("momentum_integral")),
    (
        Signal(
            "disturbance_estimate", "d̂", ("N", "N", "N·m"), "what the rigid model does not know, as observed", (AXIS,)
        ),
    ),
    start=start,
    untouched=("feedback_gain", "sliding_slope", "observer_gain"),
    bumpless_transfer=bumpless_transfer,
    conditions=conditions,
    sliding_slope=slope_of,
    relies_on_masses=True,
    place=16,
)
