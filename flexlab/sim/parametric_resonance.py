"""Parametric resonance of etdrk4's steps with a nearly undamped beam in arms that give way: how fast it makes errors grow.

The beam is propagated exactly, the motion of its grips is not. If step times frequency of two modes add up to a multiple of 2π,
or differ by one, each step excites both in phase and they grow without bound. Strong resonances are narrow: a step a few per
cent shorter avoids them. Avoiding all of them takes half the step, or a third.
"""

import math
from collections.abc import Callable

import numpy as np

from flexlab.numerics.eigenvalues import power_sizes
from flexlab.numerics.elementary import sin_cos
from flexlab.numerics.linear_algebra import product, solve
from flexlab.numerics.matrix_functions import doubled, doublings_to, phi_functions
from flexlab.physics.plant import G
from flexlab.sim.build import Beam
from flexlab.sim.closed_loop import System, scratch_workspace
from flexlab.sim.step_rates import Rates, largest_ratios_at
from flexlab.sim.step_size import Count

STEADY_GROWTH = 0.1
"""Growth rate that counts as none, 1/s: in a minute, errors of 1e-10 stay below 1e-7."""
SPAN = 32.0
"""Time over which growth is measured, s: beats between modes then count for no more than 0.02 1/s."""
RESOLVING = 2.0
"""Step times the fastest rate of the beam below which no two modes can resonate."""
UNRESOLVED, BARELY_DAMPED = 1.0, 100.0
"""A mode may grow if step times frequency exceeds the first number and its decay rate, 1/s, is below the second: resonances
grow at a few hundred 1/s at most, and need both modes of a pair."""
SHORTER = (1.0, 1.03, 1.06, 1.09, 1.13, 1.16, 1.5, 2.0, 3.0)
"""Factors by which the steps that are tried are shorter than the one asked for."""
MANY_MODES, FEW_TRIES = 64, 2
"""Number of modes from which on one growth rate takes tens of milliseconds, and how many steps are then tried: somebody who drags
a slider waits for them."""


def may_resonate(beam: Beam, rates: Rates, dt: float) -> bool:
    """Whether errors of steps dt, s, can grow at all; `growth_rate` tells whether they do."""
    if dt * rates.beam < RESOLVING:
        return False
    barely = beam.modes.D.diagonal() < 2 * BARELY_DAMPED
    return bool(np.any(barely & (beam.modes.omega * dt > UNRESOLVED)))


def steadiest(
    system: System, beam: Beam, rates: Rates, pose: np.ndarray, asked: Count, counted: Callable[[float], Count]
) -> Count:
    """The longest step whose errors do not grow: the one `asked` for, or a shorter one that `counted` fits into the periods.

    If all grow, the one with the slowest growth. `pose` (3,): as of `growth_rate`.
    """
    found: dict[Count, float] = {}
    for factor in SHORTER[: FEW_TRIES if len(beam.modes.omega) >= MANY_MODES else None]:
        now = counted(asked.step / factor)
        if now not in found:
            found[now] = growth_rate(system, beam, rates, pose, now.step)
        if not found[now] > STEADY_GROWTH:
            return now
    return min(found, key=lambda count: found[count])


def growth_rate(system: System, beam: Beam, rates: Rates, pose: np.ndarray, dt: float) -> float:
    """Rate at which errors of steps dt grow at rest at a pose (3,), 1/s; -inf at a pose that the arms cannot take."""
    ws, taken = scratch_workspace(system), np.zeros(1)
    largest_ratios_at(system.plant, pose[None], rates.forms[:1], ws, taken)  # This leaves the inertia S in ws.
    if taken[0] <= 0:
        return -math.inf
    return _growth(beam, _loads(system, float(pose[2])), ws.S, dt)


def _loads(system: System, theta: float) -> np.ndarray:
    """Force on the pose by unit accelerations of the modes, (3, n_m)."""
    h, g = system.plant.modal[: G + 1]
    sine, cosine = sin_cos(theta)
    return np.stack([-sine * h, cosine * h, g])


def _growth(beam: Beam, C: np.ndarray, S: np.ndarray, dt: float) -> float:
    """As `growth_rate`, with the modes' loads C (3, n_m) on the inertia S (3, 3)."""
    step = one_step(beam.modes.omega, beam.modes.D.diagonal(), C, S, dt)
    doublings = max(1, doublings_to(SPAN, dt))
    half, size = power_sizes(step, doublings)
    return (size - half) / (dt * 2.0 ** (doublings - 1))


def one_step(omega: np.ndarray, damping: np.ndarray, C: np.ndarray, S: np.ndarray, dt: float) -> np.ndarray:
    """The matrix of one step of etdrk4 on (ωη, π), (2 n_m, 2 n_m), by the formulas of `integrators.etdrk4`."""
    n = len(omega)
    z = np.zeros((n, 2, 2))
    z[:, 0, 1], z[:, 1, 0], z[:, 1, 1] = omega * dt, -omega * dt, -damping * dt
    half, whole = _phi_of_half_and_whole(z)
    force = np.concatenate([C * omega, C * damping], axis=1)
    answer = np.concatenate([np.zeros((n, 3)), solve(S, C).T])

    def rest(x: np.ndarray) -> np.ndarray:
        return dt * -product(answer, product(force, x))

    start = np.eye(2 * n)
    N1 = rest(start)
    a = half[0](start) + half[1](N1) / 2
    N2 = rest(a)
    N3 = rest(a + half[2](N2 - N1))
    free = whole[0](start) + whole[1](N1)
    N4 = rest(free + 2 * whole[2](N3 - N1))
    return free + whole[2](-3 * N1 + 2 * N2 + 2 * N3 - N4) + 4 * whole[3](N1 - N2 - N3 + N4)


Apply = Callable[[np.ndarray], np.ndarray]


def _phi_of_half_and_whole(z: np.ndarray) -> tuple[list[Apply], list[Apply]]:
    """φ0 to φ3 of z/2 and of z, (n_m, 2, 2), as functions of matrices (2 n_m, m)."""
    found = phi_functions(z / 2)[0]

    def applied(F: np.ndarray) -> Apply:
        def apply(x: np.ndarray) -> np.ndarray:
            top, bottom = np.split(x, 2)
            (tt, tb), (bt, bb) = F.transpose(1, 2, 0)[..., None]
            return np.concatenate([tt * top + tb * bottom, bt * top + bb * bottom])

        return apply

    return [applied(F) for F in found], [applied(F) for F in doubled(*found)]
