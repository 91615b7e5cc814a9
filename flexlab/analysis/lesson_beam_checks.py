"""Checks of the lessons on axial force, active damping with a clock and gauges, input shaping and spillover."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexlab.analysis.explanations.evidence import rings_of
from flexlab.analysis.lesson_measures import (
    DISTURBANCES,
    UNDAMPED_TIME,
    Verdict,
    changed,
    has_start,
    largest,
    length,
    torque_jump,
    wait_for_start,
)
from flexlab.analysis.metrics.residual_vibration import ResidualVibration
from flexlab.analysis.metrics.run_metrics import between
from flexlab.analysis.metrics.settling_time import settling_time
from flexlab.analysis.modes import modes
from flexlab.control.observers.kalman import KalmanObserver
from flexlab.errors import FlexlabError
from flexlab.physics.axial_load import buckling_load
from flexlab.scenario import Scenario
from flexlab.sim.first_mode import first_mode
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event
from flexlab.sim.target import shaper_impulses

SETTLED, SHORTEST = 0.5, 1.5
"""s after a change before its ring is looked at, and how long it is looked at, at least."""
FIRST, SECOND, MIDDLE = 30, 40, 35.0
"""N: the two squeezes of the lesson, and what lies between them."""
APART = 2.0
"""N between two squeezes that a line may go through."""
SILENT = 1e-9
"""m: a ring that has become smaller is none. The preset's comes to it 40 s after its start."""
AGREES = 0.05
"""Share of the buckling load to which the line agrees with it."""


def check_buckling(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Squeeze. Done when the line of f² over P through two squeezes comes to zero at the buckling load (Southwell)."""
    payload = scenario.payload
    if payload.axial_load == "none" or len(scenario.arms) < 2:
        return Verdict(False, "Load the preset squeeze-until-it-buckles: its beam feels the force along it.")
    spans = _spans(samples, events)
    critical, newest = buckling_load(payload.length, payload.bending_stiffness, payload.boundary), spans[-1]
    share = largest(samples.axial_load_share[-1:])
    facts = f"The beam is pressed with {100 * share:.0f} % of P_cr = {critical:.1f} N"
    if share > 1:
        return Verdict(False, f"{facts}: it has buckled. Set Wanted internal force F_d to {FIRST}, and press R.")
    if newest.hertz is None:
        ready = newest.begin + SETTLED + SHORTEST
        if newest.end < ready:
            return Verdict(False, f"{facts}. Let the run go on to t = {ready:.1f} s.")
        return Verdict(False, f"{facts}, and rings no more. Press R, or tap the beam.")
    force, hertz = newest.force, newest.hertz
    facts = f"f1 = {hertz:.2f} Hz at P = {force:.1f} N"
    other = next((each for each in reversed(spans) if each.hertz and abs(each.force - force) > APART), None)
    if other is None or other.hertz is None:
        return Verdict(False, f"{facts}. Now set Wanted internal force F_d to {FIRST if force > MIDDLE else SECOND}.")
    slope = (hertz**2 - other.hertz**2) / (force - other.force)
    zero = force - hertz**2 / slope
    line = f"{facts}, and {other.hertz:.2f} Hz at {other.force:.1f} N: f² over P comes to zero at {zero:.1f} N"
    if abs(zero - critical) > AGREES * critical:
        return Verdict(False, f"{line}, not yet at P_cr = {critical:.1f} N. Wait for another second.")
    return Verdict(True, f"{line}; π²EI/L² is {critical:.1f} N ✓")


class Span(NamedTuple):
    """A part of a run without a change."""

    begin: float
    """s."""
    end: float
    """s."""
    force: float
    """P, N."""
    hertz: float | None
    """f1, Hz; None where it is too short, or rings no more."""


def _spans(samples: Samples, events: Sequence[Event]) -> list[Span]:
    """All of them, in order."""
    touched = [event.time for event in events if isinstance(event.command, DISTURBANCES)]
    ends = [float(samples.time[0]), *(t for t in touched if t > samples.time[0]), float(samples.time[-1])]
    found = []
    for begin, end in zip(ends[:-1], ends[1:], strict=True):
        force, hertz = 0.0, None
        if end - begin >= SETTLED + SHORTEST:
            part = between(samples, begin + SETTLED, end)
            force, hertz = -float(part.axial_load.mean()), _ring(part)
        found.append(Span(begin, end, force, hertz))
    return found


def _ring(part: Samples) -> float | None:
    """Frequency of a free ring, Hz, from where it goes upwards through its mean; None: there is none."""
    w = part.midspan_deflection - part.midspan_deflection.mean()
    upwards = np.flatnonzero((w[:-1] < 0) & (w[1:] >= 0))
    if len(upwards) < 3 or largest(w) < SILENT:
        return None
    step = part.time[1] - part.time[0]
    times = part.time[upwards] - w[upwards] * step / (w[upwards + 1] - w[upwards])
    return float((len(times) - 1) / (times[-1] - times[0]))


def check_spin_up(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Spin. Done when the paper's beam has bent away in a spin that took all its stiffness."""
    if len(scenario.arms) > 1:
        return Verdict(False, "Load the preset spin-up: one arm turns the beam.")
    if not has_start(samples):
        return Verdict(False, "Press R: this check looks at the start of a run.")
    tip, spin = samples.beam_coordinates[:, -2], samples.spin_share
    peak, taken = largest(tip), 100 * largest(spin)
    facts = f"The spin takes {taken:.0f} % of the linear beam's stiffness; the free end lagged by up to {length(peak)}"
    if scenario.payload.axial_load != "none":
        if taken < 100:
            return Verdict(False, f"{facts}. Let the run go on to t = 5 s.")
        now = length(abs(float(tip[-1])))
        return Verdict(
            False, f"{facts}, and is {now} off the line now. Now set Force along the beam to none, and press R."
        )
    if peak > scenario.payload.length / 2 and taken > 100:
        return Verdict(True, f"{facts}, and comes back no more: the paper's beam has no stiffness left ✓")
    return Verdict(False, f"{facts}. Let the run go on: the paper's beam has stiffness left, or has not bent away yet.")


RINGING = 2e-5
"""Vibration that counts as a ring, m: 28 times what steady motion leaves in the preset paper."""
SOON = 0.15
"""Settling time that active damping of about k_v = 100 reaches, s."""
CALM = 2.0
"""RMS jump of a torque per control step up to which an observer counts as calm, N·m; 11 without one."""
STOPPED_WELL, WRONG = 0.05, 0.1
"""Share of its largest vibration that a shaped motion may leave; relative error of a frequency that counts as wrong."""
FINE, NEARLY_UNDAMPED = 8, 0.002
"""Elements, and damping ratio up to which spillover is a question."""


def check_vibration(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Can vibration reach zero? Done when it ends within 0.15 s by rates that are estimated under a clock with a delay."""
    waiting = wait_for_start(samples, 1.0)
    if waiting:
        return waiting
    if changed(events):
        return Verdict(False, "Something was changed in this run: press R, and let it run for a second.")
    run = between(samples, 0.0, 1.0)
    peak = largest(between(samples, 0.0, 0.1).vibration)
    if peak < RINGING:
        return Verdict(False, "This run did not ring at its start: load the preset vibration-damping.")
    time = settling_time(run.time, run.vibration)
    if np.isnan(time):
        return Verdict(
            False, f"The ring of {length(peak)} is still over one per cent after a second: load vibration-damping."
        )
    law, facts = scenario.controller, f"The ring of {length(peak)} fell to one per cent within {time:.2f} s"
    if law.kind not in ("vibration-damping", "composite"):
        return Verdict(False, f"{facts} without active damping. Now load the preset vibration-damping.")
    if time > SOON:
        return Verdict(False, f"{facts}: give Lateral vibration gain k_v a value of about 100, and press R.")
    if law.control_period is None:
        return Verdict(
            False,
            f"{facts}, with rates that are known at once (the preset paper takes {UNDAMPED_TIME:g} s). Now turn Sampled control "
            "on, set Input delay to 1 and Strain gauge noise to 0.000001, and press R.",
        )
    jump = torque_jump(between(samples, 0.5, 1.0), law.control_period)
    facts += f" with a clock of {1e3 * law.control_period:g} ms and {law.input_delay} samples of delay"
    noisy = f"torques jump by {jump:.1f} N·m (RMS) per step"
    if not isinstance(getattr(law, "observer", None), KalmanObserver):
        return Verdict(
            False, f"{facts}, but the {noisy}. Now set Control law to composite and Observer to kalman, press R."
        )
    if law.input_delay < 1 or law.sensor_noise.strain == 0 or jump > CALM:
        return Verdict(False, f"{facts}; {noisy}. Give it a delay of 1 and gauge noise of 0.000001, and press R.")
    rest, bending = largest(between(samples, 0.9, 1.0).vibration), largest(run.quasi_static_deflection)
    return Verdict(
        True,
        f"{facts}, from noisy gauges, and {noisy} only. {length(rest)} of vibration is left after a second; slow bending of up "
        f"to {length(bending)} stays ✓",
    )


def check_input_shaping(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Stopping without a ring. Done when a shaper with a wrong frequency still leaves little."""
    path = scenario.trajectory
    if path.end is None:
        return Verdict(False, "This path has no end: load the preset sudden-stop.")
    try:
        shaper, mode = shaper_impulses(scenario), first_mode(scenario)
    except FlexlabError as error:
        return Verdict(False, str(error))
    late = float(shaper[-1, 1]) if len(shaper) else 0.0
    waiting = wait_for_start(samples, path.end + late + 0.3)
    if waiting:
        return waiting
    if changed(events):
        return Verdict(False, "Something was changed in this run: press R.")
    metric = ResidualVibration()
    metric.update(samples)
    left, peak, hertz = (
        metric.compute()[0],
        largest(samples.vibration),
        mode.omega * np.sqrt(1 - mode.zeta**2) / (2 * np.pi),
    )
    if np.isnan(left) or peak < RINGING:
        return Verdict(False, "Nothing rings here: load the preset sudden-stop.")
    facts = f"{length(left)} of vibration after the stop, of {length(peak)} at most"
    if not len(shaper):
        return Verdict(False, f"{facts}. Now set Input shaper to zv, and press R.")
    facts = f"{path.shaper}, {1e3 * late:.0f} ms longer: {facts}"
    if path.shaper_frequency is None or abs(path.shaper_frequency / hertz - 1) < WRONG:
        return Verdict(
            False, f"{facts}. Now have the shaper made for a wrong frequency, {0.8 * hertz:.1f} Hz, and press R."
        )
    facts = f"Made for {path.shaper_frequency:g} Hz instead of {hertz:.2f} Hz, {facts}"
    if left > STOPPED_WELL * peak or path.shaper == "zv":
        return Verdict(False, f"{facts}. Now set Input shaper to zvd, and press R.")
    return Verdict(True, f"{facts} ✓")


@lru_cache(maxsize=8)
def _growth(scenario: Scenario) -> tuple[float, str, float]:
    """Fastest growth, 1/s, whose it is, and the true frequency of that mode, Hz; remembered: the lab asks every second."""
    found = modes(scenario)
    worst = int(np.argmax(found.poles.real)) if len(found.poles) else 0
    origin = found.pole_origin[worst] if len(found.poles) else ""
    number = int(origin.removeprefix("beam mode ")) if origin.startswith("beam mode") else 0
    rings = rings_of(found)
    return found.growth, origin, rings[number].frequency if number in rings else 0.0


def check_spillover(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Spillover. Done when an observer of few modes leaves a nearly undamped beam of many modes stable."""
    law, beam = scenario.controller, scenario.payload
    if law.kind not in ("vibration-damping", "composite") or law.control_period is None or law.input_delay < 1:
        return Verdict(False, "Load the preset vibration-damping, turn Sampled control on, and set Input delay to 1.")
    ratio = getattr(beam.damping, "ratio", None)
    if beam.element_count < FINE or ratio is None or ratio > NEARLY_UNDAMPED:
        return Verdict(False, "Set Elements to 8, Damping kind to modal and Damping ratio to 0.")
    try:
        growth, origin, hertz = _growth(scenario.anew())
    except FlexlabError as error:
        return Verdict(False, str(error))
    observer = law.observer if isinstance(getattr(law, "observer", None), KalmanObserver) else None
    grows = f"{origin}, {hertz:.0f} Hz, grows at {growth:.2f} 1/s"
    if observer is None:
        facts = f"With measured rates {grows}" if growth > 0 else "With measured rates nothing grows"
        return Verdict(False, f"{facts}. Now set Control law to composite and Observer to kalman.")
    facts = f"The observer knows {observer.observer_modes} of {beam.coordinate_count} modes"
    if growth > 0:
        return Verdict(False, f"{facts}, and {grows}: spillover. Now set Damping ratio to 0.001.")
    if ratio == 0:
        return Verdict(False, f"{facts}, and nothing grows with these gains. Now set Damping ratio to 0.001.")
    return Verdict(True, f"{facts}; a damping ratio of {100 * ratio:g} % is enough that none of the others grows ✓")
