"""A payload that is filled or emptied, against mass points as heavy as they are at each instant, and against closed forms."""

from collections.abc import Iterator

import numpy as np

from flexlab.analysis.validation.check import (
    DAMPING,
    FINE,
    STILL,
    Check,
    Runs,
    above,
    alike,
    balanced,
    below,
    close,
    general,
    run_of,
    same_internal_force,
    subject,
)
from flexlab.analysis.validation.mass_points import MassPoints, coordinates, residual_force, time_derivative
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, Pull
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

FILLED, EMPTIED, BEGIN, DURATION = 3.0, 0.3, 0.05, 0.2
"""μ of two runs; when the change begins and how long it takes, s."""
LIGHT = 1e-7
"""Mass of links whose inertia does not count, kg."""
KNOWN, SPRINGS, DAMPERS = 0.4, (2e3, 2e3, 1e3), (200.0, 200.0, 100.0)
"""Share of the change that a law knows; its K_p, N/m, N·m/rad, and K_d, N·s/m, N·m·s/rad."""
SPEED, STIFFNESS, AHEAD = 0.3, 2.0, 0.9
"""Speed of a coasting payload, m/s; stiffness, N/m, and place, m, of a hand that pulls one."""


@subject("A payload that is filled or emptied", 13)
def mass_change(runs: Runs) -> Iterator[Check]:
    """Lagrange's equations with the momentum that material brings, energy, the motion after the change, closed forms."""
    yield from _along_a_motion()
    for factor in (FILLED, EMPTIED):
        run = run_of("the run with another mass", {**_change(factor), "gravity": 9.81}, 0.4, 0.001)
        statement = "energy gained = work - energy damped + energy that material brought, as a part of what moved"
        yield balanced(f"mass × {factor:g}: {statement}", run)
        yield from _afterwards(factor)
        yield from _free(factor)
        yield from _hanging(factor)


def _change(factor: float) -> dict[str, object]:
    """The fields that change the payload's mass by this factor."""
    return {"payload.mass_change": {"factor": factor, "begin": BEGIN, "duration": DURATION}}


def mass_ratio(time: np.ndarray, factor: float, begin: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """s and ṡ of 10u³ - 15u⁴ + 6u⁵, 1 and 1/s, (N,) each."""
    ramp = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    u = np.clip((time - begin) / duration, 0.0, 1.0)
    return 1 + (factor - 1) * ramp(u), (factor - 1) * ramp.deriv()(u) / duration


def _along_a_motion() -> Iterator[Check]:
    """A run of `general` in the middle of a fast change, against mass points that get heavier."""
    begin, duration = 0.0, 0.01
    change = {"factor": FILLED, "begin": begin, "duration": duration}
    run = general("the general run with another mass", {"payload.mass_change": change})
    points = MassPoints(run.scenario)
    s, s_dot = mass_ratio(run.time, FILLED, begin, duration)
    yield alike(
        "the payload weighs ρL (1 + (μ - 1)(10u³ - 15u⁴ + 6u⁵)): relative error", 1e-14, run.own["payload_mass"], s
    )
    heavy = [points.filled(factor) for factor in s]
    p, rate, rows = coordinates(run)
    yield above("mass that has joined by the end, as a part of that at the start", 0.2, s[-1] - 1)
    energy = [0.5 * rate[k] @ heavy[k].inertia(p[k]) @ rate[k] + heavy[k].potential(p[k]) for k in rows]
    yield alike(
        "T + V is that of points as heavy as they are then: relative error", 1e-10, run.total_energy[rows], energy
    )

    def force(k: int) -> np.ndarray:
        brought = s_dot[k] * points.payload_inertia(p[k]) @ rate[k]
        return brought + np.concatenate([run.arm_input[k].sum(axis=0), -DAMPING * rate[k, 3:]])

    error = residual_force(run, lambda k: (heavy[k].inertia, heavy[k].potential), force)
    statement = "Lagrange's equations with the momentum ṡ A v that material brings, for x0, y0, θ: relative residual"
    yield below(statement, 1e-6, error[:3].max())
    yield below("and for the beam's q: relative residual", 1e-6, error[3:].max())
    changed, told = time_derivative(run.pose_rate, FINE), run.pose_acceleration
    yield alike("the sampled ẍ is the change of ẋ: relative error", 1e-6, changed, told[2:-2], told)
    statement = "internal force, by Eq. (26) and by Eqs. (13)-(15): largest difference, as a part"
    yield same_internal_force(statement, run)


def _afterwards(factor: float) -> Iterator[Check]:
    """After the change the motion is that of a payload which always had the new density."""
    still = {"simulation.integrator": "rk4", "simulation.step": 1e-5, "gravity": 9.81}
    one, other = (World(load_preset("paper").replace({**_change(factor), **still})) for _ in range(2))
    one.advance(300)
    other.advance(300)
    denser = {
        "payload.mass_change.factor": 1.0,
        "payload.linear_density": factor * other.scenario.payload.linear_density,
        "controller.model.linear_density_factor": 1 / factor,
    }
    other.apply(ChangeScenario(denser))
    changed, always = one.advance(300), other.advance(300)
    statement = f"mass × {factor:g}, 0.3 s after its change: pose beside that of a payload of that density, m or rad"
    yield below(statement, 1e-10, changed.pose - always.pose)
    yield alike("and the deflection, as a part", 1e-7, changed.midspan_deflection, always.midspan_deflection)


def _free(factor: float) -> Iterator[Check]:
    """A payload between weightless arms with motors off, coasting and pulled."""
    coasting, pulled = _light_run(factor, SPEED, 0.0), _light_run(factor, 0.0, STIFFNESS)
    statement = f"mass × {factor:g}: a payload that coasts between weightless arms keeps its velocity, as a part"
    yield below(statement, 1e-5, coasting.pose_rate[:, 0] / SPEED - 1)
    force = STIFFNESS * (AHEAD - pulled.pose[:, 0])
    s, _ = mass_ratio(pulled.time, factor, BEGIN, DURATION)
    rate = force / s
    # Simpson's rule: the change begins and ends on samples.
    pairs = (rate[:-2:2] + 4 * rate[1:-1:2] + rate[2::2]) * (pulled.time[2::2] - pulled.time[:-2:2]) / 6
    statement = f"mass × {factor:g}: pulled by F, it has gained v = ∫F/(s m) dt"
    yield close(statement, float(pairs.sum()), float(pulled.pose_rate[-1, 0]), "m/s", 1e-5)


def _hanging(factor: float) -> Iterator[Check]:
    """A payload that pd holds against a weight of which it knows a part."""
    law = {"kind": "pd", "position_gain": SPRINGS, "velocity_gain": DAMPERS, "model": {"mass_change_factor": KNOWN}}
    changes = {**STILL, "gravity": 9.81, "controller": law, **_change(factor)}
    run = World(load_preset("paper").replace(changes)).run(3000)
    statement = f"of which the law knows {KNOWN:g} of the change: pd hangs by (1 - {KNOWN:g})(μ - 1) m g/K_p"
    exact, found = -(1 - KNOWN) * (factor - 1) * 9.81 / SPRINGS[1], float(run.tracking_error[-1, 1])
    yield close(f"mass × {factor:g}, {statement}", exact, found, "m", 1e-6)


def _light_run(factor: float, speed: float, stiffness: float) -> Samples:
    """0.4 s of the paper's payload in arms whose links weigh `LIGHT`, along x; `stiffness`: of a hand at its middle, N/m."""
    arms = {f"{side}_arm.link_mass": (LIGHT,) * 3 for side in ("left", "right")}
    still = {"controller.kind": "none", "initial.pose": (0.0, 0.75, 0.0), "initial.pose_rate": (speed, 0.0, 0.0)}
    world = World(load_preset("paper").replace({**_change(factor), **arms, **still}))
    if stiffness:
        world.apply(Pull(0.0, (AHEAD, 0.75), stiffness))
    return world.run(400)
