"""The axial force in the beam and the stiffness that it adds (Kane, Ryan, Banerjee, J. Guidance 10 (1987) 139-151).

The paper's beam bends under lateral load only. The force along it, tension positive, of the undeformed link in its motion is

    N(s) = N_L + ρ a₁ (s + L/2) + ½ρω²(L²/4 - s²) - F₁ [s > s_F],      a₁ = e₁·(ẍ₀, ÿ₀) + gravity sin θ

with F₁ the axial force of a hand at s_F, and N_L = -e₁·f₁ that of the left grip, f₁ = u₁ - M̄₁ẍ - C̄₁ẋ - Ḡ₁. A single arm's free
end bears no force, so that N_L = F₁ - m a₁. To first order in the deflection the beam's equations gain the
force -K_G q with K_G = ∫N N'ᵀN' ds = N_L G0 + a₁ G1 + ω² G2 - F₁ G_F; the pose's equations stay as they are.

The ẍ in N neglects K_G and assumes that modes faster than `FASTEST_FOLLOWED` move with the link. With compliant grips N_L is the
pull of the left grip, and a₁ follows from all axial pulls on the undeformed link: ẍ would contain the effect of bending on a link
that nothing heavy holds, which is of higher order in N and not small.
"""

from collections.abc import Callable

import numpy as np

from flexlab.compiled import disjoint, inlined
from flexlab.numerics.linear_algebra import product, solve_symmetric
from flexlab.physics.beam import GAUSS_POINTS, free_coordinates, gauss_rule
from flexlab.physics.dynamics import pose_load
from flexlab.physics.hand import hand_load
from flexlab.physics.internal_force import payload_force
from flexlab.physics.mass_change import mass_factor
from flexlab.physics.plant import (
    AXIAL,
    ETA,
    FOLLOWED,
    OMEGA2,
    PULL,
    G,
    H,
    hand_of,
    has_axial_load,
)

FASTEST_FOLLOWED = 3000.0
"""Fastest mode that N follows, 1/s. Faster ones ring or decay within a step, so that N takes their mean."""
AXIAL_MODES = 32
"""Number of lowest modes to which the axial force is applied. It changes the squared frequency of mode k by a share of P/(P_cr
k²), so that the others keep their stiffness to a thousandth, and fine meshes cost a fraction."""
STIFF_MODE = 3e5
"""Frequency, rad/s, above which modes keep their stiffness, too: a force of 1000 N changes it by less than a thousandth."""
BUCKLING = {
    "pinned-pinned": 1.0,
    "clamped-clamped": 4.0,
    "clamped-pinned": 2.0457,
    "pinned-clamped": 2.0457,
    "clamped-free": 0.25,
}
"""c in the buckling load c π²EI/L², by boundary (Timoshenko & Gere, Theory of Elastic Stability, 2.1)."""
N_LEFT, ALONG, SPIN, HAND = range(4)
"""Indices of N_L, a₁, ω² and F₁ in `Workspace.axial`, and of their factors G0, G1, G2, -G_F in `Plant.axial`."""
NOW, START, END, SCRATCH, GATHERED = range(5)
"""Rows of `Workspace.axial_force`: K_G η now, at the first and at the last stage of a step of etdrk4, and scratch."""


def buckling_load(length: float, EI: float, boundary: str) -> float:
    """P_cr = c π²EI/L², N: the compression at which a beam with these ends buckles."""
    return BUCKLING[boundary] * np.pi * np.pi * EI / (length * length)


def slope_functions(xi: float, length: float) -> np.ndarray:
    """First derivatives with respect to s of the Hermite functions, 1/m and 1, (4,)."""
    return np.array(
        [
            (6 * xi * xi - 6 * xi) / length,
            1 - 4 * xi + 3 * xi * xi,
            (6 * xi - 6 * xi * xi) / length,
            3 * xi * xi - 2 * xi,
        ]
    )


def geometric_stiffness(
    length: float, element_count: int, boundary: str, force: Callable[[float], float], begin: float | None = None
) -> np.ndarray:
    """∫ N(s) N'ᵀN' ds from s = `begin` (None: the left end) to the right end, (n_q, n_q), for a `force` N(s).

    Exact for forces up to the third power of s. Sums have a fixed order, so that every machine finds the same bits.
    """
    n, l = element_count, length / element_count  # noqa: E741
    first = 0.0 if begin is None else (begin + length / 2) / l
    points, weights = gauss_rule(GAUSS_POINTS)
    whole = np.zeros((2 * n + 2, 2 * n + 2))
    for element in range(n):
        low = min(max(first - element, 0.0), 1.0)
        if low == 1.0:
            continue
        own = slice(2 * element, 2 * element + 4)
        for point, weight in zip(points, weights, strict=True):
            xi = low + (1 - low) * (point + 1) / 2
            slope = slope_functions(xi, l)
            at = force((element + xi) * l - length / 2)
            whole[own, own] += (weight * (1 - low) * l / 2 * at) * (slope[:, None] * slope)
    free = free_coordinates(n, boundary)
    return whole[np.ix_(free, free)]


def geometric_matrices(length: float, rho: float, element_count: int, boundary: str) -> np.ndarray:
    """G0 = ∫N'ᵀN', G1 = ρ∫(s + L/2)N'ᵀN', G2 = ½ρ∫(L²/4 - s²)N'ᵀN' ds, (3, n_q, n_q)."""
    forces = (lambda _: 1.0, lambda s: rho * (s + length / 2), lambda s: rho / 2 * (length * length / 4 - s * s))
    return np.array([geometric_stiffness(length, element_count, boundary, force) for force in forces])


def part_beyond(length: float, element_count: int, boundary: str, s: float) -> np.ndarray:
    """G_F = ∫N'ᵀN' ds of the beam beyond a hand at s, m, (n_q, n_q)."""
    return geometric_stiffness(length, element_count, boundary, lambda _: 1.0, s)


def in_modes(matrix: np.ndarray, V: np.ndarray) -> np.ndarray:
    """VᵀGV, (n_m, n_m), symmetric to the last bit."""
    result = product(V.T, product(matrix, V))
    return (result + result.T) / 2


def followed_loads(slow: np.ndarray, damping: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Vᵀh, Vᵀg, DVᵀh and DVᵀg of the modes that are slow (n_m,), as if there were no others, and zero for the others, (4, n_m).

    `damping`: modal D (n_m, n_m); `loads`: Vᵀh and Vᵀg of all modes, (n_m, 2).
    """
    follows = np.where(slow, 1.0, 0.0)[:, None]
    return np.concatenate([(follows * loads).T, (follows * product(damping, follows * loads)).T])


def axial_modes(omega: np.ndarray) -> np.ndarray:
    """Whether each mode has a place in `Plant.axial`, (n_m,)."""
    rank = np.argsort(np.argsort(omega, kind="stable"), kind="stable")
    return rank < AXIAL_MODES


def in_axial_modes(matrix: np.ndarray, omega: np.ndarray, V: np.ndarray) -> np.ndarray:
    """VᵀGV of the modes with an axial force, zero for those that keep their stiffness, (n_f, n_f)."""
    feels = axial_modes(omega)
    soft = omega[feels] <= STIFF_MODE
    return in_modes(matrix, V[:, feels]) * soft * soft[:, None]


@inlined
def along_acceleration(grips, plant, x_ddot, along, ws):
    """a₁, m/s², for ẍ (3,); `along`: F₁, N."""
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    if grips is None:
        return c * x_ddot[0] + s * x_ddot[1] + plant.gravity * s
    total = along
    for i in range(len(plant.arms)):
        total += c * ws.grips.load[i, 0] + s * ws.grips.load[i, 1]
    return total / (mass_factor(plant.mass_change, ws) * plant.m)


@inlined
def axial_terms(plant, x_ddot, along, grip, ws, terms):
    """Fill N_L, a₁, ω² and F₁ (4,) for ẍ (3,), after `find_velocities`; `along`: F₁, N; grip (3,): `payload_force` of arm 0."""
    c, s, v = ws.arm.trig[0], ws.arm.trig[1], ws.velocity
    terms[ALONG] = along_acceleration(plant.grips, plant, x_ddot, along, ws)
    terms[SPIN], terms[HAND] = v[2] * v[2], along
    if len(plant.arms) == 1:
        terms[N_LEFT] = along - mass_factor(plant.mass_change, ws) * (plant.m * terms[ALONG])
        return
    total = 0.0
    for a in range(2):
        total -= (c if a == 0 else s) * grip[a]
    terms[N_LEFT] = total


@inlined
def axial_load_at(plant, terms, factor, s):
    """N(s), N, for `axial_terms`; at the hand, the force on its left. `factor`: s of `mass_change`, 1."""
    density, half = factor * (plant.m / plant.length), plant.length / 2
    load = terms[N_LEFT] + density * terms[ALONG] * (s + half) + density / 2 * terms[SPIN] * (half - s) * (half + s)
    if terms[HAND] != 0 and s > hand_of(plant.pull).position:
        load -= terms[HAND]
    return load


@inlined
def largest_compression(plant, terms, factor):
    """-min N(s) over the beam, N; 0 if all is in tension. N is concave in parts: its minimum is at an end or at the hand."""
    half = plant.length / 2
    least = min(axial_load_at(plant, terms, factor, -half), axial_load_at(plant, terms, factor, half))
    if terms[HAND] != 0:
        at = axial_load_at(plant, terms, factor, hand_of(plant.pull).position)
        least = min(least, at, at - terms[HAND])
    return max(0.0, -least)


@inlined
def first_stiffness(plant):
    """ω₁² of the beam with its grips held, 1/s²: at the spin ω₁ the linear beam has no stiffness left."""
    least = plant.modal[OMEGA2, 0]
    for k in range(plant.modal.shape[1]):
        least = min(least, plant.modal[OMEGA2, k])
    return least


@disjoint
def add_stiffness(G0, G1, G2, left, along, spin, eta, force):
    """force (n_f,) += (N_L G0 + a₁ G1 + ω² G2) η."""
    for j in range(len(eta)):
        # Row by row, no sum depends on another, and the loop is vectorised.
        a, b, c, of_left, of_along, of_spin = left * eta[j], along * eta[j], spin * eta[j], G0[j], G1[j], G2[j]
        for k in range(len(eta)):
            force[k] += a * of_left[k] + b * of_along[k] + c * of_spin[k]


@inlined
def geometric_force(axial, plant, terms, y, ws):
    """Fill ws.axial_force[NOW] with K_G η for `axial_terms`."""
    n, count, all_force = plant.modal.shape[1], axial.shape[1], ws.axial_force[NOW]
    eta, force = y[ETA : ETA + n], all_force
    if count < n:
        eta, force, i = ws.axial_force[GATHERED, :count], ws.axial_force[SCRATCH, :count], 0
        for k in range(n):
            if plant.modal[AXIAL, k] > 0:
                eta[i] = y[ETA + k]
                i += 1
    for k in range(count):
        force[k] = 0.0
    G0, G1, G2 = axial[0], axial[1], axial[2]
    factor = mass_factor(plant.mass_change, ws)
    add_stiffness(G0, G1, G2, terms[N_LEFT], factor * terms[ALONG], factor * terms[SPIN], eta, force)
    if terms[HAND] != 0:
        for j in range(count):
            pulled, G_F = terms[HAND] * eta[j], axial[HAND, j]
            for k in range(count):
                force[k] -= pulled * G_F[k]
    if count < n:
        i = 0
        for k in range(n):
            all_force[k] = 0.0
            if plant.modal[AXIAL, k] > 0:
                all_force[k] = force[i]
                i += 1


@inlined
def predict_acceleration(plant, followed, axial, u, y, ws):
    """Fill ws.axial_acceleration with ẍ (3,), after `find_state`; returns the axial force F₁ of a hand, N. Grips are rigid.

    Modes move with the link, except those `followed` (4, n_m), as `followed_loads`; u (arms, 3): inputs; `axial`: `Plant.axial`,
    whose force K_G η in ws.axial_force[NOW] acts on the modes; None: it is neglected.
    """
    c, s, w = ws.arm.trig[0], ws.arm.trig[1], ws.velocity[2]
    f1, f2, pull_turn = hand_load(plant, y, ws)
    h_force = g_force = eta_eta_dot = hh = hg = gg = 0.0
    weight, softer, factor = plant.gravity * c, w * w, mass_factor(plant.mass_change, ws)
    ease = 1 / factor
    for k in range(plant.modal.shape[1]):
        h, g, own_h, own_g = (
            plant.modal[H, k],
            plant.modal[G, k],
            followed[0, k],
            followed[1, k],
        )
        eta, rate = y[ETA + k], ws.eta_dot[k]
        eta_eta_dot += eta * rate
        force = (ease * plant.modal[OMEGA2, k] - softer) * eta - ease * (plant.modal[PULL, k] * f2) + h * weight
        if has_axial_load(axial):
            force += ease * ws.axial_force[NOW, k]
        h_force += own_h * force + ease * (followed[2, k] * rate)
        g_force += own_g * force + ease * (followed[3, k] * rate)
        h, g = h - own_h, g - own_g
        hh, hg, gg = hh + h * h, hg + h * g, gg + g * g
    hh, hg, gg = factor * hh, factor * hg, factor * gg
    S, given, x_ddot = ws.axial_inertia, ws.S, ws.axial_acceleration
    S[0, 0], S[1, 0], S[1, 1] = given[0, 0] + s * s * hh, given[1, 0] - s * c * hh, given[1, 1] + c * c * hh
    S[2, 0], S[2, 1], S[2, 2] = given[2, 0] - s * hg, given[2, 1] + c * hg, given[2, 2] + gg
    pose_load(plant, ws.w_bar[0], ws.beam_rate[0], eta_eta_dot, h_force, g_force, f1, f2, pull_turn, u, ws, x_ddot)
    solve_symmetric(S, x_ddot)
    return f1


@inlined
def axial_hand_force(grips, plant, y, ws):
    """F₁, N; fills ws.axial_acceleration with the ẍ in N. With compliant grips no ẍ is needed."""
    if grips is not None:
        along, _, _ = hand_load(plant, y, ws)
        return along
    return predict_acceleration(plant, plant.modal[FOLLOWED:], None, ws.u, y, ws)


@inlined
def find_axial_load(axial, plant, y, ws):
    """Fill ws.axial with `axial_terms`, and ws.axial_force[NOW] with K_G η, if there is any, after `find_state`."""
    if axial is None:
        return
    if axial.shape[1] == 0:
        return
    along, x_ddot, grip = axial_hand_force(plant.grips, plant, y, ws), ws.axial_acceleration, ws.momentum
    payload_force(plant.grips, 0, ws.u, x_ddot, ws, grip)
    axial_terms(plant, x_ddot, along, grip, ws, ws.axial)
    geometric_force(axial, plant, ws.axial, y, ws)
