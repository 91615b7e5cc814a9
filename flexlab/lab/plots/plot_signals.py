"""Which signals the plots show over time, in which units, on which tab.

The other part, ½ Σ k_j (b_j - b̂_j)², holds the true bounds b_j, which nobody knows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexlab import views
from flexlab.control.law import BOUND_ESTIMATES, law_of
from flexlab.lab import colors
from flexlab.lapack import one_blas_thread
from flexlab.scenario import Arm, Payload, Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.samples import Samples
from flexlab.views import MILLI, View

MASS = "payload_mass"
"""Signal of a payload whose mass changes."""


def tracking_energy(scenario: Scenario, samples: Samples) -> np.ndarray:
    """½ sᵀ(M̄1 + M̄2 + A11 - A12 A22⁻¹A21)s with A at q = 0, J (N,)."""
    s, angle = samples.sliding_variable, samples.pose[:, 2]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    total = _payload(scenario, s, across)
    if MASS in samples.own:  # All of the payload's part grows with it.
        total *= samples.own[MASS] / _inertia(scenario.payload)[0]  # pyright: ignore[reportArgumentType]
    half = 0.5 * scenario.payload.length
    for index, arm in enumerate(scenario.arms):
        side = -1 if index == 0 else 1
        grip_rate = s[:, :2] + side * half * s[:, 2:] * across
        total += _arm(arm, samples.joint_angle[:, index], grip_rate, s[:, 2])
    return total


@lru_cache(maxsize=8)
def _inertia(payload: Payload) -> tuple[float, ...]:
    """m, I, hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g: found once per payload."""
    with one_blas_thread():
        beam = build_beam(payload)
    return float(beam.matrices.m), float(beam.matrices.I), *map(float, beam.kappa)


def _payload(scenario: Scenario, s: np.ndarray, across: np.ndarray) -> np.ndarray:
    m, inertia, hh, hg, gg = _inertia(scenario.payload)  # pyright: ignore[reportArgumentType]
    lateral = np.einsum("ni,ni->n", s[:, :2], across)
    rigid = m * (s[:, 0] ** 2 + s[:, 1] ** 2) + inertia * s[:, 2] ** 2
    return 0.5 * (rigid - hh * lateral**2 - 2 * hg * lateral * s[:, 2] - gg * s[:, 2] ** 2)


def _arm(arm: Arm, joint_angle: np.ndarray, grip_rate: np.ndarray, turn_rate: np.ndarray) -> np.ndarray:
    """½ θ̇ᵀMθ̇ of one arm whose grip moves with `grip_rate` (N, 2) m/s and turns with `turn_rate` (N,) rad/s."""
    angle = np.cumsum(joint_angle, axis=1)
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=2)
    l1, l2, l3 = arm.link_length
    wrist = grip_rate - l3 * turn_rate[:, None] * normal[:, 2]
    # wrist = l1 φ̇1 n1 + l2 φ̇2 n2, solved by hand: the library's solver wakes all cores for it.
    elbow = normal[:, 0, 0] * normal[:, 1, 1] - normal[:, 0, 1] * normal[:, 1, 0]
    first = (wrist[:, 0] * normal[:, 1, 1] - wrist[:, 1] * normal[:, 1, 0]) / (l1 * elbow)
    second = (normal[:, 0, 0] * wrist[:, 1] - normal[:, 0, 1] * wrist[:, 0]) / (l2 * elbow)
    rate = np.column_stack([first, second, turn_rate])
    joint = np.zeros_like(wrist)
    energy = np.zeros(len(wrist))
    for link in range(3):
        center = joint + arm.link_center[link] * rate[:, link, None] * normal[:, link]
        energy += arm.link_mass[link] * np.einsum("ni,ni->n", center, center)
        energy += arm.inertia[link] * rate[:, link] ** 2
        joint = joint + arm.link_length[link] * rate[:, link, None] * normal[:, link]
    return 0.5 * energy


@dataclass(frozen=True)
class Limit:
    """A level that means something: drawn as two dashed lines at ± `value` (plot units)."""

    label: str
    value: float
    tone: colors.Color


Limits = Callable[[Scenario], tuple[Limit, ...]]


@dataclass(frozen=True)
class Plot:
    """One plot over time: `labels` with units, one per signal; `values` gives (signals, N) in those units."""

    title: str
    labels: tuple[str, ...]
    values: Callable[[Scenario, Samples], np.ndarray]
    least: float
    """The smallest vertical range, in the plot's units."""
    limits: Limits
    note: str
    """A sentence below the plot."""
    tones: tuple[colors.Color, ...]
    """A colour for each signal."""


def _plot(view: View, *shown: int, title: str = "", limits: Limits = lambda _: (), note: str = "") -> Plot:
    """A view's curves, or those of the numbers `shown`, under its title or another one."""
    chosen = list(shown or range(len(view.curves)))
    curves = [view.curves[k].removeprefix("left ").removeprefix("right ") for k in chosen]
    labels = tuple(f"{curve} ({view.units[k]})" for curve, k in zip(curves, chosen, strict=True))
    tones = tuple(view.colors[k] for k in chosen)
    return Plot(
        title or view.title, labels, lambda _, samples: view.values(samples).T[chosen], view.least, limits, note, tones
    )


def _torque_limits(tones: Sequence[colors.Color]) -> Limits:
    """The levels of an arm's joints, in the colours of its curves."""

    def limits(scenario: Scenario) -> tuple[Limit, ...]:
        levels = zip(scenario.controller.torque_limit or (), tones, strict=False)
        return tuple(Limit(f"limit {k} (N·m)", value, tone) for k, (value, tone) in enumerate(levels, 1))

    return limits


def _wanted_force(scenario: Scenario) -> tuple[Limit, ...]:
    force = abs(scenario.controller.wanted_internal_force)
    return (Limit("wanted F_d (N)", force, colors.GRAY),) if force else ()


def _law_limits(view: View) -> Limits:
    """The levels that the control law knows for a signal."""

    def limits(scenario: Scenario) -> tuple[Limit, ...]:
        levels = law_of(scenario.controller).limits(scenario.controller).get(view.signals[0].name, {})
        return tuple(Limit(label, value, colors.GRAY) for label, value in levels.items())

    return limits


LYAPUNOV = Plot(
    "Lyapunov function, tracking part ½ sᵀM̄s",
    ("V (mJ)",),
    lambda scenario, samples: MILLI * tracking_energy(scenario, samples)[None],
    0.1,
    lambda _: (),
    "The proof's whole function adds ½ Σ kⱼ (bⱼ − b̂ⱼ)²: what the estimates still lack. Nobody knows the true "
    "bounds bⱼ, so that part cannot be drawn.",
    (colors.VIOLET,),
)
LOAD_NOTE = "At 100 % of compression this beam buckles; at 100 % of spin the paper's beam has no stiffness left."


def tabs(scenario: Scenario) -> dict[str, tuple[Plot, ...]]:
    """Tab name → its plots over time, for the arms that are there."""
    torque = views.TORQUES[len(scenario.arms) - 1]
    torques = [
        _plot(
            torque,
            *joints,
            title=f"Joint torques, {name} arm",
            limits=_torque_limits([torque.colors[k] for k in joints]),
        )
        for name, joints in zip(("left", "right")[: len(scenario.arms)], (range(3), range(3, 6)), strict=False)
    ]
    estimates = [_plot(views.ESTIMATES)] if BOUND_ESTIMATES in law_of(scenario.controller).memory else []
    own = [_plot(view, limits=_law_limits(view)) for view in views.own_views(scenario)]
    return {
        "Motion": (
            _plot(views.ERROR),
            _plot(views.DEFLECTION, 0, 2),
            _plot(views.INTERNAL_FORCE, limits=_wanted_force),
        ),
        "Torques": (*torques, _plot(views.AXIAL_SHARE, note=LOAD_NOTE)),
        "Control": (_plot(views.SLIDING, limits=_law_limits(views.SLIDING)), *estimates, *own),
        "Energy": (_plot(views.ENERGIES, 0, 2, 3), _plot(views.ELASTIC), LYAPUNOV),
    }
