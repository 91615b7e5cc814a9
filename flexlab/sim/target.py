"""The desired motion of a scenario: its path with smooth start, shaper and transition, and what a live change makes of it.

An input shaper is made for the first mode of the beam in the closed loop, unless another is given.
"""

import contextlib
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from flexlab.control.motion import INSIDE, NO_TRANSITION, DesiredMotion, impulses, poses, time_of
from flexlab.control.path import TRANSITION_TIME, Trajectory, Transition, build_motion
from flexlab.errors import ScenarioError
from flexlab.numerics.eigenvalues import eigenvalues, eigenvector
from flexlab.physics.plant import ETA, P, X
from flexlab.scenario import Scenario
from flexlab.scenario.settings import IDEAL, PERIOD
from flexlab.sim.build import Beam, build_beam, build_control, build_plant
from flexlab.sim.closed_loop import System, new_workspace, rates_at, state_length

DIFFERENCE = 1e-5
"""Step of the central differences, m, rad and their momenta: their error stays under 1e-6 of the frequency."""
OWN_SHARE = 0.5
"""Share of an oscillation that must be the beam's for it to count as one of its modes."""
MOST_DAMPED = 0.9
"""Largest damping ratio for which a shaper is made; what decays faster needs none."""


class Mode(NamedTuple):
    """An oscillation."""

    omega: float
    """Magnitude of its pole, rad/s."""
    zeta: float
    """Damping ratio, 1."""


def first_mode(scenario: Scenario) -> Mode:
    """The closed loop's slowest oscillation that belongs to the beam, with the payload held in the middle of its path.

    Control is continuous, with the controller's state at the start; if the law runs sampled only, the arms are free. Raises
    `ScenarioError` if there is none, as with fast-acting damping.
    """
    still = {"title": "", "watch": "", "trajectory": {"kind": "hold", "pose": scenario.trajectory.middle}}
    return _found(_continuous(scenario).replace(still))


def _continuous(scenario: Scenario) -> Scenario:
    """The ideal scenario (`IDEAL`) under its law in continuous time; without control if that is impossible."""
    with contextlib.suppress(ScenarioError):
        found = scenario.replace({PERIOD: None, **IDEAL})
        if found.controller.control_period is None:
            return found
    return scenario.replace({"controller": {"kind": "none"}, **IDEAL})


@lru_cache(maxsize=32)
def _found(scenario: Scenario) -> Mode:
    beam = build_beam(scenario.payload)
    system = build_system(scenario, beam)
    n = len(beam.modes.omega)
    parts = np.concatenate([np.arange(X, X + 3), ETA + np.arange(n), np.arange(P, P + 3), ETA + n + np.arange(n)])
    scale = np.concatenate([np.ones(3), beam.modes.omega, np.ones(3 + n)])
    matrix = _slopes(system, np.array(scenario.trajectory.middle), parts, scale)
    value = eigenvalues(matrix)
    size = np.sqrt(np.square(value.real) + np.square(value.imag))
    for place in np.argsort(size, kind="stable"):
        if value.imag[place] > 0 and _beams_share(matrix, value[place], n) > OWN_SHARE:
            omega = float(size[place])
            return Mode(omega, float(np.clip(-value.real[place] / omega, 0.0, MOST_DAMPED)))
    text = (
        "trajectory.shaper_frequency = null: no mode of the beam oscillates in this loop. "
        "Give the frequency that the shaper is made for, in Hz, or choose the shaper none."
    )
    raise ScenarioError([("trajectory.shaper_frequency", text)])


def _beams_share(matrix: np.ndarray, pole: complex, n: int) -> float:
    """The beam's share of an oscillation, by the participation of the loop's states in it (x, η, p, π)."""
    left, right = eigenvector(matrix.T, pole), eigenvector(matrix, pole)
    real, imaginary = left.real * right.real - left.imag * right.imag, left.real * right.imag + left.imag * right.real
    parts = np.sqrt(real * real + imaginary * imaginary)
    return float((parts[3 : 3 + n].sum() + parts[6 + n :].sum()) / max(float(parts.sum()), np.finfo(float).tiny))


def _slopes(system: System, pose: np.ndarray, parts: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """The matrix of the linearised loop at rest over `parts` of its state, η times its frequency; raises `ScenarioError`."""
    y, ws = np.zeros(state_length(system)), new_workspace(system)
    y[:3] = pose
    rows = np.zeros((2, len(y)))
    columns = []
    for part in parts:
        for row, step in zip(rows, (DIFFERENCE, -DIFFERENCE), strict=True):
            moved = y.copy()
            moved[part] += step
            if rates_at(system, 0.0, moved, ws, row, True) != 0:
                raise ScenarioError([("trajectory", "The middle of the path is out of reach: move it.")])
        columns.append((rows[0] - rows[1])[parts] / (2 * DIFFERENCE))
    return np.stack(columns, axis=1) * scale[:, None] / scale


CLOSE = 1e-9
"""Distance, m and rad, by which a target may jump: the rounding of a kept phase."""


def build_trajectory(scenario: Scenario) -> DesiredMotion:
    """The desired motion of a scenario; raises `ScenarioError` if there is no mode for its shaper."""
    path = scenario.trajectory
    motion = build_motion(path)._replace(
        ramp=float(path.smooth_start), impulses=shaper_impulses(scenario), bending=float(path.bending_feedforward)
    )
    motion = motion._replace(discontinuities=_discontinuities(path, motion))
    if len(motion.impulses) and len(motion.discontinuities):
        motion = motion._replace(inside=max(motion.inside, INSIDE * max(1.0, float(motion.discontinuities[-1]))))
    return with_transition(motion, path.transition)


def build_system(scenario: Scenario, beam: Beam) -> System:
    """Plant, control law and trajectory of a scenario, with motors off until a sampled controller first acts."""
    return System(
        build_plant(scenario, beam),
        build_control(scenario, beam),
        build_trajectory(scenario),
        np.zeros((len(scenario.arms), 3)),
    )


def _discontinuities(path: Trajectory, motion: DesiredMotion) -> np.ndarray:
    """`DesiredMotion.discontinuities` of a path with its ramp and its shaper, s.

    A path that moves at once adds a jump at each impulse.
    """
    own = [time_of(instant, motion.ramp) for instant in path.discontinuities]
    if len(motion.impulses) == 0:
        return np.array(sorted({instant for instant in own if instant > 0}), float)
    if motion.ramp == 0 and np.any(poses(motion._replace(plain=True), [0.0])[0, 1:]):
        own.append(0.0)
    found = np.unique(np.add.outer(motion.impulses[:, 1], np.array(own, float)))
    return found[found > 0]


def with_transition(motion: DesiredMotion, left: Transition | None) -> DesiredMotion:
    """A desired motion with this transition from an earlier one, in place of any other."""
    transition = NO_TRANSITION
    if left is not None:
        transition = np.array([left.time, left.duration, *left.pose, *left.rate, *left.acceleration])
    plain = motion.ramp == 0 and len(motion.impulses) == 0 and left is None
    return motion._replace(plain=plain, transition=transition)


def shaper_impulses(scenario: Scenario) -> np.ndarray:
    """A_j, 1, and t_j, s, of a scenario's input shaper, (impulses, 2); (0, 2) without a shaper."""
    path = scenario.trajectory
    if path.shaper == "none":
        return impulses("none", 1.0, 0.0)
    frequency, zeta = path.shaper_frequency, path.shaper_damping
    if frequency is None or zeta is None:
        mode = first_mode(scenario)
        frequency = mode.omega / (2 * math.pi) if frequency is None else frequency
        zeta = mode.zeta if zeta is None else zeta
    return impulses(path.shaper, 2 * math.pi * frequency, min(zeta, MOST_DAMPED))


def desired_at(trajectory: DesiredMotion, t: float) -> np.ndarray:
    """x_d, ẋ_d, ẍ_d at time t, (3, 3)."""
    return poses(trajectory, np.array([t]))[0]


def change_path(scenario: Scenario, changes: Mapping[str, Any], time: float) -> Scenario:
    """The changed scenario, with a path that is close to the target at `time`, s, if possible.

    Raises `ScenarioError` for what is not valid, a path that begins outside its allowed range included.
    """
    changed = scenario.replace(changes)
    own = {path.removeprefix("trajectory."): value for path, value in changes.items() if path.startswith("trajectory.")}
    if not own or "trajectory" in changes:
        return changed
    old, new = scenario.trajectory, changed.trajectory
    kept = old.keeping(new, own, time) if type(old) is type(new) else new.taken_up(old, own, time)
    return changed if kept is new else changed.replace({"trajectory": dict(kept)})


def go_on_from(
    old: Scenario, old_motion: DesiredMotion, scenario: Scenario, motion: DesiredMotion, time: float
) -> Scenario:
    """The scenario, of `motion`, with the transition from `old_motion`, of `old`, at `time`, s.

    A path of the same kind that is where the target is needs none: a new frequency acts at once. Raises `ScenarioError` for a
    transition out of range.
    """
    plain, motion = scenario.anew(), with_transition(motion, None)
    left = desired_at(old_motion, time) - desired_at(motion, time)
    if np.abs(left[0]).max() < CLOSE and plain.trajectory.kind == old.trajectory.kind:
        return plain
    over: dict[str, Any] = dict(zip(("pose", "rate", "acceleration"), map(tuple, left.tolist()), strict=True))
    over |= {"time": time, "duration": TRANSITION_TIME}
    return plain.replace({"trajectory": {**dict(plain.trajectory), "transition": over}})


def equal_motions(one: DesiredMotion, other: DesiredMotion) -> bool:
    """Whether two targets are the same at every instant."""
    return one is other or all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def same_target(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios surely have the same target; a shaper may depend on the loop's first mode."""
    path = one.trajectory
    if path != other.trajectory:
        return False
    follows = path.shaper != "none" and None in (path.shaper_frequency, path.shaper_damping)
    return not follows or _loop(one) == _loop(other)


def _loop(scenario: Scenario) -> tuple[object, ...]:
    """The parts of a scenario on which the modes of the closed loop depend."""
    return scenario.payload, scenario.arms, scenario.controller, scenario.gravity, scenario.joints.friction
