"""The signals that the plots show over time, with their units and tabs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flexlab import views
from flexlab.analysis.paper_equations import tracking_energy
from flexlab.control.law import BOUND_ESTIMATES, law_of
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.views import GRAY, MILLI, VIOLET, Color, View


@dataclass(frozen=True)
class Limit:
    """A level with a meaning, drawn as two dashed lines at ± `value` (plot units)."""

    label: str
    value: float
    tone: Color


@dataclass(frozen=True)
class Plot:
    """One plot over time: `labels` with units, one per signal; `values` returns (signals, N) in those units."""

    title: str
    labels: tuple[str, ...]
    values: Callable[[Scenario, Samples], np.ndarray]
    least: float
    """The smallest vertical range, in the plot's units."""
    tones: tuple[Color, ...]
    """A colour for each signal."""
    limits: tuple[Limit, ...] = ()
    note: str = ""
    """A sentence below the plot."""


def _plot(view: View, *shown: int, title: str = "", limits: tuple[Limit, ...] = (), note: str = "") -> Plot:
    """A plot of a view's curves, or of those with the indices `shown`, under its title or another one."""
    chosen = list(shown or range(len(view.curves)))
    curves = [view.curves[k].removeprefix("left ").removeprefix("right ") for k in chosen]
    labels = tuple(f"{curve} ({view.units[k]})" for curve, k in zip(curves, chosen, strict=True))
    tones = tuple(view.colors[k] for k in chosen)
    return Plot(
        title or view.title, labels, lambda _, samples: view.values(samples).T[chosen], view.least, tones, limits, note
    )


def _torque_limits(scenario: Scenario, tones: Sequence[Color]) -> tuple[Limit, ...]:
    """The torque limits of an arm's joints, in the colours of its curves."""
    levels = zip(scenario.controller.torque_limit or (), tones, strict=False)
    return tuple(Limit(f"limit {k} (N·m)", value, tone) for k, (value, tone) in enumerate(levels, 1))


def _law_limits(scenario: Scenario, view: View) -> tuple[Limit, ...]:
    """The levels that the control law knows for a signal."""
    levels = law_of(scenario.controller).limits(scenario.controller).get(view.signals[0].name, {})
    return tuple(Limit(label, value, GRAY) for label, value in levels.items())


LYAPUNOV = Plot(
    "Lyapunov function, tracking part ½ sᵀM̄s",
    ("V (mJ)",),
    lambda scenario, samples: MILLI * tracking_energy(scenario, samples)[None],
    0.1,
    (VIOLET,),
    note="The proof's full function adds ½ Σ kⱼ (bⱼ − b̂ⱼ)²: what the estimates still lack. Nobody knows the true "
    "bounds bⱼ, so that part cannot be drawn.",
)
LOAD_NOTE = "At 100 % of compression this beam buckles; at 100 % of spin the paper's beam has no stiffness left."


def tabs(scenario: Scenario) -> dict[str, tuple[Plot, ...]]:
    """Tab name → its plots over time, for the scenario's arms."""
    torque = views.TORQUES[len(scenario.arms) - 1]
    torques = [
        _plot(
            torque,
            *joints,
            title=f"Joint torques, {name} arm",
            limits=_torque_limits(scenario, [torque.colors[k] for k in joints]),
        )
        for name, joints in zip(("left", "right")[: len(scenario.arms)], (range(3), range(3, 6)), strict=False)
    ]
    force = abs(scenario.controller.wanted_internal_force)
    wanted = (Limit("wanted F_d (N)", force, GRAY),) if force else ()
    estimates = [_plot(views.ESTIMATES)] if BOUND_ESTIMATES in law_of(scenario.controller).memory else []
    own = [_plot(view, limits=_law_limits(scenario, view)) for view in views.own_views(scenario)]
    return {
        "Motion": (
            _plot(views.ERROR),
            _plot(views.DEFLECTION, 0, 2),
            _plot(views.INTERNAL_FORCE, limits=wanted),
        ),
        "Torques": (*torques, _plot(views.AXIAL_SHARE, note=LOAD_NOTE)),
        "Control": (_plot(views.SLIDING, limits=_law_limits(scenario, views.SLIDING)), *estimates, *own),
        "Energy": (_plot(views.ENERGIES, 0, 2, 3), _plot(views.ELASTIC), LYAPUNOV),
    }
