"""Free and forced vibration: the mode that rings and its decay, its excitation, and the residual vibration of a motion."""

import numpy as np

from flexlab.analysis.explanations.explanation import Evidence, n, register
from flexlab.analysis.explanations.growth import lateness
from flexlab.analysis.lesson_measures import largest, length, newest, ring_frequency
from flexlab.analysis.metrics.run_metrics import between
from flexlab.analysis.metrics.vibration import FOLLOWS, ResidualVibration
from flexlab.analysis.modes import Ring
from flexlab.control.motion import TOLERATED
from flexlab.sim.samples import Samples

RINGING = 2e-5
"""Least vibration of a ring, m."""
FADED = 0.03
"""Share of its peak down to which a ring is measured."""
FREQUENCY_AGREES, RATE_AGREES = 0.03, 0.3
"""Largest relative differences of frequency and rate between a ring and its pole."""
FEWEST_PERIODS = 4
DAMPED = 1.5
"""Least decay rate of an actively damped mode over its decay rate with grips held."""


def ringing_part(samples: Samples) -> Samples | None:
    """The samples from the largest vibration until it has faded; None if it does not fade, or there is none."""
    size = np.abs(samples.vibration)
    peak = int(np.argmax(size))
    if size[peak] < RINGING:
        return None
    end = peak + int(np.flatnonzero(size[peak:] > FADED * size[peak])[-1]) + 1
    if end - peak < 16 or largest(samples.vibration[(peak + end) // 2 : end]) > 0.8 * size[peak]:
        return None
    return samples.slice(peak, end)


def fading_rate(samples: Samples, hertz: float) -> float:
    """d ln(amplitude)/dt of a ring, 1/s, from the largest magnitude of each period; NaN for fewer than four periods."""
    count = int((samples.time[-1] - samples.time[0]) * hertz)
    if count < FEWEST_PERIODS:
        return float("nan")
    parts = np.array_split(np.arange(len(samples)), count)
    tops = [part[np.argmax(np.abs(samples.vibration[part]))] for part in parts]
    return float(np.polyfit(samples.time[tops], np.log(np.abs(samples.vibration[tops])), 1)[0])


@register("w ~ exp(−ζωt) cos(ωt): the pole −ζω ± iω of the closed loop", "Mid-span deflection", 20)
def ring(seen: Evidence) -> str | None:
    """A ring agrees in frequency and decay with a mode's pole."""
    part = ringing_part(seen.samples)
    if part is None:
        return None
    hertz = ring_frequency(part)
    found = [(abs(each.frequency - hertz), number, each) for number, each in seen.background.rings.items()]
    if not found:
        return None
    away, number, mode = min(found)
    rate = fading_rate(part, hertz)
    if not (rate < 0 and mode.rate < 0):
        return None
    if away > max(FREQUENCY_AGREES * hertz, 1 / seen.length) or abs(rate / mode.rate - 1) >= RATE_AGREES:
        return None
    peak = largest(part.vibration)
    return (
        f"From t = {part.time[0]:.2f} s on the beam rings at {n(hertz)} Hz by up to {length(peak)}: mode {number}, free, as it "
        f"fades at {n(-rate)} 1/s, to 1 % in {n(np.log(100) / -rate)} s{_by_what(seen, number, mode)}."
    )


def _by_what(seen: Evidence, number: int, mode: Ring) -> str:
    found = seen.background.modes
    own = 2 * np.pi * float(found.frequency[number - 1] * found.damping_ratio[number - 1])
    held = f"; with its grips held it would fade at {n(own)} 1/s"
    if -mode.rate > DAMPED * own:
        drives, rubs = seen.background.around is not None, any(seen.scenario.joints.friction.viscous)
        if drives:
            return f"{held}, so the law and the joints' friction damp it" if rubs else f"{held}, so the law damps it"
        return f"{held}, so the joints' friction damps it" if rubs else held
    damps = hasattr(seen.scenario.controller, "lateral_vibration_gain")
    # Rates that come a sixth of a period late damp half as much, and those that come a quarter late feed the mode.
    late = 6 * lateness(seen.background) * mode.frequency >= 1
    return held if damps or late else f"{held}. Active damping ends it sooner"


LEAST_JUMP = 0.1
"""Least jump of the velocity, m/s."""
FIRST = 0.1
"""Time within which the start's vibration peaks, s."""
BENT = 0.1
"""Least vibration at the start, as under a weight that the beam does not yet carry, over the peak, to be a cause of its own."""


@register("η̈ + Dη̇ + Ω²η = −h a⊥ − g θ̈, Eq. (10): a jump of ẋ is a burst of a", "Mid-span deflection", 22)
def jerky_start(seen: Evidence) -> str | None:
    """The run does not start with the path's velocity, and its largest vibration follows at once."""
    samples = seen.samples
    if not seen.begins or seen.length < FIRST:
        return None
    path_rate = (samples.desired_pose[1] - samples.desired_pose[0]) / seen.period
    jump = float(np.linalg.norm((path_rate - samples.pose_rate[0])[:2]))
    start = float(samples.time[0])
    peak = largest(between(samples, start, start + FIRST).vibration)
    if jump < LEAST_JUMP or peak < RINGING or peak < seen.peak_vibration:
        return None
    bent = float(abs(samples.vibration[0]))
    also, avoids = "", "A smooth start, or one with the path's velocity, avoids that."
    if bent > BENT * peak:
        also = f" and with the beam {length(bent)} off its quasi-static bending"
        avoids = "A start with the path's velocity and that bending avoids it."
    return (
        f"The run starts with a velocity that is wrong by {n(jump)} m/s{also}: correcting {'both' if also else 'it'} bends the "
        f"beam by {length(peak)} within {n(FIRST)} s. {avoids}"
    )


MOSTLY = 0.5
"""Least share of slow bending in a vibration that is not called a ring."""


@register("w − w_qs, where w_qs ∝ ẍ_d; a ring's mean over its period ≈ 0", "Mid-span deflection", 8)
def off_the_path(seen: Evidence) -> str | None:
    """The payload does not follow its path, and most of the vibration does not oscillate as fast as mode 1."""
    samples = seen.samples
    error, motion = largest(samples.tracking_error[:, :2]), float(np.ptp(samples.desired_pose[:, :2], axis=0).max())
    if seen.steady is None or not seen.moving or error <= FOLLOWS * motion or seen.peak_vibration < RINGING:
        return None
    count = max(1, round(1 / (seen.period * float(seen.background.modes.frequency[0]))))
    if count > len(samples):
        return None
    share = largest(np.convolve(samples.vibration, np.full(count, 1 / count), "valid")) / seen.peak_vibration
    if share < MOSTLY:
        return None
    return (
        f"The payload is up to {length(error)} off its path. Vibration is the deflection less the bending by the desired motion: "
        f"here {n(100 * share)} % of its {length(seen.peak_vibration)} are slow bending by another motion, so that its peak and "
        "settling time say little about a ring."
    )


REPEATS = 0.05
"""Largest relative difference of two equal periods."""
WORTH = 0.02
"""Least forced vibration as a share of the bending."""
CLOSE = (0.6, 1.5)
"""Range of the path's frequency over the mode's that counts as resonance."""
AGREES = 0.35
"""Largest relative difference between the measured amplification and the formula's."""


def _two_periods(seen: Evidence) -> tuple[np.ndarray, np.ndarray] | None:
    """Vibration in the path's last period and in the one before; None without two periods of steady motion."""
    period = seen.scenario.trajectory.slowest_period
    count = round(period / seen.period)
    steps, motion = seen.samples.vibration, seen.last_second
    # If the payload does not follow its path, the path's acceleration does not determine the bending.
    if largest(motion.tracking_error[:, :2]) > FOLLOWS * float(np.ptp(motion.desired_pose[:, :2], axis=0).max()):
        return None
    if not seen.moving or count < 16 or 2 * period > seen.length + 1e-9 or len(steps) < 2 * count:
        return None
    return steps[-count:], steps[-2 * count : -count]


@register("|w|/|w_qs| = 1/√((1 − r²)² + (2ζr)²), r = f_path/f_k", "Mid-span deflection", 10)
def resonance(seen: Evidence) -> str | None:
    """A sinusoidal path near the loop's first mode bends the beam as much as the formula says."""
    path, ring = seen.scenario.trajectory, seen.background.rings.get(1)
    pair = _two_periods(seen)
    if pair is None or ring is None or not hasattr(path, "amplitude") or not hasattr(path, "frequency"):
        return None
    amplitude, hertz = np.broadcast_to(path.amplitude, 3), np.broadcast_to(path.frequency, 3)
    r = float(hertz[np.argmax(np.abs(amplitude[:2]))]) / ring.frequency
    zeta = -ring.rate / (2 * np.pi * ring.frequency)
    ideal = 1 / np.hypot(1 - r * r, 2 * zeta * r)
    span = newest(seen.samples, path.slowest_period)
    bent, quasi = largest(span.midspan_deflection), largest(span.quasi_static_deflection)
    if not CLOSE[0] < r < CLOSE[1] or quasi < 1e-6 or abs(bent / quasi / ideal - 1) > AGREES:
        return None
    return (
        f"The path's {n(r * ring.frequency)} Hz are {n(r)} times mode 1 ({n(ring.frequency)} Hz): the beam "
        f"bends by {length(bent)}, {n(bent / quasi)} times its quasi-static bending (resonance of one mode: "
        f"{n(ideal)} times). Another frequency of the path, a stiffer beam or active damping helps."
    )


FORCED = 5.0
"""Largest vibration over r² |w_qs| that a path's harmonics explain; more has another cause, such as an axial force."""


@register("|w|/|w_qs| − 1 ≈ r², r = f_path/f_1: forced, at the path's own period", "Mid-span deflection", 21)
def forced_vibration(seen: Evidence) -> str | None:
    """The vibration repeats with the path's period."""
    pair, ring = _two_periods(seen), seen.background.rings.get(1)
    if pair is None or ring is None:
        return None
    peak, bending = largest(pair[0]), largest(seen.last_second.quasi_static_deflection)
    period = seen.scenario.trajectory.slowest_period
    if peak < max(RINGING, WORTH * bending) or largest(pair[0] - pair[1]) > REPEATS * peak:
        return None
    if ring.frequency * period < 1 / CLOSE[0] or resonance(seen):
        return None
    if peak * (ring.frequency * period) ** 2 > FORCED * bending:
        return None
    return (
        f"A vibration of {length(peak)} repeats with the path's period of {n(period)} s: it is forced, no free ring, as mode 1 "
        f"({n(ring.frequency)} Hz) is only {n(ring.frequency * period)} times as fast. No damping ends it; a slower path or a "
        "stiffer beam makes it smaller."
    )


RESIDUAL_WORTH = 1e-5
"""Least residual vibration that is explained, m."""
MISSED = TOLERATED + 0.01
"""Residual share from which a shaper counts as tuned to another mode."""


def share_left(shaper: np.ndarray, ring: Ring) -> float:
    """Vibration of a mode right after a shaper's impulses (k, 2), over that right after a single impulse (Singer & Seering)."""
    return float(abs(np.sum(_excited(shaper, ring))))


def _excited(shaper: np.ndarray, ring: Ring) -> np.ndarray:
    """The vibrations that a shaper's impulses excite, at the instant of the last one, complex, (k,)."""
    pole, (amplitude, time) = complex(ring.rate, 2 * np.pi * ring.frequency), shaper.T
    return amplitude * np.exp(pole * (time[-1] - time))


def _left(seen: Evidence) -> tuple[float, Samples]:
    """Largest vibration after the stop, m, and the samples from then on; NaN if the target has not stopped within the samples."""
    metric = ResidualVibration()
    metric.update(seen.samples)
    first = int(np.searchsorted(seen.samples.time, metric.stop, side="right"))
    return metric.compute()[0], seen.samples.slice(first, len(seen.samples))


RUNG = 4.0
"""Periods after the stop over which the vibration is compared with a free ring."""
FREE = 0.1
"""Share of the vibration up to which what is no free ring of mode 1 is left out."""


def _no_ring(after: Samples, ring: Ring) -> float:
    """The largest part of a vibration that is no free ring of a mode, over the vibration, 1 at most."""
    time = after.time - after.time[0]
    few = time <= RUNG / ring.frequency
    time, size = time[few], after.vibration[few]
    waves = np.exp((ring.rate + 2j * np.pi * ring.frequency) * time)
    parts = np.column_stack([waves.real, waves.imag])
    return min(1.0, largest(size - parts @ np.linalg.lstsq(parts, size)[0]) / largest(size))


@register("η(t) = Σ of the free answers to each jump of ẍ_d", "Mid-span deflection", 11)
def left_after_the_stop(seen: Evidence) -> str | None:
    """Residual vibration without a shaper, and the delay that a shaper would add."""
    (left, after), ring = _left(seen), seen.background.rings.get(1)
    if not left > RESIDUAL_WORTH or ring is None or len(seen.background.shaper):
        return None
    other = _no_ring(after, ring)
    if other > FREE:
        return (
            f"After the stop the vibration reaches {length(left)}, {n(100 * left / seen.peak_vibration)} % of its largest value. "
            f"{n(100 * other)} % of that is no free ring of mode 1 ({n(ring.frequency)} Hz) but bending by another motion or "
            "force, which an input shaper does not remove."
        )
    share = n(100 * left / seen.peak_vibration)
    rings_on = f"After the stop the beam rings on by {length(left)}, {share} % of its largest vibration."
    bent = float(abs(seen.samples.vibration[0])) * np.exp(ring.rate * (after.time[0] - seen.samples.time[0]))
    # A touch may have begun the ring, a change of path whose transition no shaper shapes, or a start off the bending at rest.
    if seen.touched or bent > FREE * left:
        return rings_on
    # Friction that sticks also shakes the beam after the last impulse.
    leaves = "much less" if any(seen.scenario.joints.friction.coulomb) else "nearly none"
    return (
        f"{rings_on} An input shaper for mode 1 ({n(ring.frequency)} Hz) ends the motion {n(500 / ring.frequency)} ms later "
        f"(zv) and leaves {leaves}."
    )


@register("x_shaped(t) = Σ A_j x_d(t − t_j): vibration Σ A_j exp(iωt_j)", "Mid-span deflection", 29)
def left_after_a_shaped_stop(seen: Evidence) -> str | None:
    """Residual vibration with a suitable shaper."""
    (left, _), ring, shaper = _left(seen), seen.background.rings.get(1), seen.background.shaper
    if not np.isfinite(left) or ring is None or not len(shaper) or seen.peak_vibration < RESIDUAL_WORTH:
        return None
    excited = np.abs(_excited(shaper, ring)).sum()
    if share_left(shaper, ring) > MISSED * excited or left > 0.2 * seen.peak_vibration:
        return None
    return (
        f"The shaper {seen.scenario.trajectory.shaper} ends the motion {n(1e3 * float(shaper[-1, 1]))} ms later; of a vibration "
        f"of up to {length(seen.peak_vibration)}, {length(left)} are left after the stop, as the vibrations that its copies of "
        "the motion excite cancel."
    )


@register("|Σ A_j exp(iωt_j)| of the mode that rings", "Mid-span deflection", 9)
def shaper_for_another_mode(seen: Evidence) -> str | None:
    """The shaper is not tuned to the closed loop's frequency, and by the formula leaves vibration."""
    shaper, ring = seen.background.shaper, seen.background.rings.get(1)
    if not len(shaper) or ring is None:
        return None
    share = share_left(shaper, ring)
    if share < MISSED:
        return None
    tuned, given = 0.5 / float(shaper[1, 1]), seen.scenario.trajectory.shaper_frequency
    made_for = f"{n(tuned)} Hz"
    if given is not None and n(given) != n(tuned):
        made_for = f"{n(given)} Hz ({n(tuned)} Hz with its damping)"  # The number that was set comes first.
    better = "Without a frequency (null) it follows the loop; zvd and ei-shaper tolerate larger errors."
    if given is None:  # It followed the loop of the payload before its mass changed.
        better = "The shapers zvd and ei-shaper tolerate larger errors."
    peak = largest(seen.samples.vibration)
    return (
        f"The shaper {seen.scenario.trajectory.shaper} is made for {made_for}, but the loop rings at {n(ring.frequency)} Hz: "
        f"it leaves {n(100 * share)} % of the mode's vibration (so far {length(peak)} at most). {better}"
    )
