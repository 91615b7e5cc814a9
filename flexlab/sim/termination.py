"""Why a run cannot start, or stops: poses out of reach, and fault codes of the kernels, turned into sentences."""

import math

import numpy as np

from flexlab.control.law import laws
from flexlab.control.motion import poses as desired_motions
from flexlab.control.path import build_motion
from flexlab.own.link import address_in
from flexlab.physics.arm import SINGULAR, SINGULAR_SINE, UNREACHABLE
from flexlab.physics.grips import arm_poses
from flexlab.physics.sensors import encoder_pose
from flexlab.scenario import Scenario
from flexlab.sim.advance import BENT
from flexlab.sim.assembly import Assembly
from flexlab.sim.closed_loop import own_states_of, scratch_workspace
from flexlab.sim.parametric_resonance import growth_rate, may_resonate
from flexlab.sim.sampled_control import gaussian
from flexlab.sim.samples import Status
from flexlab.sim.step_size import STABLE_COUPLING
from flexlab.sim.target import desired_at
from flexlab.text import counted, fixed_text, number_text

DEFLECTION_LIMIT = 1.0
"""Deflection at mid-span, or of a free end, over length at which a run stops: the linear beam model has lost all meaning
long before."""
FASTEST_WRIST = 100.0
"""Speed of a wrist, m/s, ten times what the fastest robot arms reach: beyond it the computation has diverged."""
UNSTABLE_COUPLING = 2 * STABLE_COUPLING
"""Approximate step times `Rates.coupling` above which etdrk4 is unstable."""
LOUDER = 10.0
"""Growth rate times time from which on growing errors explain a divergence: 1e-10 of the motion has become 1e-6 of it."""
OUT_OF_REACH = {UNREACHABLE: "unreachable", SINGULAR: "singular"}
"""Fault code of a pose that an arm cannot take → its status."""


def arm_name(scenario: Scenario, index: int) -> str:
    """Either "left arm" or "right arm"."""
    return "left arm" if index == 0 else "right arm"


def wrist_reach(scenario: Scenario, index: int, pose: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Distances from base to wrist of an arm at poses (..., 3), and the shortest and longest possible, m."""
    arm, side = scenario.arms[index], (-1 if index == 0 else 1)
    reach = side * (scenario.payload.length / 2 + arm.link_length[2])
    x = pose[..., 0] + reach * np.cos(pose[..., 2]) - arm.base[0]
    y = pose[..., 1] + reach * np.sin(pose[..., 2]) - arm.base[1]
    l1, l2, _ = arm.link_length
    return np.hypot(x, y), abs(l1 - l2), l1 + l2


def elbow_sine(distance: np.ndarray, l1: float, l2: float) -> np.ndarray:
    """|sin| of the elbow angle for wrists at `distance` from the base, m; 0 outside the workspace."""
    cosine = (distance**2 - l1**2 - l2**2) / (2 * l1 * l2)
    return np.sqrt(np.maximum(0.0, 1 - cosine**2))


def _pose_text(pose: np.ndarray) -> str:
    x, y, angle = (fixed_text(float(value), 3) for value in pose)
    return f"x = {x} m, y = {y} m, θ = {angle} rad"


def pose_fault(scenario: Scenario, pose: np.ndarray, time: float, what: str) -> Status | None:
    """The status of the first arm that cannot take a pose, or None. `what` names the pose ("the desired pose")."""
    for index in range(len(scenario.arms)):
        reach, shortest, longest = wrist_reach(scenario, index, pose)
        distance = float(reach)
        l1, l2, _ = scenario.arms[index].link_length
        where = f"at {_pose_text(pose)} (t = {time:.3f} s)"
        name = arm_name(scenario, index)
        if not shortest <= distance <= longest:
            limit, side = (longest, "beyond") if distance > longest else (shortest, "short of")
            return Status(
                "unreachable",
                f"The {name} cannot reach {what} {where}: its wrist would be {distance:.3f} m from its base, "
                f"{abs(distance - limit):.3f} m {side} the {limit:.3f} m it can span. "
                "Move the trajectory's centre, make its amplitude smaller, or move the arm's base.",
                time,
            )
        if elbow_sine(distance, l1, l2) < SINGULAR_SINE:
            posture = "stretched" if distance > math.hypot(l1, l2) else "folded"
            return Status(
                "singular",
                f"The {name} is {posture} at {what} {where}: its wrist is {distance:.3f} m from its base, "
                f"and the elbow's sine is {elbow_sine(distance, l1, l2):.3f}, below the {number_text(SINGULAR_SINE)} it needs. "
                "Beyond that the elbow could flip. Make the trajectory smaller or move the arm's base.",
                time,
            )
    return None


def measurement_fault(assembly: Assembly, pose: np.ndarray, pose_rate: np.ndarray, time: float) -> str:
    """How encoders and noise moved a pose measured within a tick after `time` out of the workspace; empty if they did not."""
    scenario, sampling, encoders = assembly.scenario, assembly.sampling, assembly.scenario.joints.encoders
    if not (sampling.noise[:3].any() or encoders.active):
        return ""
    plant, ws, reading = assembly.system.plant, scratch_workspace(assembly.system), np.zeros(3)
    first = math.floor(time / sampling.period + 1e-9) + 1
    for instant in range(first, math.floor((time + assembly.tick_period) / sampling.period + 1e-9) + 1):
        now = instant * sampling.period
        true = pose + (now - time) * pose_rate
        with np.errstate(over="ignore"):  # its counters wrap around
            noise = [sampling.noise[a] * gaussian(sampling.seed, instant, a) for a in range(3)]
        measured = reading if encoders.active and encoder_pose(plant, true, ws, reading) == 0 else true
        fault = pose_fault(scenario, measured + noise, now, "the measured pose")
        if fault is not None and pose_fault(scenario, true, now, "the pose") is None:
            return fault.text.partition(": its wrist")[0]
    return ""


def runtime_fault(assembly: Assembly, code: int, y: np.ndarray, pose_rate: np.ndarray, time: float) -> Status:
    """The status for a kernel's fault code; `y`, `pose_rate` (3,): the last good state, at `time`, s."""
    scenario, pose = assembly.scenario, y[:3]
    own = own_states_of(assembly.system, y).get("grips", np.zeros(0))
    poses = arm_poses(assembly.system.plant, pose, own) if len(own) else [pose] * len(scenario.arms)
    kept = f"The last good state, at t = {time:.3f} s, is kept."
    law = scenario.controller
    own_problem = laws()[law.kind].problem(law)
    if own_problem:
        mend = "See to that program" if address_in(getattr(law, "source", "")) else "Mend the file"
        text = f"The control law {law.kind} stopped just after t = {time:.3f} s. {own_problem} {kept} {mend} and start again."
        return Status("law failed", text, time)
    sampled = law.control_period is not None and law.kind != "none"
    if sampled and code in OUT_OF_REACH:
        measured = measurement_fault(assembly, pose, pose_rate, time)
        if measured:
            text = f"{measured}: sensor noise threw the measured pose out of the workspace."
            cure = "less noise in controller.sensor_noise.pose"
            if scenario.joints.encoders.active:
                text = f"{measured}: what the encoders and their noise tell is out of the workspace."
                cure = f"more joints.encoders.counts or {cure}"
            return Status(OUT_OF_REACH[code], f"{text} {kept} Reset with {cure}.", time)
    margins = []
    for index in range(len(scenario.arms)):
        reach, shortest, longest = wrist_reach(scenario, index, poses[index])
        distance = float(reach)
        margins.append((min(longest - distance, distance - shortest), index, distance, longest))
    margin, index, distance, longest = min(margins)
    arm = scenario.arms[index]
    wrist_speed = math.hypot(*pose_rate[:2]) + abs(pose_rate[2]) * (scenario.payload.length / 2 + arm.link_length[2])
    # A wrist that could not have reached its limit at ten times its speed, or that is faster than any arm, did not move there:
    # the computation diverged.
    near = wrist_speed < FASTEST_WRIST and margin < 10 * wrist_speed * assembly.tick_period + longest * SINGULAR_SINE
    too_long = _is_too_long(assembly)
    near, unstable = near and not too_long, assembly.instability > 1
    if sampled and (unstable or (code != BENT and not near and not too_long)):
        name = OUT_OF_REACH.get(code, "diverged") if near else "diverged"
        delay = f" and {counted(law.input_delay, 'sample')} of delay" if law.input_delay else ""
        acts, cure = "torques that are held act too late for these gains", "a shorter control period or lower gains"
        if scenario.joints.encoders.active and not unstable:
            acts, cure = "encoder steps taken for rates drive it", "more joints.encoders.counts or lower gains"
        return Status(
            name,
            f"The sampled control loop ran away just after t = {time:.3f} s: with a control period of "
            f"{number_text(law.control_period)} s{delay}, {acts}. {kept} Reset with {cure}.",
            time,
        )
    if code in OUT_OF_REACH and near:
        cure = "Reset, then use a smaller amplitude or higher gains."
        if law.kind == "none":
            cure = (
                "The motors are off (controller.kind = none): reset with a controller that holds the arms, or start at rest "
                "without gravity."
            )
        return Status(
            OUT_OF_REACH[code],
            f"The {arm_name(scenario, index)} left its workspace just after t = {time:.3f} s, near {_pose_text(pose)}: "
            f"its wrist is {distance:.3f} m from its base, {margin:.3f} m from "
            f"the limit of what it spans (up to {longest:.3f} m). {kept} {cure}",
            time,
        )
    if code == BENT:
        where = "at mid-span" if len(scenario.arms) == 2 else "of its free end"
        return Status(
            "diverged",
            f"The beam's deflection {where} exceeded the beam's length just after t = {time:.3f} s, "
            f"where the linear beam model means nothing. {kept} Reset with a stiffer beam, more damping or lower gains.",
            time,
        )
    cause, cure = _what_grew(assembly, time)
    text = f"The computation diverged just after t = {time:.3f} s: {cause}. {kept} Reset with {cure}."
    return Status("diverged", text, time)


def _is_too_long(assembly: Assembly) -> bool:
    """Whether a given step is too long for the beam in these arms: the motion of its ends is not propagated exactly."""
    if assembly.scenario.simulation.step is None or assembly.levels.integrator != "etdrk4":
        return False
    step, rates = assembly.levels.step, assembly.rates
    return step > rates.overdamped or step * rates.coupling > UNSTABLE_COUPLING


def _grew(assembly: Assembly, time: float) -> bool:
    """Whether errors of the steps have had time to grow by parametric resonance, in nearly undamped modes."""
    scenario, step = assembly.scenario, assembly.levels.step
    if assembly.levels.integrator != "etdrk4" or not may_resonate(assembly.beam, assembly.rates, step):
        return False
    middle = np.array(scenario.trajectory.middle)
    return growth_rate(assembly.system, assembly.beam, assembly.rates, middle, step) * time > LOUDER


def _what_grew(assembly: Assembly, time: float) -> tuple[str, str]:
    """Why the computation diverged by `time`, s, as far as the steps explain it, and what to do."""
    step, given = assembly.levels.step, assembly.scenario.simulation.step is not None
    if _is_too_long(assembly):
        return (
            f"steps of {number_text(step, 2)} s are too long for the modes of this beam, in arms that give way to them",
            "an automatic step (simulation.step = null), a softer, lighter or less damped beam, or fewer elements",
        )
    if _grew(assembly, time):
        cure = "some damping (payload.damping), fewer elements or a softer beam"
        return (
            "errors of the steps grew in nearly undamped modes",
            f"a shorter step (simulation.step), {cure}" if given else cure,
        )
    return (
        "a state is no longer a finite number",
        "lower gains or a shorter step (simulation.step)" if given else "lower gains",
    )


SURE = 1.01
"""Factor on the least elbow sine beyond which rounding cannot matter."""


def check_trajectory(scenario: Scenario) -> Status | None:
    """The fault of the first desired pose that an arm cannot take, over the whole path; None if all can be taken."""
    if _surely_reached(scenario):
        return None
    path, motion = scenario.trajectory, build_motion(scenario.trajectory)
    if path.span == 0:
        return pose_fault(scenario, desired_at(motion, 0.0)[0], 0.0, path.place_text(0.0))
    times = path.instants
    poses = desired_motions(motion, times)[:, 0]
    doubtful = np.zeros(len(times), bool)
    for index in range(len(scenario.arms)):
        l1, l2, _ = scenario.arms[index].link_length
        doubtful |= elbow_sine(wrist_reach(scenario, index, poses)[0], l1, l2) < SINGULAR_SINE
    for k in np.flatnonzero(doubtful)[:1]:
        return pose_fault(scenario, poses[k], float(times[k]), path.place_text(float(times[k])))
    return None


def _surely_reached(scenario: Scenario) -> bool:
    """Whether every pose of the path's bounding box keeps both wrists well inside the workspace.

    Most paths pass, and a slider sends twenty a second: a check of every instant takes milliseconds. A wrist moves at most as far
    as the pose's origin and the chord of its turn; the elbow's sine is least at an end of a range of distances.
    """
    path = scenario.trajectory
    x, y, turn = path.reach
    for index in range(len(scenario.arms)):
        arm = scenario.arms[index]
        l1, l2, l3 = arm.link_length
        chord = 2 * (scenario.payload.length / 2 + l3) * math.sin(min(turn, math.pi) / 2)
        middle, moved = float(wrist_reach(scenario, index, np.array(path.middle))[0]), math.hypot(x, y) + chord
        nearest, farthest = max(middle - moved, 0.0), middle + moved
        sines = elbow_sine(np.array([nearest, farthest]), l1, l2)
        if sines.min() < SURE * SINGULAR_SINE:
            return False
    return True


def same_reach(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios need the same reach, so that a check of one holds for the other."""
    return (
        one.trajectory == other.trajectory
        and one.payload.length == other.payload.length
        and one.left_arm == other.left_arm
        and one.right_arm == other.right_arm
    )
