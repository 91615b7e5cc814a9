"""The self-checks of the lessons on the force along the beam."""

from collections.abc import Sequence

import numpy as np

from flexlab.analysis.lesson_measures import DISTURBANCES, Verdict, has_start, largest, length
from flexlab.analysis.metrics.run_metrics import between
from flexlab.physics.axial_load import buckling_load
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event

SETTLED, SHORTEST = 0.5, 1.5
"""s after a change before its ring is looked at, and how long it is looked at, at least."""
FIRST, SECOND, MIDDLE = 30, 40, 35.0
"""N: the two squeezes of the lesson, and what lies between them."""
APART = 2.0
"""N between two squeezes that a line may go through."""
AGREES = 0.05
"""Share of the buckling load to which the line agrees with it."""


def check_buckling(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Squeeze. Done when the line of f² over P through two squeezes comes to zero at the buckling load (Southwell)."""
    payload = scenario.payload
    if payload.axial_load == "none" or len(scenario.arms) < 2:
        return Verdict(False, "Load the preset squeeze-until-it-buckles: its beam feels the force along it.")
    rings = _rings(samples, events)
    critical = buckling_load(payload.length, payload.bending_stiffness, payload.boundary)
    share = largest(samples.axial_load_share[-1:])
    if not rings:
        said = "it has buckled: press R" if share > 1 else "wait for two seconds, or press R to make it ring"
        return Verdict(False, f"The beam is pressed with {100 * share:.0f} % of P_cr = {critical:.1f} N: {said}.")
    force, hertz = rings[-1]
    facts = f"f1 = {hertz:.2f} Hz at P = {force:.1f} N"
    other = next((ring for ring in reversed(rings) if abs(ring[0] - force) > APART), None)
    if other is None:
        return Verdict(False, f"{facts}. Now set Wanted internal force F_d to {FIRST if force > MIDDLE else SECOND}.")
    slope = (hertz**2 - other[1] ** 2) / (force - other[0])
    zero = force - hertz**2 / slope
    line = f"{facts}, and {other[1]:.2f} Hz at {other[0]:.1f} N: f² over P comes to zero at {zero:.1f} N"
    if abs(zero - critical) > AGREES * critical:
        return Verdict(False, f"{line}, not yet at P_cr = {critical:.1f} N. Wait for another second.")
    return Verdict(True, f"{line}; π²EI/L² is {critical:.1f} N ✓")


def _rings(samples: Samples, events: Sequence[Event]) -> list[tuple[float, float]]:
    """(P, N, and f1, Hz) of each span without a change in which the beam rang, in order."""
    touched = [event.time for event in events if isinstance(event.command, DISTURBANCES)]
    ends = [float(samples.time[0]), *(t for t in touched if t > samples.time[0]), float(samples.time[-1])]
    found = []
    for begin, end in zip(ends[:-1], ends[1:], strict=True):
        if end - begin < SETTLED + SHORTEST:
            continue
        part = between(samples, begin + SETTLED, end)
        w = part.midspan_deflection - part.midspan_deflection.mean()
        upwards = np.flatnonzero((w[:-1] < 0) & (w[1:] >= 0))
        if len(upwards) < 3 or largest(w) < 1e-6:
            continue
        step = part.time[1] - part.time[0]
        times = part.time[upwards] - w[upwards] * step / (w[upwards + 1] - w[upwards])
        found.append((-float(part.axial_load.mean()), float((len(times) - 1) / (times[-1] - times[0]))))
    return found


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
