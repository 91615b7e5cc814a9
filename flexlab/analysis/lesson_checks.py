"""The lessons' self-checks: pure functions that read a run and say, in one sentence, whether a lesson is done.

Each gets the present scenario, the newest samples of the present run (`SECONDS` of them if there are as many) and the
run's events, and measures what the lesson claims: a sentence never gives a number that was not measured or computed from
this run, but for the two references named below.
"""

from collections.abc import Callable, Sequence

import numpy as np

from flexlab.analysis.lesson_beam_checks import (
    RINGING,
    check_buckling,
    check_input_shaping,
    check_spillover,
    check_spin_up,
    check_vibration,
)
from flexlab.analysis.lesson_measures import (
    DISTURBANCES,
    UNDAMPED_TIME,
    Verdict,
    first_frequency,
    has_start,
    largest,
    length,
    newest,
    ring_frequency,
    tick,
    torque_jump,
    wait_for_start,
)
from flexlab.analysis.metrics.run_metrics import between
from flexlab.scenario import AdaptiveSlidingMode, Scenario, parse_scenario
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event

SECONDS = 30.0
"""How much of a run to hand to a check, s: what the engine keeps."""

UNADAPTED_ERROR = 1.46e-3
"""RMS position error that the preset weak-feedback settles at, m (a test measures it)."""
QUIET = 1e-5
"""Vibration that counts as none, m."""
CHATTER = 5.0
"""RMS jump of a joint torque from one control step to the next that counts as chatter, N·m; 0.5 is usual."""
__all__ = ["CHECKS", "RINGING", "SECONDS", "UNDAMPED_TIME", "Verdict", "check_lesson"]

Check = Callable[[Scenario, Samples, Sequence[Event]], Verdict]


def check_lesson(check: str, scenario: Scenario, samples: Samples, events: Sequence[Event] = ()) -> Verdict:
    """The verdict of `CHECKS[check]`. Raises KeyError for an unknown check; never fails for a valid run."""
    function = CHECKS[check]
    if len(samples) < 2:
        return Verdict(False, "Press play: there is nothing to measure yet.")
    return function(scenario, samples, events)


def check_ring(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Why does it ring? Done in a run that starts with the path's velocity and stays quiet."""
    waiting = wait_for_start(samples, 0.6)
    if waiting:
        return waiting
    if any(isinstance(event.command, DISTURBANCES) for event in events):
        return Verdict(
            False, "Something was changed or touched in this run: press R and leave it alone until t = 0.6 s."
        )
    start = between(samples, 0.0, 0.6)
    path_rate = (start.desired_pose[1] - start.desired_pose[0]) / tick(samples)
    jump = float(np.linalg.norm((start.pose_rate[0] - path_rate)[:2]))
    peak, hertz = largest(start.vibration), ring_frequency(start)
    if jump > 0.1 and peak > RINGING:
        late = largest(between(samples, 0.5, 0.6).vibration)
        return Verdict(
            False,
            f"The start was wrong by {jump:.2f} m/s and rang the beam at {hertz:.1f} Hz "
            f"(f1 = {first_frequency(scenario.payload):.1f} Hz) by up to {length(peak)}; after 0.5 s {length(late)} was "
            "left. Now load the preset smooth-start.",
        )
    if np.linalg.norm(path_rate[:2]) < 0.1:
        return Verdict(False, "The path hardly moves at the start: load the preset paper, then smooth-start.")
    if jump < 0.02 and peak < QUIET:
        return Verdict(
            True,
            f"Same path, but the start has its velocity, and the vibration stays under {length(peak)}: "
            "the jump rang the beam, not the motion ✓",
        )
    return Verdict(False, f"This run vibrates by {length(peak)} for another reason: load the preset smooth-start.")


def check_soft_beam(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Soft beam. Done with EI at a quarter of the paper's or less, a period after the change."""
    stiffness, period = scenario.payload.bending_stiffness, _period(scenario)
    f1 = first_frequency(scenario.payload)
    since = _since(samples, events)
    if since < period:
        return Verdict(False, f"EI = {stiffness:g} N·m²: f1 = {f1:.1f} Hz. Let one period of the path go by.")
    bending = largest(newest(samples, period).quasi_static_deflection)
    if bending < 1e-5:
        return Verdict(False, "The payload hardly moves: load the preset paper.")
    facts = f"EI = {stiffness:g} N·m²: f1 = {f1:.1f} Hz, and the motion bends the beam by {length(bending)}"
    if stiffness > 25:
        return Verdict(False, f"{facts}. Now set Bending stiffness EI to 10.")
    paper = scenario.payload.model_copy(update={"bending_stiffness": 100.0})
    return Verdict(True, f"{facts}. With EI = 100 N·m² f1 was {first_frequency(paper):.1f} Hz ✓")


def check_boundary_layer(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """What ε does. Done when the torques chatter at a small ε."""
    law = scenario.controller
    if not isinstance(law, AdaptiveSlidingMode) or law.control_period is None or max(law.adaptation) > 1:
        return Verdict(False, "Load the preset fast-adaptation: its controller works in steps and adapts fast.")
    wait = 1.0 - _since(samples, events)
    epsilon = law.boundary_layer
    if wait > 0:
        return Verdict(False, f"ε = {epsilon:g} m/s: wait {wait:.1f} s for a second of samples.")
    second = newest(samples, 1.0)
    jump = torque_jump(second, law.control_period)
    force, error = (
        largest(np.linalg.norm(second.internal_force[:, 0, :2], axis=1)),
        largest(second.tracking_error[:, :2]),
    )
    facts = (
        f"ε = {epsilon:g} m/s: torques change by {jump:.1f} N·m (RMS) per control step, internal force up to {force:.1f} N, "
        f"tracking error up to {length(error)}"
    )
    if jump > CHATTER and epsilon <= 0.01:
        return Verdict(True, f"{facts}. The torques chatter: the boundary layer is too thin for this clock ✓")
    if epsilon > 0.01:
        return Verdict(False, f"{facts}. Now set Boundary layer ε to 0.01.")
    return Verdict(False, f"{facts}. No chatter yet: set Boundary layer ε to 0.001.")


def check_adaptation(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Why adaptive? Done when adaptation has halved the error that weak feedback leaves."""
    law = scenario.controller
    usual = parse_scenario({})
    if not isinstance(law, AdaptiveSlidingMode) or np.max(law.feedback_gain) > 25:
        return Verdict(False, "Load the preset weak-feedback, and keep its feedback gain K.")
    if (scenario.trajectory, scenario.payload, scenario.gravity) != (usual.trajectory, usual.payload, usual.gravity):
        return Verdict(False, "Keep path, payload and gravity of the preset weak-feedback: the check compares with it.")
    since, period = _since(samples, events), _period(scenario)
    if since < period:
        return Verdict(False, "Let one period of the path go by.")
    error = float(np.sqrt(np.mean(np.sum(newest(samples, period).tracking_error[:, :2] ** 2, axis=1))))
    estimate = samples.bound_estimates[-1]
    facts = f"error {length(error)} RMS, estimates b̂ = {estimate[0]:.2g} N, {estimate[1]:.2g} N/m, {estimate[2]:.2g} N·s²/m²"
    if min(law.adaptation) > 1:
        return Verdict(False, f"Hardly any adaptation: {facts}. Now set Adaptation k0, k1 and k2 to 0.1.")
    if error > 0.5 * UNADAPTED_ERROR:
        return Verdict(
            False, f"The estimates grow: {facts}. Wait until the error is under half of {length(UNADAPTED_ERROR)}."
        )
    return Verdict(
        True,
        f"Adaptation made up for the weak feedback: {facts}; without it the error settles at {length(UNADAPTED_ERROR)} RMS ✓",
    )


def check_internal_force(scenario: Scenario, samples: Samples, events: Sequence[Event]) -> Verdict:
    """Internal force. Done when a high gain has brought its steady peak under 0.3 N on the paper's path."""
    if len(scenario.arms) < 2:
        return Verdict(False, "One arm alone has nothing to press against: load the preset paper.")
    if not isinstance(scenario.controller, AdaptiveSlidingMode) or scenario.trajectory != parse_scenario({}).trajectory:
        return Verdict(False, "Load the preset paper: the check needs its path and its law.")
    since = _since(samples, events)
    if since < 1.5:
        return Verdict(False, f"Wait {1.5 - since:.1f} s: the check needs a period of steady motion.")
    steady = newest(samples, _period(scenario)).internal_force
    peak = largest(np.linalg.norm(steady[:, 0, :2], axis=1))
    balance = largest(steady.sum(axis=1))
    gain = float(np.max(scenario.controller.feedback_gain))
    facts = f"K = {gain:g}: in steady motion the arms press against each other with up to {peak:.2f} N"
    if balance > 1e-6:
        return Verdict(False, f"{facts}, but the two internal forces differ by {balance:.1g} N.")
    if peak < 0.3:
        return Verdict(True, f"{facts}, and the two internal forces cancel to within {max(balance, 1e-15):.0e} N ✓")
    start = ""
    if has_start(samples):
        begun = largest(np.linalg.norm(between(samples, 0.0, 0.1).internal_force[:, 0, :2], axis=1))
        start = f" (at the start {begun:.0f} N)"
    return Verdict(False, f"{facts}{start}. Now set Feedback gain K to 1000.")


CHECKS: dict[str, Check] = {
    "ring": check_ring,
    "soft-beam": check_soft_beam,
    "boundary-layer": check_boundary_layer,
    "adaptation": check_adaptation,
    "internal-force": check_internal_force,
    "vibration": check_vibration,
    "input-shaping": check_input_shaping,
    "spillover": check_spillover,
    "buckling": check_buckling,
    "spin-up": check_spin_up,
}
"""Check id → function, as the lessons name them."""


def _since(samples: Samples, events: Sequence[Event]) -> float:
    """How long the samples show the run undisturbed: since the newest change or touch, or since they begin, s."""
    times = [event.time for event in events if isinstance(event.command, DISTURBANCES)]
    return float(samples.time[-1]) - max([float(samples.time[0]), *times])


def _period(scenario: Scenario) -> float:
    """The path's longest period, s; 1 for a path that stands still, and no longer than a check can see."""
    return min(scenario.trajectory.slowest_period, SECONDS / 2)
