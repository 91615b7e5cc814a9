"""Every control law by its equation, with arms and payload made of mass points, along a general motion.

The controller has a wrong model of the payload and of how it is filled, shares the load unevenly and squeezes it, so that each
of these effects counts.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from flexlab.analysis.lesson_measures import bound_terms
from flexlab.analysis.validation.check import EVERY, FINE, Check, Runs, alike, below, general, subject
from flexlab.analysis.validation.mass_points import MassPoints, mass_ratio, slopes, time_derivative
from flexlab.analysis.validation.paper import desired
from flexlab.sim.samples import Run

FILLING = {"factor": 2.0, "begin": 0.0, "duration": 0.01}
"""The payload's mass doubles while the laws are compared; factor 1, times in s."""
COMMON = {
    "payload.mass_change": FILLING,
    "controller.model.mass_change_factor": 0.6,
    "controller.model.linear_density_factor": 1.3,
    "controller.model.length_factor": 0.9,
    "controller.load_share": 0.3,
    "controller.wanted_internal_force": 15.0,
}
SLOPED = {"sliding_slope": (50.0, 40.0, 60.0)}
DRIVEN = SLOPED | {"feedback_gain": (200.0, 150.0, 90.0)}
ADAPTED = DRIVEN | {"adaptation": (10.0, 20.0, 40.0), "leakage": 300.0}
GAINS: dict[str, dict[str, Any]] = {
    "sliding-mode": DRIVEN | {"bound": 40.0},
    "super-twisting": SLOPED
    | {"proportional_gain": (120.0, 100.0, 80.0), "integral_gain": (200.0, 300.0, 100.0), "boundary_layer": 0.2},
    "disturbance-observer": DRIVEN,
    "regressor-adaptive": DRIVEN | {"initial_estimate_factor": 0.7},
    "vibration-damping": ADAPTED | {"lateral_vibration_gain": 80.0, "angular_vibration_gain": 500.0},
    "composite": {"slow": ADAPTED, "lateral_vibration_gain": 60.0, "angular_vibration_gain": 300.0},
    "computed-torque": {"position_gain": (900.0, 700.0, 500.0), "velocity_gain": (60.0, 50.0, 40.0)},
    "pd": {"position_gain": (9e3, 7e3, 5e3), "velocity_gain": (900.0, 800.0, 600.0)},
    "joint-pd": {"position_gain": (2e4, 1e4, 4e3), "velocity_gain": (600.0, 500.0, 120.0)},
}
"""Law → fields that differ from their defaults, another number for each coordinate."""


class Instant(NamedTuple):
    """The inputs of a law at one sample, from mass points; arms are the first axis."""

    law: Any
    x: np.ndarray
    v: np.ndarray
    desired: tuple[np.ndarray, np.ndarray, np.ndarray]
    """x_d, ẋ_d, ẍ_d, (3,)."""
    points: MassPoints
    believed: MassPoints
    """Mass points with the controller's model of the payload."""
    M: np.ndarray
    C: np.ndarray
    G: np.ndarray
    A: np.ndarray
    """Ā of the controller's model of the payload, (3, 3)."""
    weight: np.ndarray
    """Weight of the believed payload, N, (3,)."""
    share: np.ndarray
    """Each arm's share of the common part, (2,)."""
    beam_rate: np.ndarray
    """hᵀq̇, gᵀq̇, (2,)."""
    squeeze: np.ndarray
    """Wanted internal force by arm, N, (2, 3)."""

    def surface(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """s, r, ṙ."""
        slope = getattr(self.law, "sliding_slope", None) or self.law.slow.sliding_slope
        x_d, v_d, a_d = self.desired
        r = v_d - slope * (self.x - x_d)
        return self.v - r, r, a_d - slope * (self.v - v_d)

    def shared(self, acceleration: np.ndarray, rate: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Each arm's own part, and its share of payload inertia, weight and a common force, (2, 3)."""
        common = self.A @ acceleration + self.weight + force
        return self.M @ acceleration + self.C @ rate + self.G + self.share[:, None] * common

    def momentum_rate(self, acceleration: np.ndarray) -> np.ndarray:
        """d(Bẋ)/dt (3,) for ẍ (3,)."""
        change = slopes(self.inertia, self.x)
        return self.inertia(self.x) @ acceleration + np.einsum("kij,k,j->i", change, self.v, self.v)

    def inertia(self, x: np.ndarray) -> np.ndarray:
        """B = ΣM̄_i + Ā at another pose (3, 3)."""
        return sum((self.points.arm_inertia(x, arm) for arm in range(2)), self.believed.rigid_inertia(x))


Law = Callable[[Instant, np.ndarray], np.ndarray]
"""Maps a law's inputs and memory to u_i, (2, 3)."""


def _with(force: Callable[[Any, np.ndarray, np.ndarray], np.ndarray]) -> Law:
    """The law whose common force follows from its settings, s and its memory."""

    def law(at: Instant, memory: np.ndarray) -> np.ndarray:
        s, r, r_dot = at.surface()
        return at.shared(r_dot, r, force(at.law, s, memory))

    return law


def _layer(law: Any, s: np.ndarray) -> float:
    """‖s‖, or the boundary layer if that is larger, m/s."""
    return max(float(np.linalg.norm(s)), law.boundary_layer)


def _regressor_adaptive(at: Instant, estimates: np.ndarray) -> np.ndarray:
    s, r, r_dot = at.surface()
    return regressor(at, r, r_dot) @ estimates - at.share[:, None] * (at.law.feedback_gain * s)


def _adaptive(at: Instant, b_hat: np.ndarray, law: Any) -> np.ndarray:
    bound = b_hat @ bound_terms(at.x, at.v)
    return _with(lambda _, s, __: -(law.feedback_gain * s) - bound * s / _layer(law, s))(at, b_hat)


def _damped(at: Instant, slow: np.ndarray) -> np.ndarray:
    lateral, turn = np.array([at.law.lateral_vibration_gain, at.law.angular_vibration_gain]) * at.beam_rate
    push = np.array([-np.sin(at.x[2]) * lateral, np.cos(at.x[2]) * lateral, turn])
    return slow + at.share[:, None] * (at.M.sum(axis=0) @ push)


def _computed_torque(at: Instant, _: np.ndarray) -> np.ndarray:
    x_d, v_d, a_d = at.desired
    wanted = a_d - at.law.velocity_gain * (at.v - v_d) - at.law.position_gain * (at.x - x_d)
    return at.shared(wanted, at.v, np.zeros(3))


def _pd(at: Instant, _: np.ndarray) -> np.ndarray:
    x_d, v_d, _ = at.desired
    force = -np.array(at.law.velocity_gain) * (at.v - v_d) - np.array(at.law.position_gain) * (at.x - x_d)
    return at.G + at.share[:, None] * (at.weight + force)


def _joint_pd(at: Instant, _: np.ndarray) -> np.ndarray:
    x_d, v_d, _ = at.desired
    u = []
    for arm in range(2):
        J = slopes(lambda x, arm=arm: at.points.joint_angles(x, arm), at.x).T
        J_d = slopes(lambda x, arm=arm: at.points.joint_angles(x, arm), x_d).T
        error = at.points.joint_angles(at.x, arm) - at.points.joint_angles(x_d, arm)
        tau = -np.array(at.law.position_gain) * error - np.array(at.law.velocity_gain) * (J @ at.v - J_d @ v_d)
        u.append(J.T @ tau)
    return np.array(u) + at.G + at.share[:, None] * at.weight


LAWS: dict[str, Law] = {
    "sliding-mode": _with(lambda law, s, _: -(law.feedback_gain * s) - law.bound * s / _layer(law, s)),
    "super-twisting": _with(lambda law, s, w: -(law.proportional_gain * s) / np.sqrt(_layer(law, s)) + w),
    "disturbance-observer": _with(lambda law, s, d_hat: -(law.feedback_gain * s) - d_hat),
    "regressor-adaptive": _regressor_adaptive,
    "vibration-damping": lambda at, b_hat: _damped(at, _adaptive(at, b_hat, at.law)),
    "composite": lambda at, b_hat: _damped(at, _adaptive(at, b_hat, at.law.slow)),
    "computed-torque": _computed_torque,
    "pd": _pd,
    "joint-pd": _joint_pd,
}
MEMORY = {
    "super-twisting": ("twisting_force",),
    "disturbance-observer": ("disturbance_estimate",),
    "regressor-adaptive": ("payload_mass_estimate", "payload_inertia_estimate", "link_mass_estimates"),
    "vibration-damping": ("bound_estimates",),
    "composite": ("bound_estimates",),
}
"""Law → the signals of its memory."""


def regressor(at: Instant, r: np.ndarray, r_dot: np.ndarray) -> np.ndarray:
    """Regressor Y of each arm, (2, 3, 8): the payload's columns times the load share, a link's only for its own arm."""
    Y = np.zeros((2, 3, 8))
    for arm in range(2):
        Y[arm, :, 0] = at.share[arm] * np.array([r_dot[0], r_dot[1] + at.points.gravity, 0.0])
        Y[arm, :, 1] = at.share[arm] * np.array([0.0, 0.0, r_dot[2]])
        for link in range(3):
            M, C, G = at.points.of_one_kilogram(arm, link).arm_terms(at.x, at.v, arm)
            Y[arm, :, 2 + 3 * arm + link] = M @ r_dot + C @ r + G
    return Y


@subject("Every control law", 6)
def rival_laws(_: Runs) -> Iterator[Check]:
    """The inputs u_i of every law, and the rate of its memory."""
    for kind, gains in GAINS.items():
        own = {f"controller.{name}": value for name, value in gains.items()}
        run = general(f"the law {kind}", {"controller.kind": kind, **own, **COMMON})
        rows = range(2, len(run) - 2, EVERY)
        memory = _memory(run, kind)
        seen = [instant(run, k) for k in rows]
        wanted = [LAWS[kind](at, memory[k]) + at.squeeze for k, at in zip(rows, seen, strict=True)]
        yield alike(f"{kind}: u_i, arm by arm: relative error", 1e-7, wanted, run.arm_input[rows], run.arm_input)
        if kind in MEMORY:
            rates = time_derivative(memory, FINE)[::EVERY][: len(seen)]
            wanted = np.array([_memory_rate(kind, at, run, k) for k, at in zip(rows, seen, strict=True)])
            error = np.abs(rates - wanted).max(axis=0) / np.maximum(np.abs(wanted).max(axis=0), 1e-9)
            yield below(f"{kind}: how its memory moves: relative error", 1e-5, error.max())
            begun = float(np.abs(memory[0] - _first_memory(run, kind)).max())
            yield below(f"{kind}: what its memory begins with: largest error, in SI units", 1e-12, begun)


def _first_memory(run: Run, kind: str) -> np.ndarray:
    """The law's memory at the start of a run: zero, or the given share of the true inertia, (numbers,)."""
    if kind != "regressor-adaptive":
        return np.zeros(_memory(run, kind).shape[1])
    payload, arms = run.scenario.payload, run.scenario.arms
    m = payload.linear_density * payload.length
    masses = [mass for arm in arms for mass in arm.link_mass]
    return GAINS[kind]["initial_estimate_factor"] * np.array([m, m * payload.length**2 / 12, *masses])


def _memory(run: Run, kind: str) -> np.ndarray:
    """The law's memory, (N, numbers); most laws have none."""
    parts = [getattr(run, name).reshape(len(run), -1) for name in MEMORY.get(kind, ())]
    return np.hstack(parts) if parts else np.zeros((len(run), 0))


def _memory_rate(kind: str, at: Instant, run: Run, k: int) -> np.ndarray:
    """d(memory)/dt by the law's equation, at sample k."""
    s, r, r_dot = at.surface()
    size = float(np.linalg.norm(s))
    if kind == "super-twisting":
        return -(at.law.integral_gain * s) / max(size, at.law.boundary_layer)
    if kind == "disturbance-observer":
        known = np.einsum("iab,a->b", at.C, at.v) - at.G.sum(axis=0) - at.weight
        missed = at.momentum_rate(run.pose_acceleration[k]) - run.arm_input[k].sum(axis=0) - known
        return at.law.observer_gain * (missed - run.disturbance_estimate[k])
    if kind == "regressor-adaptive":
        law = at.law
        rates = np.array([law.adaptation_gain_mass, law.adaptation_gain_inertia] + 6 * [law.adaptation_gain_links])
        return -rates * (regressor(at, r, r_dot).sum(axis=0).T @ s)
    law = at.law if kind == "vibration-damping" else at.law.slow
    return size * bound_terms(at.x, at.v) / np.array(law.adaptation) - law.leakage * run.bound_estimates[k]


def instant(run: Run, k: int) -> Instant:
    """The inputs of a run's law at sample k."""
    scenario = run.scenario
    model, payload = scenario.controller.model, scenario.payload
    heavy, long = payload.linear_density * model.linear_density_factor, payload.length * model.length_factor
    known = scenario.replace({"payload.linear_density": heavy, "payload.length": long})
    growth = model.mass_change_factor * (mass_ratio(run.time[k], **FILLING)[0] - 1)
    points, believed = MassPoints(scenario), MassPoints(known).filled(1 + growth)
    x, v, law = run.pose[k], run.pose_rate[k], scenario.controller
    terms = [points.arm_terms(x, v, arm) for arm in range(2)]
    M, C, G = (np.array(part) for part in zip(*terms, strict=True))
    goal, goal_rate, acceleration = (part[0] for part in desired(run.time[k : k + 1], scenario.trajectory))
    loads = points.payload_inertia(np.concatenate([[0.0, 0.0, 0.0], np.zeros(run.beam_rates.shape[1])]))[1:3, 3:]
    along = np.array([np.cos(x[2]), np.sin(x[2]), 0.0]) * law.wanted_internal_force
    return Instant(
        law, x, v, (goal, goal_rate, acceleration), points, believed, M, C, G, believed.rigid_inertia(x),
        np.array([0.0, (1 + growth) * heavy * long * scenario.gravity, 0.0]),
        np.array([law.load_share, 1 - law.load_share]), loads @ run.beam_rates[k], np.array([along, -along]),
    )  # fmt: skip
