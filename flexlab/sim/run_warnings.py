"""A run's warnings: slower than real time, no longer accurate, beyond the validity of the beam's model."""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import compiled
from flexlab.physics.axial_load import buckling_load
from flexlab.physics.beam import free_coordinates
from flexlab.scenario import Payload, Scenario
from flexlab.sim.assembly import Assembly
from flexlab.sim.signals import ARMS, INTERNAL, LOAD_SHARE, MIDSPAN, MOVING, PER_ARM, SPIN_SHARE, TIME, TORQUE
from flexlab.text import number_text

JUMP, LEAST_JUMP = 1.5, 0.05
"""A torque jumps in a tick, and excites fast modes, if it changes by more than the first factor times its largest change in any
checked tick, and by more than the second times the largest torque: under a sampled law, or where the desired motion jumps."""


class Largest(NamedTuple):
    """The largest value of a run so far, and when it was."""

    value: float = 0.0
    time: float = 0.0
    """s."""

    def among(self, values: np.ndarray, times: np.ndarray) -> "Largest":
        """This value, or the largest of further ones (N ≥ 1,) at their times, s."""
        k = int(np.argmax(values))
        return Largest(float(values[k]), float(times[k])) if values[k] > self.value else self


class Peaks(NamedTuple):
    """The largest values of a run so far."""

    peak: float = 0.0
    """Largest internal force, N or N·m; for a single arm, which has none, largest moving force."""
    strongest: float = 0.0
    """Largest torque, N·m."""
    torque: np.ndarray | None = None
    """Joint torques of the newest sample, N·m, (3 arms,); None before the first."""
    load_share: Largest = Largest()
    """Largest compression of the beam over its buckling load, 1."""
    critical: float = 0.0
    """Buckling load of the beam that bore the largest share of it, N; the beam may have been changed since."""
    spin_share: Largest = Largest()
    """Largest share of the linear beam's stiffness that the spin took away, 1."""
    bending: Largest = Largest()
    """Largest deflection over the beam's length, 1."""


def with_model_shares(before: Peaks, scenario: Scenario, rows: np.ndarray) -> Peaks:
    """Update the peaks that `model_warning` needs with `rows` (N ≥ 1, row length). w is taken at mid-span and at the nodes."""
    payload = scenario.payload
    free = free_coordinates(payload.element_count, payload.boundary)
    columns = [MIDSPAN, *(ARMS + PER_ARM * len(scenario.arms) + np.flatnonzero(free % 2 == 0))]
    bent, times = np.abs(rows[:, columns]).max(axis=1), rows[:, TIME]
    share = before.load_share.among(rows[:, LOAD_SHARE], times)
    if share is not before.load_share:
        before = before._replace(load_share=share, critical=_critical(payload))
    return before._replace(
        spin_share=before.spin_share.among(rows[:, SPIN_SHARE], times),
        bending=before.bending.among(bent / payload.length, times),
    )


def peaks_of(before: Peaks, scenario: Scenario, rows: np.ndarray, checked: float) -> tuple[Peaks, float, int]:
    """The peaks after `rows` (N ≥ 1, row length), the largest change of a torque in one of them, N·m, and the first `JUMP`.

    `checked`: the largest change in a checked tick so far, N·m. The jump is the index of its row, or -1 if there is none.
    """
    arm_count = len(scenario.arms)
    torque = np.empty(3 * arm_count)
    if before.torque is not None:
        torque[:] = before.torque
    peak, strongest, change, jump = _find_peaks(
        rows, arm_count, before.torque is not None, torque, before.peak, before.strongest, checked
    )
    seen = with_model_shares(before, scenario, rows)
    return seen._replace(peak=peak, strongest=strongest, torque=torque), change, jump


def _critical(payload: Payload) -> float:
    """The buckling load, N."""
    return buckling_load(payload.length, payload.bending_stiffness, payload.boundary)


@compiled
def _find_peaks(rows, arm_count, follows, torque, peak, strongest, checked):
    """Return (peak, strongest, change, jump), and set `torque` to the newest; `follows`: it holds that of the sample before."""
    largest, jump = 0.0, -1
    for k in range(len(rows)):
        row, change = rows[k], 0.0
        for i in range(arm_count):
            first = ARMS + PER_ARM * i
            for joint in range(3):
                now = row[first + TORQUE + joint]
                if follows:
                    change = max(change, abs(now - torque[3 * i + joint]))
                torque[3 * i + joint] = now
                strongest = max(strongest, abs(now))
                force = row[first + INTERNAL + joint] if arm_count > 1 else row[MOVING + joint]
                peak = max(peak, abs(force))
        follows = True
        largest = max(largest, change)
        if jump < 0 and change > JUMP * checked and change > LEAST_JUMP * strongest:
            jump = k
    return peak, strongest, largest, jump


SLOWEST_PACE = 0.8
"""Processor seconds per simulated second, on the machine of `STEP_COSTS`, from which on a run is announced as slow."""


class StepCost(NamedTuple):
    """Processor time of a step, measured on one core of a shared server in November 2026 (`flexlab bench` measures any)."""

    fixed: float
    """For arms and law, s."""
    per_mode: float
    """s."""
    per_product: float
    """Per number in the beam's matrices that couple modes, s."""


STEP_COSTS = {
    "etdrk4": StepCost(1.6e-6, 3.5e-8, 2.6e-9),
    "rk4": StepCost(1.2e-6, 3.5e-8, 4e-10),
    "generalized-alpha": StepCost(2.6e-6, 8.5e-8, 1.4e-9),
}
JOINTS_COST, GRIPS_COST, AXIAL_COST, AXIAL_PRODUCT_COST = 3.5e-7, 9e-7, 3.5e-7, 2.9e-9
"""What a step takes more with joints that are not ideal, with compliant grips and with the axial load, s, and that per number in
the matrices of the axial load, s. A change of mass, torque limits and a control period change it by less than a tenth."""
COARSER = "a coarser pose accuracy (simulation.accuracy)"
COUPLED_MODES = 8
"""Number of modes coupled by damping from which on they, and not the arms, dominate the cost of a step."""


def paper_step_time(assembly: Assembly) -> float:
    """Estimated processor time of a step of the paper's plant with this beam, s. The choice of a step rests on it."""
    cost, sizes = STEP_COSTS[assembly.levels.integrator], np.diff(assembly.system.plant.block_start)
    products = float(np.sum(sizes[sizes > 1] ** 2))
    return cost.fixed + cost.per_mode * float(np.sum(sizes)) + cost.per_product * products


def seconds_per_second(assembly: Assembly, step: float) -> float:
    """Estimated processor time per simulated time with steps of `step` s, 1."""
    plant, needed = assembly.system.plant, paper_step_time(assembly)
    if plant.joints is not None:
        needed += JOINTS_COST
    if plant.grips is not None:
        needed += GRIPS_COST
    if assembly.beam.axial.size:
        needed += AXIAL_COST + AXIAL_PRODUCT_COST * assembly.beam.axial[0].size
    return needed / step


def pace_warning(assembly: Assembly, step: float, bound: str, others: str = "") -> str:
    """A sentence on why a run is estimated to be slower than real time, and what to change; empty if it is not.

    bound: what bounds the step, as `step_size.Choice.bound`; others: as of `step_size.other_integrators`.
    """
    integrator, modes = assembly.levels.integrator, assembly.beam.modes
    pace = seconds_per_second(assembly, step)
    if pace < SLOWEST_PACE:
        return ""
    size = number_text(1e6 * step, 3)
    causes = {
        "given": f"the step is set to {number_text(step)} s (simulation.step)",
        "beam": f"the modes of this beam in these arms need steps of {size} µs with {integrator}",
        "creep": f"the modes of this beam, strongly damped and heavy for these arms, need steps of {size} µs",
        "resonance": f"nearly undamped modes need steps of {size} µs, or their errors grow",
        "accuracy": f"what the start or jumps of the desired motion excite needs steps of {size} µs with {integrator}",
        "joints": f"the joints' friction needs steps of {size} µs",
        "grips": f"the grips need steps of {size} µs",
        "motors": f"the motors' time constant needs steps of {size} µs",
        "law": f"the controller needs steps of {size} µs with {integrator}",
        "period": f"sample and control period leave steps of {size} µs",
    }
    cures = {
        "given": ["a longer step (simulation.step), or null"],
        "beam": ["a softer beam", COARSER],
        "creep": ["less damping", "a softer or lighter beam"],
        "resonance": ["some damping (payload.damping)", "a softer beam"],
        "accuracy": ["a smooth start", "more damping", "a softer beam"],
        "joints": ["a higher speed within which friction changes sign (joints.friction.smoothing_speed)", COARSER],
        "grips": ["a lower stiffness or damping of the grips (grips.stiffness, grips.damping)", COARSER],
        "motors": ["a longer time constant of the motors (joints.motor.time_constant), or 0", COARSER],
        "law": ["lower gains", COARSER],
        "period": ["a control period that is a multiple of the sample period"],
    }[bound]
    cause, count = causes[bound], len(modes.omega)
    if np.max(np.diff(modes.block_start)) > COUPLED_MODES:
        cause += f" and the damping couples its {count} modes"
        cures = ["damping of kind modal or stiffness, which couples none", *cures]
    if count > COUPLED_MODES:
        cures = [*cures, "fewer elements or modes (payload.mode_count)"]
    if others:
        cures = [*cures, others]
    elif integrator != "etdrk4" and bound != "given":
        cures = ["the integrator auto", *cures]
    return (
        f"Slower than real time: a simulated second takes about {number_text(pace, 2)} s on a common processor, as {cause}. "
        f"To keep up, choose {_either(cures)}."
    )


def _either(choices: list[str]) -> str:
    """Choices in a sentence: "a, b or c"."""
    return " or ".join([", ".join(choices[:-1]), choices[-1]] if len(choices) > 1 else choices)


POSE_BOUND = 1e-8
"""Estimated error of the pose, m or rad, up to which a run counts as accurate, unless a coarser accuracy was asked for."""
FORCE_BOUND = 1e-4
"""Largest error of the internal force, over its peak so far, of an accurate run; for a single arm, of the moving force."""
LEAST_PEAK = 0.5
"""Smallest peak against which errors of the force are judged, N or N·m: errors of tiny forces do not matter."""
Sizes = tuple[float, float]
"""Errors of the pose, m or rad, and of the force, N or N·m."""
COUNTED = (
    "Results are certain up to one count of the encoders: where a joint angle is next to the edge between two counts, errors of "
    "the steps, however small, decide which of them is read."
)
"""The warning for a run with encoders."""
NOTABLE, WHOLE = 0.1, 1.0
"""Share of the buckling load, or of the stiffness, from which on the paper's model neglects too much, and at which a beam
buckles or the linear beam has no stiffness left."""
CURE = "Set the force along the beam (payload.axial_load) to first-order."
LARGE_DEFLECTION = 0.05
"""Deflection over length from which on the linear beam is no longer exact."""


class ModelWarning(NamedTuple):
    """A warning about what the beam's model neglects, and how grave it is."""

    level: int = 0
    """Number of limits exceeded."""
    text: str = ""
    """One or two sentences; empty if no limit was exceeded."""


def model_warning(payload: Payload, seen: Peaks) -> ModelWarning:
    """The warning for all samples with this model. It says when each value was largest, as the beam may have been changed since.

    Limits are `NOTABLE` and `WHOLE` for axial load and spin of the paper's beam, `WHOLE` else, `LARGE_DEFLECTION` for bending.
    """
    critical = seen.critical or _critical(payload)
    (share, pressed), (spin, spun), (bending, bent) = seen.load_share, seen.spin_share, seen.bending
    felt, force = payload.axial_load != "none", f"{number_text(share * critical, 3)} N along it"
    said = []
    if share >= WHOLE:
        end = (
            "it buckles. How far a buckled beam bends, this linear model does not tell."
            if felt
            else f"a real beam would have buckled. {CURE}"
        )
        said.append(
            f"The beam was pressed with up to {force}, at t = {pressed:.3f} s, more than its buckling load of "
            f"{number_text(critical, 3)} N: {end}"
        )
    elif not felt and share >= NOTABLE:
        said.append(
            f"The beam was pressed with up to {force}, at t = {pressed:.3f} s, {100 * share:.0f} % of its buckling load: the "
            f"paper's model leaves out what that does. {CURE}"
        )
    if not felt and spin >= WHOLE:
        said.append(
            f"At its fastest, at t = {spun:.3f} s, the link spun faster than the beam's first mode rings: the paper's model has "
            f"no stiffness left, where a real beam gets stiffer. {CURE}"
        )
    elif not felt and spin >= NOTABLE:
        said.append(
            f"The spin took up to {100 * spin:.0f} % of the beam's stiffness in the paper's model, at t = {spun:.3f} s, where a "
            f"real beam gets stiffer. {CURE}"
        )
    limits = (WHOLE,) if felt else (NOTABLE, WHOLE)
    passed = [share >= limit for limit in limits] + ([] if felt else [spin >= limit for limit in limits])
    too_far = bending > LARGE_DEFLECTION
    if too_far:
        said.append(
            f"Large deflection: |w|/L was up to {number_text(100 * bending, 2)} %, at t = {bent:.3f} s, above "
            f"{number_text(100 * LARGE_DEFLECTION)} %. The beam model is linear and not exact there."
        )
    return ModelWarning(sum(passed) + too_far, " ".join(said))


def bounds(scenario: Scenario, peak: float) -> Sizes:
    """Errors up to which a run with the largest force `peak`, N or N·m, counts as accurate."""
    return max(POSE_BOUND, scenario.simulation.accuracy), FORCE_BOUND * max(peak, LEAST_PEAK)


def amplified(scenario: Scenario) -> str:
    """The warning for a sampled loop in which errors of any size grow."""
    period = number_text(scenario.controller.control_period or 0.0)
    return (
        f"Results depend on rounding: with a control period of {period} s this controller answers each error with a larger "
        "one, whatever the step. Choose a shorter control period or lower gains."
    )


def saturated(time: float, cure: str) -> str:
    """The warning for errors that grow because torques are at their limits."""
    return (
        f"Results are less accurate than wanted from about t = {time:.3f} s on: a torque is at its limit, so that nothing leads "
        f"errors of the steps back, and they grow. Reset with {cure}, lower gains or a slower path."
    )


def inaccurate(scenario: Scenario, time: float, largest: Sizes, found: Sizes, peak: float) -> str:
    """The warning for errors beyond their bounds at `time`, s.

    `largest`: errors of the pose, m or rad, and of the force, N or N·m, that there may be; `found`: those to expect so far;
    `peak`: the largest force so far, N or N·m.
    """
    (pose, force), said = largest, []
    bound, least = bounds(scenario, peak)
    if pose > bound:
        said.append(f"the pose may be off by {number_text(pose, 1)} m or rad")
    if force > least:
        share = (
            f"{number_text(100 * force / peak, 1)} % of its peak" if peak > LEAST_PEAK else f"{number_text(force, 1)} N"
        )
        name = "internal" if len(scenario.arms) > 1 else "moving"
        said.append(f"the {name} force may be off by {share}")
    cause, cure = "errors of the steps add up in modes that ring on", "more damping, fewer elements"
    smaller = " or a smaller tolerance of the pose (simulation.accuracy)"
    if found[0] > bound or found[1] > least:
        cause = "the start or a change excites modes that are faster than the steps, or errors of the steps add up"
        cure = "a smooth start, more damping, fewer elements"
    if scenario.simulation.step is not None:
        cure, smaller = "a shorter step (simulation.step) or null", ""
    return (
        f"Results are less accurate than wanted from about t = {time:.3f} s on: {' and '.join(said)}, as {cause}. "
        f"Reset with {cure}{smaller}."
    )
