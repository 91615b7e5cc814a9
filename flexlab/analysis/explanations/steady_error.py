"""The error in steady motion, and bound estimates that drift under noise."""

from functools import lru_cache
from typing import Any

import numpy as np

from flexlab.analysis.explanations.explanation import STEADY, Evidence, n, register
from flexlab.analysis.explanations.growth import lateness
from flexlab.analysis.explanations.measured_signals import torque_at_its_limit
from flexlab.analysis.law_conditions import circumstances
from flexlab.analysis.lesson_measures import bound_terms, largest, length
from flexlab.analysis.modes import POSE
from flexlab.control.conditions import Circumstances, stability_limit
from flexlab.control.controller import Controller
from flexlab.control.law import laws
from flexlab.errors import ScenarioError
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples

WORTH = 1e-5
"""Least error that is explained, m."""
OFTEN = 0.05
"""Least share of the time with s outside its layer."""
AGREES = (0.4, 1.25)
"""Range of measured over predicted error; the prediction is a bound for a slow motion."""
SWIFT, TOO_SWIFT = 0.25, 0.5
"""Shares of a sampled loop's stability limit above which s leaves the layer again: for up to 15 % and for most of the time."""
BENDS_LATE = 0.05
"""Vibration over deflection above which a beam is so soft that its reaction exceeds that of a slow motion."""
FASTEST = 1000.0
"""Largest ‖s‖, m/s, at which a feedback gain is still said to hold a force."""


def _layer(seen: Evidence) -> tuple[Samples, float, Circumstances] | None:
    """The steady motion, the width of the law's boundary layer, m/s, and the circumstances, if there are all three."""
    span, width, around = seen.steady, seen.field("boundary_layer"), seen.background.around
    return None if span is None or width is None or around is None else (span, width, around)


def _error(span: Samples) -> float:
    """Largest distance from the path, m."""
    return float(np.linalg.norm(span.tracking_error[:, :2], axis=1).max())


def _agrees(error: float, predicted: float) -> bool:
    """Whether an error is large enough for a sentence, and agrees with the prediction."""
    return error >= WORTH and AGREES[0] * predicted < error < AGREES[1] * predicted


@register("K ‖s‖ = ‖Ψ‖, inside only if ‖Ψ‖ ≤ K ε", "Sliding variable s", 13)
def outside_the_boundary_layer(seen: Evidence) -> str | None:
    """The feedback is too weak for the beam's reaction, so that s leaves its layer in steady motion."""
    found, gain = _layer(seen), seen.field("feedback_gain")
    if found is None or gain is None:
        return None
    span, layer, around = found
    size = np.linalg.norm(span.sliding_variable, axis=1)
    share, force = float((size > layer).mean()), around.largest_reaction
    # An s much larger than this force can cause has another cause, such as torques at their limits.
    if share < OFTEN or force <= gain * layer or gain * float(size.max()) > AGREES[1] * force:
        return None
    held = f"alone holds that at {n(force / gain)} m/s" if force < FASTEST * gain else "alone does not hold that"
    return (
        f"‖s‖ is outside its boundary layer of {n(layer)} m/s for {n(100 * share)} % of the last second, up to "
        f"{n(float(size.max()))} m/s: the beam asks for ‖Ψ‖ = {n(force)} N, and K = {n(gain)} N·s/m "
        f"{held}.{_back_inside(seen, span, force / layer)}"
    )


@lru_cache(maxsize=32)
def _fastest_rate(scenario: Scenario) -> float:
    """Fastest rate of a scenario's loop, 1/s; kept, as a lab explains several times a second."""
    return circumstances(scenario).fastest_rate


def _share_of_limit(rate: float, law: Controller) -> float:
    """λT_c of a loop with this fastest rate, 1/s, over the largest of a stable one; 0 for a continuous law."""
    return rate * (law.control_period or 0.0) / stability_limit(law.input_delay)


def _unknown_friction(seen: Evidence) -> bool:
    """Whether the law does not make up for the friction of the joints."""
    return seen.scenario.joints.friction.active and seen.scenario.controller.model.friction_factor != 1


def _back_inside(seen: Evidence, span: Samples, needed: float) -> str:
    """A sentence after a space: what brings s back inside its layer, `needed`: the K for it, N·s/m; or why nothing does.

    "" if more than the beam's reaction may keep it outside: friction that the law does not know, grips that give way, or limits.
    """
    law, joints = seen.scenario.controller, seen.scenario.joints
    if _unknown_friction(seen) or seen.scenario.grips.active or joints.motor.active or law.torque_limit is not None:
        return ""
    also = ""
    if seen.field("adaptation") is not None:
        also = " or faster adaptation"
    elif seen.field("bound") is not None:
        also = " or a larger ρ̂"
    part = "controller" if hasattr(law, "feedback_gain") else "controller.slow"
    try:
        raised: Any = seen.scenario.replace({f"{part}.feedback_gain": needed})  # Any: pydantic makes it hashable.
    except ScenarioError:
        return f" That would take K = {n(needed)} N·s/m, more than K may be: the path has to ask for less."
    share = _share_of_limit(_fastest_rate(raised), law)
    if share > TOO_SWIFT:
        return (
            f" K above {n(needed)} N·s/m would bring it back inside, but torques that come so late make a loop that fast "
            f"overshoot or diverge: the control period of {n(1e3 * law.control_period)} ms has to be shorter first."
        )
    bends_late = largest(span.vibration) > BENDS_LATE * largest(span.midspan_deflection)
    end = "brings it back inside most of the time" if share > SWIFT or bends_late else "brings it back inside"
    return f" K above {n(needed)} N·s/m{also} {end}."


def _late_force(seen: Evidence, around: Circumstances) -> float:
    """The largest change of the motion's force, B ẍ_d + C̄ ẋ_d, while a torque is on its way, N."""
    if len(around.instants) < 3:
        return 0.0
    rate = np.gradient(seen.background.inertial_force, around.instants, axis=0)
    return float(np.linalg.norm(rate, axis=1).max()) * lateness(seen.background)


def _cures(seen: Evidence, around: Circumstances, gains: str) -> str:
    """Sentences on what makes the error smaller, each after a space; `gains`: those that do."""
    if seen.scenario.grips.active:  # The loop's rates are those of rigid grips.
        return ""
    law, truth = seen.scenario.controller, seen.background.informed
    wrong = 0.0 if truth is None else np.linalg.norm(around.reaction - truth.reaction, axis=1).max(initial=0.0)
    # Feed-forward leaves the force of a wrong mass, and friction that the law does not know.
    knows = wrong <= WRONG * around.largest_reaction and not _unknown_friction(seen)
    stable = _share_of_limit(2 * around.fastest_rate, law) < 1
    if stable and knows:
        return f" Twice the {gains} nearly halves it; feed-forward of the bending removes its cause."
    if stable:
        return f" Twice the {gains} nearly halves it."
    return " Feed-forward of the bending removes its cause." if knows else ""


WRONG = 0.2
"""Largest share of a wrong model in the reaction with which feed-forward of the bending counts as the cure."""
LATE, MOST_LATE = 0.3, 0.7
"""Force of late torques over the beam's reaction from which it counts beside it, and up to which the reaction is the cause."""
ALONE = 0.8
"""Least share of K in the feedback at which twice the K nearly halves the error."""
FADED = 3.0
"""Least decay of the slowest motion of the pose before the steady second, as the exponent of e."""


def _has_settled(seen: Evidence) -> bool:
    """Whether what the start or a change left of the pose's own motion has faded before the steady second."""
    modes = seen.background.modes
    rates = [-pole.real for pole, origin in zip(modes.poles, modes.pole_origin, strict=True) if origin == POSE]
    return min(rates, default=np.inf) * (seen.length - STEADY) > FADED


@register("‖e‖ ≤ ‖s‖/Λ, ‖s‖ ≤ ‖Ψ‖/(K + ρ/ε)", "Tracking error", 24)
def error_within_the_layer(seen: Evidence) -> str | None:
    """The error is the beam's reaction divided by the feedback inside the layer."""
    found, slope = _layer(seen), seen.field("sliding_slope")
    if found is None or slope is None or not seen.moving or not _has_settled(seen):
        return None
    span, layer, around = found
    if seen.scenario.trajectory.bending_feedforward or seen.field("feedback_gain") is None:
        return None
    # K + ρ/ε; ρ: the constant bound, or the smallest learnt one.
    gain, bound = seen.field("feedback_gain", 0.0) or 0.0, seen.field("bound")
    if bound is None:
        learnt = np.sum(span.bound_estimates * bound_terms(span.pose, span.pose_rate), axis=1)
        bound = float(learnt.min()) if np.isfinite(learnt).all() else 0.0
    stiffness = gain + bound / layer
    if stiffness * slope * around.largest_reaction == 0:  # A motion along a beam that does not turn has no reaction.
        return None
    error = _error(span)
    predicted = around.largest_reaction / (stiffness * slope)
    inside = float(np.linalg.norm(span.sliding_variable, axis=1).max()) <= layer
    delayed = _late_force(seen, around) / around.largest_reaction
    if not inside or not _agrees(error, predicted) or delayed > MOST_LATE:
        return None
    pure = error <= predicted and delayed <= LATE
    share, limit = ("", "at most") if pure else ("mostly ", "for a slow motion")
    cures = _cures(seen, around, "K or Λ" if gain >= ALONE * stiffness else "Λ")
    if delayed > LATE:
        cures += f" Torques that come {n(1e3 * lateness(seen.background))} ms late add to it."
    return (
        f"The error of {length(error)} is {share}the beam's reaction divided by the feedback: "
        f"‖Ψ‖ = {n(around.largest_reaction)} N divided by {n(stiffness)} N·s/m and Λ = {n(slope)} 1/s "
        f"give {length(predicted)} {limit}."
        f"{cures}"
    )


@register("P e ≈ −(B ẍ_d + C̄ ẋ_d + D ė)", "Tracking error", 23)
def error_of_feedback_alone(seen: Evidence) -> str | None:
    """The position gain of pd, a spring, supplies the force that the motion's inertia needs."""
    span, around, law = seen.steady, seen.background.around, seen.scenario.controller
    gain = seen.field("position_gain")
    if law.kind != "pd" or not gain or span is None or around is None or not seen.moving:
        return None
    predicted = float(np.linalg.norm(seen.background.inertial_force[:, :2], axis=1).max()) / gain
    error = _error(span)
    if not _agrees(error, predicted):
        return None
    return (
        f"The error of {length(error)} is how far the motion's inertia, {n(predicted * gain)} N, stretches the spring P = "
        f"{n(gain)} N/m: {length(predicted)} for a slow motion. A law that knows the inertia, such as computed-torque, needs "
        "none."
    )


@register("Ψ = (B_true − B_believed) ẍ_d + the weight's difference", "Tracking error", 15)
def wrong_payload(seen: Evidence) -> str | None:
    """The controller's wrong model of the beam leaves more to the feedback."""
    now, truth, span = seen.background.around, seen.background.informed, seen.steady
    if now is None or truth is None or span is None or now.largest_reaction < 1.2 * truth.largest_reaction:
        return None
    law = seen.scenario.controller
    kind = getattr(law, "slow", law).kind
    if not laws()[kind].relies_on_masses:
        return None
    model, error = law.model, largest(span.tracking_error[:, :2])
    if error < WORTH or torque_at_its_limit(seen):
        return None
    wrong = [f"{n(model.linear_density_factor)} times as heavy"] if model.linear_density_factor != 1 else []
    wrong += [f"{n(model.length_factor)} times as long"] if model.length_factor != 1 else []
    return (
        f"The controller takes the beam to be {' and '.join(wrong)} as it is: the force that its model leaves to the feedback "
        f"grows from {n(truth.largest_reaction)} N to {n(now.largest_reaction)} N, and the error is {length(error)}. "
        "The law regressor-adaptive learns the masses instead."
    )


GROWTH_WORTH = 1e-4
"""Least growth of b̂_0 that is explained, N/s."""
STANDS = 0.05
"""Largest relative change of a constant b̂_0 within a second."""
NOISELESS = 0.6
"""Largest share of the measured ‖s‖ that the true one may have for noise to be the cause; 0.44 of a payload that is held."""
BALANCES = 0.3
"""Largest relative difference of balanced growth and leakage."""


def _growth(seen: Evidence) -> tuple[float, float, float, float] | None:
    """b̂_0 now, N, its change, N/s, k_0, and the mean ‖s‖, m/s; None without estimates or steady motion."""
    adaptation = getattr(seen.scenario.controller, "adaptation", None)
    if adaptation is None or seen.steady is None or not np.isfinite(seen.steady.bound_estimates).all():
        return None
    estimate = seen.steady.bound_estimates[:, 0]
    span = float(seen.steady.time[-1] - seen.steady.time[0])
    size = float(np.linalg.norm(seen.steady.sliding_variable, axis=1).mean())
    return float(estimate[-1]), float(estimate[-1] - estimate[0]) / span, float(adaptation[0]), size


@register("ḃ_0 = ‖s‖/k_0 ≥ 0, Eq. (23)", "Bound estimates b̂", 16)
def drifting_estimates(seen: Evidence) -> str | None:
    """Noise keeps ‖s‖ above zero, so that estimates grow without need."""
    found, law = _growth(seen), seen.scenario.controller
    if found is None or law.leakage > 0 or not law.sensor_noise.active:
        return None
    now, rate, k0, size = found
    if rate < GROWTH_WORTH or not size < NOISELESS * rate * k0:
        return None
    return (
        f"b̂₀ = {n(now)} N grows by {n(rate)} N each second and never shrinks: noise keeps the measured ‖s‖ at "
        f"{n(rate * k0)} m/s. Leakage is the cure: σ = {n(rate / now)} 1/s would hold it where it is."
    )


@register("ḃ_0 = ‖s‖/k_0 − σ b̂_0 = 0 at b̂_0 = ‖s‖/(σ k_0)", "Bound estimates b̂", 28)
def leaking_estimates(seen: Evidence) -> str | None:
    """Leakage and growth balance at ‖s‖/(σ k_0)."""
    found, law = _growth(seen), seen.scenario.controller
    if found is None or law.leakage <= 0:
        return None
    now, rate, k0, size = found
    balance = size / (law.leakage * k0)
    if now == 0 or abs(rate) > STANDS * now:  # Nothing has been learnt, as in a run at exact rest.
        return None
    if not law.sensor_noise.active and abs(now - balance) > BALANCES * balance:
        return None
    return (
        f"b̂₀ stands at {n(now)} N instead of growing: leakage σ = {n(law.leakage)} 1/s takes from it what ‖s‖ adds, "
        f"{n(now * law.leakage)} N each second. A larger σ holds it lower, and forgets sooner what was learnt."
    )
