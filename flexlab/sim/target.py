"""The desired motion of a scenario: its path with all that it may have besides, and what a live change makes of it."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from flexlab.control.motion import INSIDE, NO_TRANSITION, DesiredMotion, poses, time_of
from flexlab.control.path import TRANSITION_TIME, Trajectory, Transition, build_motion
from flexlab.control.shapers import impulses
from flexlab.scenario import Scenario
from flexlab.sim.first_mode import MOST_DAMPED, first_mode

CLOSE = 1e-9
"""Distance, m and rad, over which a target may jump: the rounding of a phase that was kept."""


def build_trajectory(scenario: Scenario) -> DesiredMotion:
    """The desired motion of a scenario; raises `ScenarioError` where its shaper has no mode to be made for."""
    path = scenario.trajectory
    motion = build_motion(path)._replace(
        ramp=float(path.smooth_start), impulses=shaper_impulses(scenario), bending=float(path.bending_feedforward)
    )
    motion = motion._replace(kinks=_kinks(path, motion))
    if len(motion.impulses) and len(motion.kinks):
        motion = motion._replace(inside=max(motion.inside, INSIDE * max(1.0, float(motion.kinks[-1]))))
    return with_transition(motion, path.transition)


def _kinks(path: Trajectory, motion: DesiredMotion) -> np.ndarray:
    """`DesiredMotion.kinks` of a path with its ramp and its shaper, s.

    A copy of a path that moves at once jumps where its time has come.
    """
    own = [time_of(instant, motion.ramp) for instant in path.kinks]
    if len(motion.impulses) == 0:
        return np.array(sorted({instant for instant in own if instant > 0}), float)
    if motion.ramp == 0 and np.any(poses(motion._replace(plain=True), [0.0])[0, 1:]):
        own.append(0.0)
    found = np.unique(np.add.outer(motion.impulses[:, 1], np.array(own, float)))
    return found[found > 0]


def with_transition(motion: DesiredMotion, left: Transition | None) -> DesiredMotion:
    """A desired motion with this left over of an earlier one, and nothing else."""
    transition = NO_TRANSITION
    if left is not None:
        transition = np.array([left.time, left.duration, *left.pose, *left.rate, *left.acceleration])
    plain = motion.ramp == 0 and len(motion.impulses) == 0 and left is None
    return motion._replace(plain=plain, transition=transition)


def shaper_impulses(scenario: Scenario) -> np.ndarray:
    """A_j, 1, and t_j, s, of a scenario's input shaper, (impulses, 2); none without one."""
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
    """The changed scenario, its path such that it begins close to the target at `time`, s, where it can.

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
) -> tuple[Scenario, DesiredMotion]:
    """The scenario and its desired motion with the transition that takes them on from `old_motion`, of `old`, at `time`, s.

    A path of the same kind that begins where the target is needs none: a new frequency acts at once. Raises `ScenarioError`
    where more is left over than can be.
    """
    plain, motion = scenario.anew(), with_transition(motion, None)
    left = desired_at(old_motion, time) - desired_at(motion, time)
    if np.abs(left[0]).max() < CLOSE and plain.trajectory.kind == old.trajectory.kind:
        return plain, motion
    over: dict[str, Any] = dict(zip(("pose", "rate", "acceleration"), map(tuple, left.tolist()), strict=True))
    over |= {"time": time, "duration": TRANSITION_TIME}
    moved = plain.replace({"trajectory": {**dict(plain.trajectory), "transition": over}})
    return moved, with_transition(motion, moved.trajectory.transition)


def equal_motions(one: DesiredMotion, other: DesiredMotion) -> bool:
    """Whether two targets are the same at every instant."""
    return one is other or all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def same_target(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios surely have the same target; a shaper may follow the loop's first mode."""
    path = one.trajectory
    if path != other.trajectory:
        return False
    follows = path.shaper != "none" and None in (path.shaper_frequency, path.shaper_damping)
    return not follows or _loop(one) == _loop(other)


def _loop(scenario: Scenario) -> tuple[object, ...]:
    """What the modes of the closed loop depend on."""
    return scenario.payload, scenario.arms, scenario.controller, scenario.gravity
