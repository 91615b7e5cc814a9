"""Forces in beam and arms: the squeeze between the arms, the axial load, weight, and arms nearly stretched or folded."""

import numpy as np

from flexlab.analysis.explanations.explanation import Evidence, n, register
from flexlab.analysis.lesson_measures import largest, length, newest
from flexlab.sim.run_warnings import Largest, Peaks, model_warning
from flexlab.sim.termination import arm_name

UNEXPLAINED = 0.5
"""Largest share of the internal force, RMS, that may remain unexplained."""
LEAST_FORCE = 0.1
"""Least internal force, RMS, that is explained, N."""


@register("F_1 = (α − ½) f + what the postures differ by, Eqs. (14), (15)", "Internal force", 26)
def load_share(seen: Evidence) -> str | None:
    """An uneven load share causes most of the internal force."""
    span, share = seen.steady, seen.scenario.controller.load_share
    if span is None or share == 0.5 or len(seen.scenario.arms) < 2 or seen.scenario.controller.wanted_internal_force:
        return None
    force = span.internal_force[:, 0, :2]
    predicted = (share - 0.5) * 2 * span.moving_force[:, :2]
    parts = force, force - predicted, predicted
    size, rest, made = (float(np.sqrt((part**2).sum(axis=1).mean())) for part in parts)
    if size < LEAST_FORCE or rest > UNEXPLAINED * size:
        return None
    law, rigid = seen.scenario.controller, seen.scenario.payload.axial_load == "none" and not seen.scenario.grips.active
    # Held, late or limited torques are those of joints: what two arms make of them depends on their postures.
    exact = law.control_period is None and law.torque_limit is None and not seen.scenario.joints.motor.active
    changes = " and changes no motion" if rigid and exact else ""
    return (
        f"The arms press against each other with {n(size)} N (RMS), and {n(made)} N of it comes from the load share: the left "
        f"arm gives {n(100 * share)} % of the force that moves the payload. α = 0.5 removes that part{changes}."
    )


WANTED_AGREES = 0.1
"""Largest relative difference of the mean from the wanted force."""
CANCELLED = 1e-6
"""Largest sum of both internal forces that is rounding error, N and N·m."""


@register("u_1 += F_d (cos θ, sin θ, 0), u_2 −= the same: F_1 + F_2 = 0", "Internal force", 27)
def wanted_force(seen: Evidence) -> str | None:
    """The internal force along the link is, on average, the wanted one."""
    span, wanted = seen.steady, seen.scenario.controller.wanted_internal_force
    if span is None or wanted == 0 or len(seen.scenario.arms) < 2:
        return None
    angle, force = span.pose[:, 2], span.internal_force
    along = force[:, 0, 0] * np.cos(angle) + force[:, 0, 1] * np.sin(angle)
    if abs(float(along.mean()) - wanted) > WANTED_AGREES * abs(wanted) or np.abs(force.sum(axis=1)).max() > CANCELLED:
        return None
    acts, moves = "squeeze" if wanted > 0 else "stretch", "; it moves nothing, as the two internal forces cancel."
    if seen.scenario.grips.active:
        moves = "."
    elif seen.scenario.payload.axial_load != "none":
        moves = "; it moves no grip, as the two internal forces cancel, but changes how the beam bends."
    return (
        f"The arms {acts} the payload with {n(abs(float(along.mean())))} N along the link because F_d = {n(wanted)} N is wanted"
        f"{moves}"
    )


@register("P_cr = c π²EI/L²; K_G = ∫N N'ᵀN' ds", "Axial load beside P_cr", 6)
def axial_load(seen: Evidence) -> str | None:
    """The beam's model neglects an axial load that matters, or is not valid at this load."""
    samples = seen.samples
    load, spin = (Largest().among(each, samples.time) for each in (samples.axial_load_share, samples.spin_share))
    peaks = Peaks(load_share=load, spin_share=spin)
    return model_warning(seen.scenario.payload, peaks).text or None


BENDING_AGREES = 0.1
"""Largest relative difference of the mean bending from the weight's."""


@register("w(0) = −5 ρ g L⁴ cos θ / (384 EI), pinned grips", "Mid-span deflection", 25)
def bending_by_weight(seen: Evidence) -> str | None:
    """The mean quasi-static deflection is that of a beam on two pins under its weight, and larger than the vibration."""
    beam, gravity = seen.scenario.payload, seen.scenario.gravity
    if seen.steady is None or gravity == 0 or beam.boundary != "pinned-pinned":
        return None
    whole = max(seen.period, seen.scenario.trajectory.slowest_period)
    span = newest(seen.samples, whole) if seen.moving else seen.steady
    sag = 5 * beam.linear_density * gravity * beam.length**4 / (384 * beam.bending_stiffness)
    held = sag * float(np.mean(np.cos(span.desired_pose[:, 2])))
    mean = float(np.mean(span.quasi_static_deflection))
    if abs(mean + held) > BENDING_AGREES * abs(held):
        return None
    more, rest = float(np.mean(span.vibration)), span.vibration
    along = ""
    if beam.axial_load != "none" and abs(more) > BENDING_AGREES * abs(held):
        along = "The force along the beam adds " if more * held < 0 else "The force along the beam takes away "
        along += f"{length(abs(more))}. "
        rest = rest - more
    if largest(rest) > abs(held):  # The weight is not what bends this beam.
        return None
    return (
        f"The weight bends the beam by {length(abs(held))}, at rest and in motion, out of "
        f"{length(largest(span.midspan_deflection))} in all; only {length(largest(rest))} of that is vibration. "
        f"{along}No law can remove the weight's part."
    )


NEAR = 0.3
"""Sine of the elbow angle, 17°, below which an arm counts as nearly singular."""


@register("det J_i = l_1 l_2 sin θ_2, Eq. (12)", "Joint torques", 12)
def nearly_singular_arm(seen: Evidence) -> str | None:
    """The arm whose elbow came closest to straight in the newest second."""
    elbow = seen.last_second.joint_angle[:, :, 1]
    instant, index = map(int, np.unravel_index(int(np.argmin(np.abs(np.sin(elbow)))), elbow.shape))
    angle = float(elbow[instant, index])
    sine = abs(np.sin(angle))
    if sine >= NEAR:
        return None
    posture = "stretched" if np.cos(angle) > 0 else "folded"
    torque = largest(seen.last_second.joint_torque[:, index])
    # Where motors are off, the path does not matter.
    helps = "" if seen.background.around is None else " A smaller path, or one nearer to the bases' middle, helps."
    return (
        f"The elbow of the {arm_name(seen.scenario, index)} comes within {n(np.degrees(np.arcsin(sine)))}° of {posture}: there "
        f"joint rates grow as 1/sin θ₂ = {n(1 / max(sine, 1e-6))}, and its torques reach {n(torque)} N·m.{helps}"
    )
