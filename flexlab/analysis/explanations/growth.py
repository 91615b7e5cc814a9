"""Growing motions and their causes: late torques, a loop as fast as the beam, an unobserved mode; and small margins."""

import numpy as np

from flexlab.analysis.explanations.explanation import Background, Evidence, n, register
from flexlab.analysis.modes import PoleRow
from flexlab.analysis.stability import NEUTRAL
from flexlab.control.conditions import stability_limit
from flexlab.text import counted

AGREES = 2.5
"""Factor within which the growth of the mode alone must agree with the loop's if the delay is the cause."""
ROUNDING = 1e-6
"""Relative tolerance of a limit that is met exactly."""
STILL = 1e-12
"""Largest error and vibration of a run that nothing has moved, m and rad."""


def growing_pole(background: Background) -> PoleRow | None:
    """The fastest growing pole; None if no pole grows, or if the grips give way: poles are those of rigid ones."""
    found = background.fastest
    return None if background.scenario.grips.active or found is None or found.rate <= NEUTRAL else found


def observer_of(background: Background):
    """The law's Kalman observer, if any."""
    observer = getattr(background.scenario.controller, "observer", None)
    return observer if hasattr(observer, "observer_modes") else None


def lateness(background: Background) -> float:
    """Mean delay of held torques, (d + ½) T_c, s, less an observer's prediction; 0 for a continuous law."""
    law, observer = background.scenario.controller, observer_of(background)
    if law.control_period is None:
        return 0.0
    late = law.input_delay + 0.5
    if observer is not None:
        # lqr predicts over its delay only, as its model has held torques.
        usual = late if hasattr(law, "slow") else law.input_delay
        late -= usual if observer.horizon is None else observer.horizon
    return max(0.0, late) * law.control_period


def _growth_alone(background: Background, mode: int, late: float) -> float:
    """Growth of a mode alone under rate feedback with a delay of `late` s, 1/s."""
    around, law = background.around, background.scenario.controller
    if around is None or law.control_period is None:
        return 0.0
    at = int(np.argsort(around.omega)[mode - 1])
    gains = (getattr(law, "lateral_vibration_gain", 0.0), getattr(law, "angular_vibration_gain", 0.0))
    strength = gains[0] * around.loads[0, at] ** 2 + gains[1] * around.loads[1, at] ** 2
    omega = around.omega[at]
    reaching = np.sinc(omega * law.control_period / (2 * np.pi)) * np.cos(omega * late)
    return float(-0.5 * strength * reaching - 0.5 * around.damping[at])


def _not_begun(seen: Evidence) -> str:
    """A further sentence for a run at exact rest, from which nothing grows; "" if the run moves."""
    samples = seen.samples
    moved = max(np.abs(samples.tracking_error).max(), np.abs(samples.vibration).max())
    return " Nothing has moved this run yet." if moved < STILL else ""


@register(
    "η̈ + Dη̇ + ω²η = −k h²η̇(t − (d + ½) T_c): fed where cos(ω (d + ½) T_c) < 0; poles log(z)/T_c",
    "Spectrum of the mid-span vibration",
    0,
)
def growing_mode(seen: Evidence) -> str | None:
    """Late rate feedback feeds a beam mode."""
    growth, late = growing_pole(seen.background), lateness(seen.background)
    observer = observer_of(seen.background)
    if growth is None or not growth.mode or late == 0 or (observer and growth.mode > observer.observer_modes):
        return None
    alone = _growth_alone(seen.background, growth.mode, late)
    if not growth.rate / AGREES < alone < growth.rate * AGREES:
        return None
    law = seen.scenario.controller
    fed_from = 1 / (4 * late)
    shorter = law.control_period * fed_from / growth.frequency
    more = 100 * growth.rate / (2 * np.pi * growth.frequency)
    better = "an observer that predicts over the delay" if observer else "the predicting observer (composite, kalman)"
    return (
        f"{n(growth.frequency)} Hz grows at {n(growth.rate)} 1/s: mode {growth.mode}, because the torque comes "
        f"{n(1e3 * late)} ms late, which feeds modes from {n(fed_from)} Hz on. A damping ratio larger by {n(more)} "
        f"percentage points, a control period below {n(1e3 * shorter)} ms, or {better} helps.{_not_begun(seen)}"
    )


@register(
    "x(k+1) = x(k) − λT_c x(k−d): stable up to λT_c = 2 sin(π/(2 (2d + 1))) (Levin and May 1976)", "Tracking error", 1
)
def growing_pose(seen: Evidence) -> str | None:
    """The control period is too long for the feedback of the pose."""
    growth, around = growing_pole(seen.background), seen.background.around
    law = seen.scenario.controller
    if growth is None or growth.mode or around is None or law.control_period is None:
        return None
    product, limit = around.fastest_rate * law.control_period, stability_limit(law.input_delay)
    if product <= (1 + ROUNDING) * limit:
        return None
    return (
        f"The pose runs away at {n(growth.rate)} 1/s: feedback at {n(around.fastest_rate)} 1/s is updated every "
        f"{n(1e3 * law.control_period)} ms with {counted(law.input_delay, 'sample')} of delay, λT_c = {n(product)} above "
        f"{n(limit)}. A control period below {n(1e3 * limit / around.fastest_rate)} ms or lower gains help.{_not_begun(seen)}"
    )


@register(
    "det(sI − A) = 0 has a root with Re s > 0, A: arms, beam and law about their rest point", "Mid-span deflection", 4
)
def growing_loop(seen: Evidence) -> str | None:
    """The loop grows for another reason: the beam buckles, or the loop is probably as fast as the beam."""
    growth, around, observer = growing_pole(seen.background), seen.background.around, observer_of(seen.background)
    if growth is None or growing_mode(seen) or growing_pose(seen):
        return None
    if growth.mode and growth.frequency == 0 and seen.scenario.payload.axial_load != "none":
        return (
            f"Mode {growth.mode} grows at {n(growth.rate)} 1/s without oscillating: the force along the beam at rest is larger "
            f"than the beam withstands. Less force along it, or a stiffer beam, helps.{_not_begun(seen)}"
        )
    if observer and growth.mode > observer.observer_modes:
        return None
    what = f"mode {growth.mode}" if growth.mode else "pose and law"
    moving = f"{n(growth.frequency)} Hz" if growth.frequency else "A motion that does not oscillate"
    cause = ""
    if around is not None and around.slow_rate > np.min(around.omega):
        cause = (
            f", as the law's loop, {n(around.slow_rate)} 1/s, is faster than the beam's first mode, "
            f"{n(float(np.min(around.omega)))} 1/s, which it takes for rigid"
        )
    return (
        f"{moving} grows at {n(growth.rate)} 1/s: {what}, a pole of arms, beam and law together{cause}. Lower gains or more "
        f"damping help.{_not_begun(seen)}"
    )


@register(
    "y = C_o z_o + C_r z_r: what gauges see of modes r outside the model enters the estimate of those in it (Balas 1978)",
    "Spectrum of the mid-span vibration",
    3,
)
def spillover(seen: Evidence) -> str | None:
    """The growing mode is not part of the observer's model."""
    growth, observer = growing_pole(seen.background), observer_of(seen.background)
    if growth is None or growth.frequency == 0 or observer is None or growth.mode <= observer.observer_modes:
        return None
    period = seen.scenario.controller.control_period
    shown = abs(growth.frequency - round(growth.frequency * period) / period)
    folded = f", at {n(shown)} Hz with a clock of {n(1 / period)} Hz" if growth.frequency > 0.5 / period else ""
    more = 100 * growth.rate / (2 * np.pi * growth.frequency)
    cure = f"A damping ratio larger by {n(more)} percentage points or a larger weight of the force helps."
    if hasattr(seen.scenario.controller, "slow"):
        cure = f"A damping ratio larger by {n(more)} percentage points or lower vibration gains help."
    return (
        f"Mode {growth.mode}, {n(growth.frequency)} Hz, grows at {n(growth.rate)} 1/s: the observer models "
        f"{counted(observer.observer_modes, 'mode')}, but the gauges also see this one{folded} (spillover). {cure}"
        f"{_not_begun(seen)}"
    )


SMALL = 30.0
"""Phase margin of all motors below which it counts as small, °, as in textbooks."""


def _widened(seen: Evidence, frequency: float) -> str:
    """What makes a margin larger that is smallest at `frequency`, Hz."""
    law, slope = seen.scenario.controller, seen.field("sliding_slope")
    if law.kind == "lqr":
        both = "A larger weight of the force or less delay widens it."
        return both if law.input_delay else "A larger weight of the force widens it."
    # Below the rates of the feedback, the adaptation is too fast for it.
    if law.kind == "regressor-adaptive" and 2 * np.pi * frequency < (slope or 0.0):
        return "Lower adaptation gains or a larger K widen it."
    # Rates that come less late may feed the mode that they damped.
    if law.control_period is None or hasattr(law, "lateral_vibration_gain"):
        return "Lower gains widen it."
    sooner = "Lower gains or a shorter control period widen it."
    return "Lower gains or less delay widen it." if law.input_delay else sooner


@register("α = 1/max ρ((S − T)/2), the disk margin of all motors alike", "Tracking error", 18)
def small_margin(seen: Evidence) -> str | None:
    """A stable loop with a small disk margin."""
    found = seen.background.modes
    margin = found.disk_margin
    if margin is None or found.unstable or not 0 < margin.alike.alpha < 2 or margin.alike.phase >= SMALL:
        return None
    if seen.scenario.grips.active:  # The margin is that of rigid grips.
        return None
    low, high = margin.alike.gain
    frequency = margin.alike.frequency
    late = 1e3 * margin.alike.phase / 360 / frequency
    return (
        f"The loop is nearly unstable at {n(frequency)} Hz: it tolerates no more than a factor of {n(low)} to {n(high)} on all "
        f"motors, or ±{n(margin.alike.phase)}°, which is {n(late)} ms there. {_widened(seen, frequency)}"
    )


@register("the law's stability conditions, below its gains", "Sliding variable s", 40)
def condition_not_met(seen: Evidence) -> str | None:
    """A condition of the law is not met, although all poles decay."""
    unmet = [each for each in seen.background.conditions if each.of_stability and not each.met]
    if not unmet or seen.background.modes.unstable:
        return None
    return f"The stability proof does not apply here, as one of its conditions is not met: {unmet[0].sentence}"
