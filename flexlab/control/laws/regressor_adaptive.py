"""Adaptive control with a regressor, in the line of the paper's reference [14]: it learns the masses, not a bound.

    Σu_i = Y(x, ẋ, r, ṙ) â - K s,   dâ/dt = -Γ Yᵀ s,   â(0) = factor · truth

(Slotine and Li, Int. J. Robotics Research 6(3), 1987) with e = x - x_d, r = ẋ_d - Λe, s = ẋ - r (3,). â: payload mass m, kg,
payload inertia I, kg·m², then the masses of each arm's three links, kg (2 + 3 arms); their centres and radii of gyration are
known. Columns of Y: for m (ṙ_x, ṙ_y + g, 0), for I (0, 0, ṙ_θ), for a link's mass M̄_iṙ + C̄_ir + Ḡ_i of that link alone with
1 kg, which goes into u_i. Γ is diagonal: one gain each for m, I and all link masses. K in N·s/m and N·m·s/rad.
Stability: for a rigid payload V = ½ sᵀ(ΣM̄_i + diag(m, m, I))s + ½ (â - a)ᵀΓ⁻¹(â - a) obeys dV/dt = -sᵀKs for any K > 0 and
Γ > 0, so that s → 0; â → a only on a motion rich enough to tell the masses apart. A beam that bends adds sᵀΨ: s then ends
in a ball ‖s‖ ≤ ‖Ψ‖/K, within which â may drift, and noise in s makes it drift too. Sampled, YΓYᵀ T_c must stay small
against K.
"""

from typing import Any, Literal

import numpy as np

from flexlab.compiled import inlined, pluggable
from flexlab.control.conditions import Circumstances, Condition
from flexlab.control.controller import Controller
from flexlab.control.law import Law, Memory, Start
from flexlab.control.rates import largest_ratio
from flexlab.control.sliding_surface import aim_at_surface, slope_of
from flexlab.physics.law_input import MOST_ARMS
from flexlab.quantities import Number, OneOrThree, quantity
from flexlab.signal import Signal, numbered

PAYLOAD = 2
"""Number of estimates of the payload, which come before those of the links."""
LINKS = 3
"""Links of an arm."""


class RegressorAdaptive(Controller):
    """Slotine & Li's adaptive law: the masses of payload and links are learnt (the line of the paper's reference [14])."""

    kind: Literal["regressor-adaptive"] = "regressor-adaptive"
    feedback_gain: OneOrThree = quantity(
        200.0, "Feedback gain", "K", "N·s/m, N·m·s/rad", low=0, high=1e6, slider=(0, 1000)
    )
    sliding_slope: OneOrThree = quantity(50.0, "Sliding slope", "Λ", "1/s", low=0, high=1e4, slider=(1, 200))
    adaptation_gain_mass: Number = quantity(
        1.0, "Adaptation gain of the payload's mass", "Γ_m", "kg·s²/m²", low=0, high=1e6, slider=(0, 10)
    )
    adaptation_gain_inertia: Number = quantity(
        0.01, "Adaptation gain of the payload's inertia", "Γ_I", "kg·m²·s²", low=0, high=1e6, slider=(0, 0.1)
    )
    adaptation_gain_links: Number = quantity(
        5.0, "Adaptation gain of the links' masses", "Γ_l", "kg·s²/m²", low=0, high=1e6, slider=(0, 50)
    )
    initial_estimate_factor: Number = quantity(
        0.8, "Estimates over truth at the law's start", "â(0)/a", "1", low=0, high=100, slider=(0, 2)
    )


@inlined
def link_loads(now, i, links, r, r_dot, load):
    """Fill load (3 links, 3 angles), N·m/kg: torques of each link of arm i with 1 kg along the absolute link angles.

    In these angles C is μ_jk sin(α_j - α_k) dα_k/dt; the accelerations that go with (r, ṙ) follow from the wrist's closure.
    """
    l1, l2, reach, tip, a1, a2, a3, k1, k2, k3 = links
    J, v, g = now.J[i], now.v, now.gravity
    c, s = now.trig[0], now.trig[1]
    c1, s1, c2, s2 = now.direction[i, 0], now.direction[i, 1], now.direction[i, 2], now.direction[i, 3]
    rate_1 = J[0, 0] * v[0] + J[0, 1] * v[1] + J[0, 2] * v[2]
    rate_2 = J[1, 0] * v[0] + J[1, 1] * v[1] + J[1, 2] * v[2]
    r1 = J[0, 0] * r[0] + J[0, 1] * r[1] + J[0, 2] * r[2]
    r2 = J[1, 0] * r[0] + J[1, 1] * r[1] + J[1, 2] * r[2]
    turn_1, turn_2, turn_3 = rate_1 * r1, rate_2 * r2, v[2] * r[2]
    bx = r_dot[0] + l1 * c1 * turn_1 + l2 * c2 * turn_2 - reach * c * turn_3
    by = r_dot[1] + l1 * s1 * turn_1 + l2 * s2 * turn_2 - reach * s * turn_3
    first = J[0, 0] * bx + J[0, 1] * by + J[0, 2] * r_dot[2]
    second = J[1, 0] * bx + J[1, 1] * by + J[1, 2] * r_dot[2]
    third = r_dot[2]
    c12, s12 = c1 * c2 + s1 * s2, s1 * c2 - c1 * s2
    c13, s13 = tip * (c1 * c + s1 * s), tip * (s1 * c - c1 * s)
    c23, s23 = tip * (c2 * c + s2 * s), tip * (s2 * c - c2 * s)
    on_1_by_2, on_2_by_1 = c12 * second + s12 * turn_2, c12 * first - s12 * turn_1
    on_1_by_3, on_3_by_1 = c13 * third + s13 * turn_3, c13 * first - s13 * turn_1
    on_2_by_3, on_3_by_2 = c23 * third + s23 * turn_3, c23 * second - s23 * turn_2
    load[0, 0], load[0, 1], load[0, 2] = (a1 * a1 + k1) * first + g * a1 * c1, 0.0, 0.0
    load[1, 0] = l1 * (l1 * first + a2 * on_1_by_2 + g * c1)
    load[1, 1], load[1, 2] = a2 * (l1 * on_2_by_1 + g * c2) + (a2 * a2 + k2) * second, 0.0
    load[2, 0] = l1 * (l1 * first + l2 * on_1_by_2 + a3 * on_1_by_3 + g * c1)
    load[2, 1] = l2 * (l1 * on_2_by_1 + l2 * second + a3 * on_2_by_3 + g * c2)
    load[2, 2] = a3 * (l1 * on_3_by_1 + l2 * on_3_by_2 + g * tip * c) + (a3 * a3 + k3) * third


@inlined
def link_numbers(row):
    """The constants of one arm (10,) as a tuple."""
    return row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9]


@pluggable
def regressor_adaptive(gains, now, estimates, rate, signals):
    """Y â - K s, and dâ/dt = -Γ Yᵀ s."""
    aim_at_surface(gains.sliding_slope, now)
    r_dot, r, s, load, common = now.scratch[0], now.scratch[1], now.scratch[2], now.scratch[3:6], now.scratch[6]
    up = r_dot[1] + now.gravity
    for a in range(3):
        common[a] = -gains.feedback_gain[a] * s[a]
    common[0] += estimates[0] * r_dot[0]
    common[1] += estimates[0] * up
    common[2] += estimates[1] * r_dot[2]
    rate[0] = -gains.adaptation_gain_mass * (r_dot[0] * s[0] + up * s[1])
    rate[1] = -gains.adaptation_gain_inertia * r_dot[2] * s[2]
    for i in range(now.arm_count):
        J, at = now.J[i], PAYLOAD + LINKS * i
        link_loads(now, i, link_numbers(gains.links[i]), r, r_dot, load)
        s_1 = J[0, 0] * s[0] + J[0, 1] * s[1] + J[0, 2] * s[2]
        s_2 = J[1, 0] * s[0] + J[1, 1] * s[1] + J[1, 2] * s[2]
        on_1 = on_2 = on_3 = 0.0
        for k in range(LINKS):
            on_1 += estimates[at + k] * load[k, 0]
            on_2 += estimates[at + k] * load[k, 1]
            on_3 += estimates[at + k] * load[k, 2]
            power = load[k, 0] * s_1 + load[k, 1] * s_2 + load[k, 2] * s[2]
            rate[at + k] = -gains.adaptation_gain_links * power
        for a in range(3):
            now.u[i, a] = J[0, a] * on_1 + J[1, a] * on_2 + now.share[i] * common[a]
        now.u[i, 2] += on_3
    for k in range(len(signals)):
        signals[k] = estimates[k] if k < len(estimates) else np.nan


@pluggable
def fastest_rate(gains, now, estimates, S, kappa):
    """Fastest rate, 1/s: S⁻¹K, plus Λ, plus √(S⁻¹ trace(YΓYᵀ)) of the adaptation."""
    r_dot, r, load, B = now.scratch[0], now.scratch[1], now.scratch[3:6], now.scratch[5:8]
    feedback = largest_ratio(S, gains.feedback_gain, B)
    aim_at_surface(gains.sliding_slope, now)
    up = r_dot[1] + now.gravity
    learning = gains.adaptation_gain_mass * (r_dot[0] * r_dot[0] + up * up)
    learning += gains.adaptation_gain_inertia * r_dot[2] * r_dot[2]
    for i in range(now.arm_count):
        link_loads(now, i, link_numbers(gains.links[i]), r, r_dot, load)
        for k in range(LINKS):
            for a in range(3):
                force = now.J[i, 0, a] * load[k, 0] + now.J[i, 1, a] * load[k, 1] + (load[k, 2] if a == 2 else 0.0)
                learning += gains.adaptation_gain_links * force * force
    for a in range(3):
        r[a] = learning
    return feedback + max(gains.sliding_slope) + np.sqrt(largest_ratio(S, r, B))


def known(scenario: Any) -> dict[str, np.ndarray]:
    """Per arm l1, l2, wrist reach, direction of the last link, centres and squared radii of gyration; and the true masses."""
    payload, links = scenario.payload, np.ones((MOST_ARMS, 10))
    total = payload.linear_density * payload.length
    truth = np.zeros(PAYLOAD + LINKS * MOST_ARMS)
    truth[:PAYLOAD] = total, total * (payload.length * payload.length) / 12
    for i, arm in enumerate(scenario.arms):
        side = -1 if i == 0 else 1
        reach = side * (payload.length / 2 + arm.link_length[2])
        mass, inertia = np.array(arm.link_mass), np.array(arm.inertia)
        gyration = np.divide(inertia, mass, out=np.zeros(LINKS), where=mass > 0)
        links[i] = *arm.link_length[:2], reach, -side, *arm.link_center, *gyration
        truth[PAYLOAD + LINKS * i : PAYLOAD + LINKS * (i + 1)] = arm.link_mass
    return {"links": links, "truth": truth}


def start(begin: Start) -> dict[str, np.ndarray]:
    """â(0) = factor · truth."""
    begun = begin.gains.initial_estimate_factor * begin.gains.truth
    return {
        "payload_estimates": begun[:PAYLOAD],
        "link_mass_estimates": begun[PAYLOAD : PAYLOAD + LINKS * begin.now.arm_count],
    }


TOLD, TELLABLE = 1e-3, 1e-9
"""Least singular values of Y over the largest, each column times its true mass, at which a combination of masses can be
identified: on a path, and by some motion."""


def conditions(around: Circumstances) -> tuple[Condition, ...]:
    """Whether the path is rich enough to identify all combinations of masses that any motion can."""
    constants = known(around.scenario)
    links, weight = constants["links"], constants["truth"][: PAYLOAD + LINKS * around.path[0].arm_count]
    on_path = [_regressor(now, links, now.desired[1], now.desired[2]) * weight for now in around.path]
    on_any, moving = [], around.path[0].copy()
    for rate in (np.zeros(3), *np.eye(3)):
        moving.v[:] = rate
        on_any += [_regressor(moving, links, unit, unit) * weight for unit in np.eye(3)]
    told, tellable = _rank(on_path, TOLD), _rank(on_any, TELLABLE)
    text = f"Y rich enough: this path identifies {told} of the {tellable} identifiable combinations of masses"
    sentence = f"{text}; s goes to zero even so, the rest of â stays where it is."
    return (Condition(sentence, told >= tellable, of_stability=False),)


def _rank(rows: list[np.ndarray], tolerance: float) -> int:
    """Number of singular values of the rows above a fraction of the largest."""
    values = np.linalg.svd(np.concatenate(rows), compute_uv=False)
    return int(np.sum(values > tolerance * values[0]))


def _regressor(now: Any, links: np.ndarray, r: np.ndarray, r_dot: np.ndarray) -> np.ndarray:
    """Y (3, 2 + 3 arms)."""
    load = np.zeros((LINKS, 3))
    columns = [[r_dot[0], r_dot[1] + now.gravity, 0.0], [0.0, 0.0, r_dot[2]]]
    for i in range(now.arm_count):
        link_loads(now, i, tuple(links[i]), r, r_dot, load)
        columns += list(load[:, :2] @ now.J[i] + load[:, 2:] * [0.0, 0.0, 1.0])
    return np.array(columns).T


LAW = Law(
    RegressorAdaptive,
    regressor_adaptive,
    fastest_rate,
    (Memory("payload_estimates", PAYLOAD), Memory("link_mass_estimates", lambda arm_count: LINKS * arm_count)),
    (
        Signal("payload_mass_estimate", "m̂", ("kg",), "learnt mass of the payload"),
        Signal("payload_inertia_estimate", "Î", ("kg·m²",), "learnt inertia of the payload"),
        Signal(
            "link_mass_estimates",
            "m̂_i",
            ("kg",),
            "learnt masses of the links, left arm first, not a number for an arm that is not there",
            (numbered(LINKS * MOST_ARMS),),
        ),
    ),
    start=start,
    conditions=conditions,
    sliding_slope=slope_of,
    constants={"links": (MOST_ARMS, 10), "truth": (PAYLOAD + LINKS * MOST_ARMS,)},
    derive=known,
    untouched=(
        "feedback_gain",
        "sliding_slope",
        "adaptation_gain_mass",
        "adaptation_gain_inertia",
        "adaptation_gain_links",
    ),
    place=18,
)
