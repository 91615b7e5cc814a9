"""What the laws' conditions tell of a scenario, from mass points along the desired motion."""

import re
from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.linalg import eigh

from flexlab.analysis.law_conditions import circumstances, law_conditions
from flexlab.analysis.validation.beam import LENGTH, RHO
from flexlab.analysis.validation.check import UNEQUAL, Check, Runs, close, subject, true
from flexlab.analysis.validation.mass_points import MassPoints, slopes
from flexlab.analysis.validation.paper import GAIN, SLOPE, desired
from flexlab.analysis.validation.rival_laws import GAINS, regressor
from flexlab.analysis.validation.sampled_loop import GROWTH
from flexlab.control.conditions import Condition
from flexlab.presets import load_preset
from flexlab.sim.build import build_beam
from flexlab.sim.step_rates import joint_rate
from flexlab.sim.target import build_system

ROUGH = {
    "joints.friction.viscous": (5.0, 4.0, 2.0),
    "joints.friction.coulomb": (8.0, 6.0, 3.0),
    "joints.friction.static_factor": 1.5,
    "joints.motor.stall_torque": (450.0, 250.0, 90.0),
    "joints.motor.no_load_speed": (7.0, 6.0, 9.0),
}
HEAVY = {"payload.linear_density": 40.0}
"""A payload with more inertia than its arms, kg/m."""
HELD = (0.06, 0.8, 0.3)
"""Pose of unequal arms at which the rates of the laws are compared."""


def _conditions_of(law: dict[str, Any], **changes: Any) -> tuple[Condition, ...]:
    return law_conditions(load_preset("paper").replace({"controller": law, **changes}))


def _told(law: dict[str, Any], pattern: str, **changes: Any) -> float:
    """The number that a condition of a law tells of the paper's path; `pattern`: words with that number as a group."""
    return float(re.findall(pattern, " ".join(condition.sentence for condition in _conditions_of(law, **changes)))[0])


@subject("Conditions of the laws", 18)
def conditions(_: Runs) -> Iterator[Check]:
    """The numbers in the laws' conditions, with three digits, from mass points along the paper's path, and their rates."""
    yield from _rates()
    points, n, path = MassPoints(load_preset("paper")), 4, load_preset("paper").trajectory
    instants = np.arange(32) / 32

    def reaction(t: float) -> np.ndarray:
        goal, _, change = (part[0] for part in desired(np.array([t]), path))
        whole = points.payload_inertia(np.concatenate([goal, np.zeros(n)]))[:3, :3]
        return (whole - points.rigid_inertia(goal)) @ change

    force = max(np.linalg.norm(reaction(t)) for t in instants)
    told = _told({"kind": "adaptive-sliding-mode"}, r"reaction on this path, ([\d.]+) N")
    yield close("conditions: the beam's reaction on the paper's path is (A12 A22⁻¹A21) ẍ_d", force, told, "N", 0.006)
    twisting = {"kind": "super-twisting"}
    rate = max(np.linalg.norm(slopes(lambda at: reaction(at[0]), np.array([t]))) for t in instants)
    told = _told(twisting, r"against ([\d.]+) N/s")
    yield close("super-twisting: by how much it changes", rate, told, "N/s", 0.012)
    along = desired(instants, path)[0]
    inertia = [sum((points.arm_inertia(x, arm) for arm in range(2)), points.rigid_inertia(x)) for x in along]
    most = max(np.linalg.eigvalsh(B)[-1] for B in inertia)
    yield close("super-twisting: its largest inertia", most, _told(twisting, r"b = ([\d.]+) kg"), "kg", 0.006)
    needed = np.sqrt(4 * most * rate * (200 + rate) / (200 - rate))
    told = _told(twisting, r"against ([\d.]+), b")
    yield close("super-twisting: Levant's k1 = √(4bδ(k2 + δ)/(k2 - δ))", needed, told, relative=0.02)
    late = {"control_period": 1e-3, "input_delay": 1}
    told = _told({"kind": "adaptive-sliding-mode", **late}, r"control period is ([\d.]+)")
    fastest = max(SLOPE + eigh(GAIN * np.eye(3), B, eigvals_only=True)[-1] for B in inertia)
    yield close(
        "the loop's fastest rate is Λ + max λ(B⁻¹K), over the control period", 1e-3 * fastest, told, relative=0.01
    )
    heavy = MassPoints(load_preset("paper").replace(HEAVY))
    stiff = [
        sum(heavy.arm_inertia(x, arm) for arm in range(2)) + heavy.payload_inertia([*x, *[0.0] * n])[:3, :3]
        for x in along
    ]
    slow = max(SLOPE + eigh(GAIN * np.eye(3), B, eigvals_only=True)[-1] for B in stiff)
    told = _told({"kind": "adaptive-sliding-mode"}, r"rigid payload moves at ([\d.]+) 1/s", **HEAVY)
    yield close("and with a heavy payload that were rigid", slow, told, "1/s", relative=0.01)
    told = _told({"kind": "adaptive-sliding-mode"}, r"‖s‖ = ([\d.]+) m/s")
    yield close("the feedback alone holds that reaction at ‖s‖ = ‖Ψ‖/K", force / GAIN, told, "m/s", 0.006)
    told = _told({"kind": "disturbance-observer"}, r"third of the beam's first mode is ([\d.]+)")
    yield close("disturbance-observer: a third of ω₁", points.softest() ** 0.5 / 3, told, "1/s", 0.006)
    damping = {"kind": "vibration-damping", **late}
    fine = {"payload.element_count": 8, "payload.damping.coefficient": 0.0}
    told = _told(damping, r"Hz grows at ([\d.]+) 1/s", **fine)
    yield close("late rate feedback feeds the 400 Hz mode, to first order: rate", GROWTH, told, "1/s", 0.1)
    # The second mode moves 24/(2π)² of the inertia ρL³/12; held torques reach it with sinc(ωT_c/2) cos(1.5 ωT_c).
    turning, omega = {"lateral_vibration_gain": 0.0, "angular_vibration_gain": 3000.0}, 2 * np.pi * 177.715
    strength = 3000.0 * 24 / (2 * np.pi) ** 2 * RHO * LENGTH**3 / 12
    exact = -strength / 2 * np.sinc(omega * 1e-3 / (2 * np.pi)) * np.cos(1.5e-3 * omega)
    told = _told(damping | turning, r"Hz grows at ([\d.]+) 1/s", **fine)
    yield close("and that of the turn the second one", exact, told, "1/s", 0.01)


class _AtRest:
    """Unequal arms at rest at `HELD`, with a law."""

    def __init__(self, law: dict[str, Any], joints: dict[str, Any] | None = None):
        hold = {"trajectory": {"kind": "hold", "pose": HELD}, "initial.pose": HELD, "gravity": 9.81}
        self.scenario = load_preset("paper").replace({**UNEQUAL, **hold, "controller": law, **(joints or {})})
        self._points, self._x = MassPoints(self.scenario), np.array(HELD)
        straight = self._points.payload_inertia(np.zeros(3 + self._points.shapes(0.0).size))[:3, :3]
        self._beam = (straight - self._points.rigid_inertia(np.zeros(3))).diagonal()
        arms = sum(self._points.arm_inertia(self._x, arm) for arm in range(2))
        self._inertia = arms + self._points.rigid_inertia(self._x)

    def fastest(self, *form: Any) -> float:
        """Largest eigenvalue of B⁻¹F for the sum F of diagonals (3,) and numbers."""
        return self._largest(np.diag(sum(np.broadcast_to(part, 3) for part in form)))

    def in_joints(self, gain: Any) -> float:
        """Largest eigenvalue of B⁻¹Σ𝒥ᵀ diag(gain) 𝒥."""
        J = [slopes(partial(self._points.joint_angles, index=arm), self._x) for arm in range(2)]
        return self._largest(sum(j @ np.diag(gain) @ j.T for j in J))

    def damped(self, law: Any) -> float:
        """Rate at which vibration gains damp hᵀq̇ and gᵀq̇, 1/s."""
        return law.lateral_vibration_gain * self._beam[1] + law.angular_vibration_gain * self._beam[2]

    def learnt(self, law: Any) -> float:
        """Largest eigenvalue of B⁻¹ times the trace of YΓYᵀ, Y of the weights."""
        at = SimpleNamespace(points=self._points, x=self._x, v=np.zeros(3), share=np.ones(2) / 2)
        Y = regressor(at, np.zeros(3), np.zeros(3)).sum(axis=0)
        rates = [law.adaptation_gain_mass, law.adaptation_gain_inertia, *[law.adaptation_gain_links] * 6]
        return self.fastest(np.sum(Y**2 @ rates))

    def _largest(self, form: np.ndarray) -> float:
        return float(eigh(form, self._inertia, eigvals_only=True)[-1])


def _sliding(at: _AtRest, law: Any, *more: Any) -> float:
    return max(law.sliding_slope) + at.fastest(law.feedback_gain, *more)


RATES: dict[str, Callable[[_AtRest, Any], float]] = {
    "sliding-mode": lambda at, law: _sliding(at, law, law.bound / law.boundary_layer),
    "super-twisting": lambda at, law: (
        max(law.sliding_slope)
        + at.fastest(np.array(law.proportional_gain) / law.boundary_layer**0.5)
        + at.fastest(np.array(law.integral_gain) / law.boundary_layer) ** 0.5
    ),
    "disturbance-observer": lambda at, law: _sliding(at, law) + law.observer_gain,
    "regressor-adaptive": lambda at, law: _sliding(at, law) + at.learnt(law) ** 0.5,
    "vibration-damping": lambda at, law: _sliding(at, law) + at.damped(law),
    "composite": lambda at, law: _sliding(at, law.slow) + at.damped(law),
    "computed-torque": lambda _, law: max(law.velocity_gain),
    "pd": lambda at, law: at.fastest(law.velocity_gain) + at.fastest(law.position_gain) ** 0.5,
    "joint-pd": lambda at, law: at.in_joints(law.velocity_gain) + at.in_joints(law.position_gain) ** 0.5,
}
"""Law → the fastest rate of its loop, 1/s."""
VERDICTS: tuple[tuple[dict[str, Any], bool], ...] = (
    ({"kind": "super-twisting", "integral_gain": 40.0}, False),
    ({"kind": "super-twisting", "integral_gain": 60.0, "proportional_gain": 30.0}, True),
    ({"kind": "sliding-mode", "bound": 8.0}, False),
    ({"kind": "sliding-mode", "bound": 9.0}, True),
    ({"kind": "adaptive-sliding-mode", "boundary_layer": 0.04}, False),
    ({"kind": "adaptive-sliding-mode", "boundary_layer": 0.05}, True),
)
"""Law → whether its first condition is met on the paper's path: a reaction of 8.59 N that changes by 48.5 N/s."""


def _rates() -> Iterator[Check]:
    """The fastest rate of every law at a tilted pose of unequal arms, and what a path tells of the masses."""
    for kind, rate in RATES.items():
        at = _AtRest({"kind": kind, **GAINS[kind]})
        told = circumstances(at.scenario).fastest_rate
        yield close(f"{kind}: fastest rate of its loop", rate(at, at.scenario.controller), told, "1/s", relative=1e-7)
    at = _AtRest({"kind": "none"}, ROUGH)
    friction, motor = at.scenario.joints.friction, at.scenario.joints.motor
    steepest = (
        np.array(friction.viscous) + friction.static_factor * np.array(friction.coulomb) / friction.smoothing_speed
    )
    falling = np.array(motor.stall_torque) / motor.no_load_speed
    told = joint_rate(build_system(at.scenario, build_beam(at.scenario.payload)), np.array([HELD]))
    statement = "the fastest rate of friction and of motors at their limits, at rest"
    yield close(statement, at.in_joints(steepest + falling), told, "1/s", relative=1e-7)
    wrong = [law for law, met in VERDICTS if _conditions_of(law)[0].met != met]
    yield true("a law's first condition is met or not, by the reaction on the path", not wrong, str(wrong))
    points, rows = MassPoints(load_preset("paper")), []
    for x, v, change in zip(*desired(np.arange(8) / 8, load_preset("paper").trajectory), strict=True):
        at = SimpleNamespace(points=points, x=x, v=v, share=np.ones(2) / 2)
        rows.append(regressor(at, v, change).sum(axis=0) * [1.0, 1 / 48, *[8.0, 8.0, 4.0] * 2])
    rank = float(np.linalg.matrix_rank(np.concatenate(rows), tol=1e-3 * np.linalg.norm(np.concatenate(rows), 2)))
    told = _told({"kind": "regressor-adaptive"}, r"identifies (\d+) of")
    yield close("regressor-adaptive: combinations of masses that the paper's path identifies", rank, told)
