"""A payload that is filled or emptied: mass points at each instant, energy, the motion afterwards, closed forms."""

from collections.abc import Iterator

import numpy as np
from scipy.integrate import simpson

from flexlab.analysis.paper_equations import tracking_energy
from flexlab.analysis.validation.beam import GAUGES
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
from flexlab.analysis.validation.mass_points import (
    MassPoints,
    coordinates,
    jacobian,
    mass_ratio,
    residual_force,
    time_derivative,
)
from flexlab.analysis.validation.paper import desired
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

FILLED, EMPTIED, BEGIN, DURATION = 3.0, 0.3, 0.05, 0.2
"""μ of two runs; when the change begins and how long it takes, s."""
HELD = Pull(-0.1, (0.9, 0.7), 900.0)
"""The hand that holds a beam while it is filled, within an element, and presses its part on the right."""
LIMP = 5.0
"""Bending stiffness of that beam, all of whose modes feel the force along it, N·m²."""
KNOCK = Tap(0.1, (0.4, -0.3))
LIGHT = 1e-7
"""Mass of links whose inertia is negligible, kg."""
KNOWN, SPRINGS, RATE_GAINS = 0.4, (2e3, 2e3, 1e3), (200.0, 200.0, 100.0)
"""Share of the change that a law knows; its K_p, N/m, N·m/rad, and K_d, N·s/m, N·m·s/rad."""
SPEED, PULL, AHEAD = 0.3, 2.0, 0.9
"""Speed of a coasting payload, m/s; stiffness, N/m, and position, m, of a hand that pulls one."""


@subject("A payload that is filled or emptied", 14)
def mass_change(runs: Runs) -> Iterator[Check]:
    """Lagrange's equations with the momentum that material brings, energy, the motion after the change, closed forms."""
    yield from _filling_motion()
    yield from _held_motion()
    for factor in (FILLED, EMPTIED):
        run = run_of("the run with another mass", {**_change(factor), "gravity": 9.81}, 0.4, 0.001)
        statement = "energy gained = work - energy damped + energy that material brought, as a part of what moved"
        yield balanced(f"mass × {factor:g}: {statement}", run)
        yield from _afterwards(factor)
        yield from _free(factor)
        yield from _hanging(factor)


def _change(factor: float) -> dict[str, object]:
    return {"payload.mass_change": {"factor": factor, "begin": BEGIN, "duration": DURATION}}


def _filling_motion() -> Iterator[Check]:
    """A run of `general` in the middle of a fast change, against mass points that get heavier."""
    begin, duration = 0.0, 0.01
    change = {"factor": FILLED, "begin": begin, "duration": duration}
    run = general("the general run with another mass", {"payload.mass_change": change})
    points = MassPoints(run.scenario)
    s, s_dot = mass_ratio(run.time, FILLED, begin, duration)
    statement = "the payload weighs ρL (1 + (μ - 1)(10u³ - 15u⁴ + 6u⁵)): relative error"
    yield alike(statement, 1e-14, run.own["payload_mass"], s)
    heavy = [points.filled(factor) for factor in s]
    p, rate, rows = coordinates(run)
    yield above("mass that has joined by the end, as a part of that at the start", 0.2, s[-1] - 1)
    energy = [0.5 * rate[k] @ heavy[k].inertia(p[k]) @ rate[k] + heavy[k].potential(p[k]) for k in rows]
    statement = "T + V is that of points as heavy as they are then: relative error"
    yield alike(statement, 1e-10, run.total_energy[rows], energy)

    def force(k: int) -> np.ndarray:
        brought = s_dot[k] * points.payload_inertia(p[k]) @ rate[k]
        return brought + np.concatenate([run.arm_input[k].sum(axis=0), -DAMPING * rate[k, 3:]])

    error = residual_force(run, lambda k: (heavy[k].inertia, heavy[k].potential), force)
    statement = "Lagrange's equations with the momentum ṡ A v that material brings, for x0, y0, θ: relative residual"
    yield below(statement, 1e-6, error[:3].max())
    yield below("and for the beam's q: relative residual", 1e-6, error[3:].max())
    changed, told = time_derivative(run.pose_rate, FINE), run.pose_acceleration
    yield alike("the sampled ẍ is the change of ẋ: relative error", 1e-6, changed, told[2:-2], told)
    told, s_run = tracking_energy(run.scenario, run)[rows], run.sliding_variable
    arms = [sum(points.arm_inertia(run.pose[k], arm) for arm in range(2)) for k in rows]
    exact = [
        0.5 * s_run[k] @ (whole + s[k] * points.rigid_inertia(run.pose[k])) @ s_run[k]
        for k, whole in zip(rows, arms, strict=True)
    ]
    yield alike("½ sᵀM̄s as the lab draws it, with the present mass: relative error", 1e-9, told, exact)
    statement = "internal force, by Eq. (26) and by Eqs. (13)-(15): largest difference, as a part"
    yield same_internal_force(statement, run)


def _held_motion() -> Iterator[Check]:
    """A soft beam that is filled, held by a hand, and feels the force along it."""
    begin, duration = 0.0, 0.01
    change = {"factor": FILLED, "begin": begin, "duration": duration}
    soft = {"payload.bending_stiffness": LIMP, "payload.axial_load": "first-order", "payload.mass_change": change}
    run = general("the general run of a held beam", soft, [(0.0, HELD)])
    s, s_dot = mass_ratio(run.time, FILLED, begin, duration)
    points = MassPoints(run.scenario, HELD)
    heavy, half = [points.filled(factor) for factor in s], run.scenario.payload.length / 2
    p, rate, rows = coordinates(run)

    def force(k: int) -> np.ndarray:
        brought = s_dot[k] * points.payload_inertia(p[k]) @ rate[k]
        on_beam = DAMPING * rate[k, 3:] + heavy[k].axial_stiffness(run, k) @ p[k, 3:]
        return brought + np.concatenate([run.arm_input[k].sum(axis=0), -on_beam])

    error = residual_force(run, lambda k: (heavy[k].inertia, heavy[k].potential), force)
    statement = "a beam that is filled, held at its side and feels the force along it: Lagrange's equations"
    yield below(f"{statement}: relative residual", 1e-6, error.max())
    changed, told = time_derivative(run.pose_rate, FINE), run.pose_acceleration
    yield alike("the sampled ẍ is the change of ẋ: relative error", 1e-6, changed, told[2:-2], told)
    places = np.array([*half * 2 * np.array(GAUGES), -half, HELD.position, HELD.position + 1e-12, half])
    along = np.array([heavy[k].axial_force(run, k, run.pose_acceleration[k], places) for k in rows])
    yield alike("N(s) at the gauges, with a step at the hand: relative error", 1e-9, run.axial_load[rows], along[:, :4])
    pressed = np.maximum(0.0, -along.min(axis=1)) / (np.pi**2 * LIMP / (2 * half) ** 2)
    yield alike("its largest compression over π²EI/L²: relative error", 1e-9, run.axial_load_share[rows], pressed)
    softest = s[rows] * run.pose_rate[rows, 2] ** 2 / points.softest()
    yield alike("and ω²/ω₁² of the present mass: relative error", 1e-9, run.spin_share[rows], softest)
    goals = [desired(run.time[k : k + 1], run.scenario.trajectory) for k in rows]
    static = [heavy[k].static_deflection(goal[0], change[0]) for k, (goal, _, change) in zip(rows, goals, strict=True)]
    yield alike("and its quasi-static deflection: relative error", 1e-9, run.quasi_static_deflection[rows], static)
    yield _tapped(World(run.scenario, FINE))


def _tapped(world: World) -> Check:
    """A tap on a bent beam that is being filled: the rates that an impulse gives to mass points, with the one along the beam."""
    before = world.run(100).take(slice(-1, None))
    world.apply(KNOCK)
    after = world.observe()
    s, _ = mass_ratio(before.time, FILLED, 0.0, 0.01)
    points = MassPoints(world.scenario, Pull(KNOCK.beam_position, (0.0, 0.0), 0.0)).filled(float(s[0]))
    p = np.concatenate([before.pose[0], before.beam_coordinates[0]])
    c, sine, length = np.cos(p[2]), np.sin(p[2]), world.scenario.payload.length
    impulse = np.array(KNOCK.impulse) @ jacobian(lambda at: points.beam_point(at, KNOCK.beam_position), p)
    gained = np.concatenate([after.pose_rate - before.pose_rate, after.beam_rates - before.beam_rates], axis=1)[0]
    # The impulse of N(s): what the left arm takes, what the points gain from the left end to s, and the tap's from there on.
    rigid = np.linalg.solve(points.inertia(p), impulse)[:3]
    left = points.arm_inertia(p[:3], 0) @ rigid
    line = left[:2] @ [c, sine] + points.density * (rigid[:2] @ [c, sine]) * (points.places + length / 2)
    line -= np.where(points.places > KNOCK.beam_position, np.array(KNOCK.impulse) @ [c, sine], 0.0)
    impulse[3:] -= points.geometric_stiffness(line) @ p[3:]
    statement = "a tap on it gives the rates of mass points, with the impulse along the beam: relative error"
    return alike(statement, 1e-9, gained, np.linalg.solve(points.inertia(p), impulse))


def _afterwards(factor: float) -> Iterator[Check]:
    """After the change, the motion is that of a payload that always had the new density."""
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
    coasting, pulled = _light_run(factor, SPEED, 0.0), _light_run(factor, 0.0, PULL)
    statement = f"mass × {factor:g}: a payload that coasts between weightless arms keeps its velocity, as a part"
    yield below(statement, 1e-5, coasting.pose_rate[:, 0] / SPEED - 1)
    force = PULL * (AHEAD - pulled.pose[:, 0])
    s, _ = mass_ratio(pulled.time, factor, BEGIN, DURATION)
    gained = float(simpson(force / s, x=pulled.time))  # The change begins and ends on samples.
    statement = f"mass × {factor:g}: pulled by F, it has gained v = ∫F/(s m) dt"
    yield close(statement, gained, float(pulled.pose_rate[-1, 0]), "m/s", 1e-5)


def _hanging(factor: float) -> Iterator[Check]:
    """A payload that pd holds against a weight of which pd knows only a part; under a clock if it gets heavier."""
    law = {"kind": "pd", "position_gain": SPRINGS, "velocity_gain": RATE_GAINS, "model": {"mass_change_factor": KNOWN}}
    law |= {"control_period": 0.001} if factor > 1 else {}
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
