"""Effects of clock, sensors and motors: aliasing, noise in the torques, chatter, saturation."""

import numpy as np

from flexlab.analysis.explanations.explanation import Evidence, n, register
from flexlab.analysis.explanations.growth import growing_pole
from flexlab.analysis.lesson_measures import largest, length, torque_jump, torque_turns
from flexlab.scenario.arms import JointMotor
from flexlab.sim.samples import Samples

LEAST_AMPLITUDE = 1e-8
"""Least amplitude of a line in the spectrum, m."""
NEAR = 0.02
"""Relative distance within which two frequencies count as one."""
SHAKEN = 10
"""Multiple of a path's own frequency up to which the path itself shakes the beam visibly."""


@register(
    "f_shown = |f − round(f T) / T| with T the time between samples (Nyquist: f < 1/(2T))",
    "Spectrum of the mid-span vibration",
    30,
)
def folded_mode(seen: Evidence) -> str | None:
    """The strongest line of the spectrum is a mode above half the sampling rate that folds down."""
    (hertz, amplitude), rate = seen.strongest, 1 / seen.period
    is_mode = any(abs(ring.frequency - hertz) < NEAR * hertz for ring in seen.background.rings.values())
    if amplitude < LEAST_AMPLITUDE or is_mode:
        return None
    if seen.moving and hertz * seen.scenario.trajectory.slowest_period < SHAKEN:
        return None
    fast = [(number, ring) for number, ring in seen.background.rings.items() if ring.frequency > rate / 2]
    shown = {number: abs(ring.frequency - round(ring.frequency / rate) * rate) for number, ring in fast}
    near = [(number, ring) for number, ring in fast if abs(shown[number] - hertz) < max(NEAR * hertz, 2 / seen.length)]
    if len(near) != 1:
        return None
    ((number, ring),) = near
    return (
        f"The line at {n(hertz)} Hz in the spectrum is mode {number} at {n(ring.frequency)} Hz: with samples every "
        f"{n(1e3 * seen.period)} ms, frequencies above {n(rate / 2)} Hz fold down. Nothing moves at {n(hertz)} "
        "Hz; a run with a shorter sample period shows the true frequency."
    )


LEAST_TORQUE_JUMP = 1.0
"""Least RMS jump of a joint torque per control period, N·m."""
FAINT = 0.1
"""Noise of s over its movement in a control period up to which the torques' jumps are chatter, not noise."""
WHITE = -0.3
"""Correlation of successive jumps up to which they count as noise; differences of white noise have -½."""


@register("τ = 𝒥⁻ᵀu(x + n_x, ẋ + n_v): noise times gain", "Joint torques", 14)
def noisy_torques(seen: Evidence) -> str | None:
    """Noisy sensors make the torques jump at random."""
    law = seen.scenario.controller
    if law.control_period is None or not law.sensor_noise.active or chatter(seen):
        return None
    growth = growing_pole(seen.background)
    if growth is not None and growth.rate * seen.length > 1:  # A loop that runs away jumps without noise, too.
        return None
    turns = torque_turns(seen.last_second, law.control_period)
    jump = torque_jump(turns)
    if jump < LEAST_TORQUE_JUMP or len(turns) < 32:
        return None
    likeness = float(np.sum(turns[1:] * turns[:-1]) / np.sum(turns**2))
    if likeness > WHITE:
        return None
    return (
        f"The torques jump by {n(jump)} N·m (RMS) from one control instant to the next, at random (each jump is followed by its "
        f"opposite, correlation {n(likeness)}): that is the sensors' noise times the gains. Better sensors, lower gains or an "
        "observer calm them."
    )


def _step(seen: Evidence) -> float:
    """How far s usually moves within a control period, m/s."""
    period = seen.scenario.controller.control_period or seen.period
    stride = max(1, round(period / seen.period))
    moves = np.diff(seen.last_second.sliding_variable[::stride], axis=0)
    return float(np.median(np.linalg.norm(moves, axis=1))) if len(moves) else 0.0


def _is_faint(seen: Evidence) -> bool:
    """Whether s moves so much that the noise of its measurement hardly matters, if there is any."""
    noise, slope = seen.scenario.controller.sensor_noise, seen.field("sliding_slope")
    if slope is None or noise.strain > 0 or any(noise.moment_rate):
        return not noise.active
    return float(np.linalg.norm([*noise.pose_rate, *(slope * np.array(noise.pose))])) <= FAINT * _step(seen)


CHATTER = 5.0
"""RMS jump of a joint torque per control period from which it counts as chatter, N·m; 0.5 is usual."""


@register("ū_3 = −Ψ s / max(‖s‖, ε), Eq. (25): s crosses ε within a control period", "Joint torques", 6)
def chatter(seen: Evidence) -> str | None:
    """Torques alternate from one control instant to the next, and s crosses its boundary layer within one control period."""
    law, layer = seen.scenario.controller, seen.field("boundary_layer")
    if law.control_period is None or layer is None or not _is_faint(seen):
        return None
    turns, step = torque_turns(seen.last_second, law.control_period), _step(seen)
    jump = torque_jump(turns)
    if jump < CHATTER or len(turns) < 8 or step < layer:
        return None
    if float(np.sum(turns[1:] * turns[:-1])) >= 0:
        return None
    return (
        f"The torques chatter by {n(jump)} N·m (RMS over the last second) at each instant of the "
        f"{n(1e3 * law.control_period)} ms clock: from one to the next, s moves by {n(step)} m/s, more than "
        f"its boundary layer of {n(layer)} m/s, so that every step overshoots. A thicker layer or a shorter control period "
        f"calms them."
    )


AT_LIMIT, AT_MOST = 1 - 1e-6, 0.99
"""Least shares of the controller's limit, and of what a motor, which lags, can give at its speed, of a limited torque."""
LEAST_SHARE = 0.005
"""Least share of the newest second at a limit."""
NAMES = ("left", "right")


@register("|τ_k| ≤ τ_max,k", "Joint torques", 5)
def torque_at_its_limit(seen: Evidence) -> str | None:
    """A joint's torque is at its limit; of several joints, the one that is at its limit longest."""
    limit, motor, span = seen.scenario.controller.torque_limit, seen.scenario.joints.motor, seen.last_second
    torque, allowed = np.abs(span.joint_torque), np.array(limit or (np.inf,) * 3)
    shares = np.mean([torque >= AT_LIMIT * allowed, torque >= AT_MOST * _possible(span, motor)], axis=1)
    by_motor, arm, joint = np.unravel_index(int(np.argmax(shares)), shares.shape)
    share = float(shares[by_motor, arm, joint])
    if share < LEAST_SHARE:
        return None
    held = f"is at its limit of {n(allowed[joint])} N·m"
    helps = "A slower path, a smooth start or a higher limit helps." if seen.moving else "A higher limit helps."
    if by_motor:
        held = f"gives all that a motor with τ_s = {n(motor.stall_torque[joint])} N·m can give at its speed"
        helps = "A slower path, a smooth start or a stronger motor helps." if seen.moving else "A stronger motor helps."
    # A limit may be all that keeps this loop from running away.
    if seen.background.modes.unstable or seen.scenario.grips.active:
        helps = ""
    return (
        f"Joint {joint + 1} of the {NAMES[arm]} arm {held} for "
        f"{n(100 * share)} % of the last {n(min(seen.length, 1.0))} s: the law can do no more there, and the "
        f"error reaches {length(largest(span.tracking_error[:, :2]))}. {helps}".rstrip()
    )


def _possible(span: Samples, motor: JointMotor) -> np.ndarray:
    """|τ|, N·m, that each motor can give at most in the direction of its torque (N, arms, 3): τ_s (1 ∓ θ̇/ω_0)."""
    if not any(motor.stall_torque) or len(span) < 2:
        return np.full(span.joint_torque.shape, np.inf)
    rates = np.gradient(np.unwrap(span.joint_angle, axis=0), span.time, axis=0)
    stall = np.where(np.array(motor.stall_torque) > 0, motor.stall_torque, np.inf)
    return stall * (1 - np.sign(span.joint_torque) * rates / np.array(motor.no_load_speed))
