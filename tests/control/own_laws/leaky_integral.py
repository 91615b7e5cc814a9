"""A law in one file: task-space PID with a leaking integral, and the work asked of the motors as a signal of its own."""

from typing import Literal

from flexlab.compiled import pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import Law, Memory
from flexlab.control.rates import largest_ratio
from flexlab.quantities import Number, OneOrThree, quantity
from flexlab.signal import Signal

POSITION_RATIO, INTEGRAL_RATIO, LEAK = 25.0, 50.0, 0.5
"""Position gain (1/s) and integral gain (1/s²) per velocity gain, and the decay rate of the integral (1/s)."""


class LeakyIntegral(Controller):
    """PID with a leaking integral."""

    kind: Literal["leaky-integral"] = "leaky-integral"
    velocity_gain: OneOrThree = quantity(
        800.0, title="Velocity gain", symbol="D", unit="N·s/m", low=0, high=1e6, slider=(0, 5000)
    )
    largest_integral: Number = quantity(
        0.1, title="Largest integral", symbol="I_max", unit="m·s", low=0, high=10, slider=(0, 1)
    )


@pluggable
def leaky_integral(gains, now, memory, memory_rate, signals):
    """u_i = Ḡ_i + share (weight - D (ė + 25 e + 50 z)), ż = e - z/2 within ±I_max; the fourth memory is ∫Σ u_iᵀẋ dt."""
    power = 0.0
    for a in range(3):
        error, rate_error = now.x[a] - now.desired[0, a], now.v[a] - now.desired[1, a]
        z = min(max(memory[a], -gains.largest_integral), gains.largest_integral)
        wanted = gains.velocity_gain[a] * (rate_error + POSITION_RATIO * error + INTEGRAL_RATIO * z)
        memory_rate[a] = error - LEAK * memory[a]
        for i in range(now.arm_count):
            weight = now.m * now.gravity if a == 1 else 0.0
            now.u[i, a] = now.G[i, a] + now.share[i] * (weight - wanted)
            power += now.u[i, a] * now.v[a]
    memory_rate[3] = power
    signals[0] = memory[3]


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """Return the fastest rate of the closed loop, 1/s."""
    return largest_ratio(S, gains.velocity_gain, now.scratch[3:6]) + POSITION_RATIO


LAW = Law(
    LeakyIntegral,
    leaky_integral,
    fastest_rate,
    memory=(Memory("error_integral", 3), Memory("asked_work", 1)),
    signals=(Signal("asked_work", "W_u", ("J",), "work that the law has asked of the motors"),),
    limits=lambda law: {"asked_work": {"none (J)": 0.0}},
)
