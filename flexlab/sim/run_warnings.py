"""What a run says of its own limits: the accuracy of its steps, and where the beam's model ends."""

from typing import NamedTuple

from flexlab.number_text import number_text
from flexlab.physics.axial_load import buckling_load
from flexlab.scenario import Payload, Scenario
from flexlab.sim.row_survey import Survey

POSE_BOUND = 1e-8
"""Estimated error of the pose, m or rad, up to which a run is called accurate that was not asked to be coarser."""

FORCE_BOUND = 1e-4
"""The same of the internal force, over its peak so far; of one arm alone, of the force that moves the beam."""

LEAST_PEAK = 0.5
"""N or N·m: errors are judged against at least this force, so that what is next to nothing is not."""

Sizes = tuple[float, float]
"""Errors of the pose, m or rad, and of the force, N or N·m."""

COUNTED = (
    "Results are certain up to a count of the encoders: next to its edge, errors of the steps that are too small to be seen "
    "decide which one is told."
)
"""The sentence of a run whose encoders count."""

NOTABLE, WHOLE = 0.1, 1.0
"""Share of the buckling load, or of the stiffness, from which on the paper's model leaves out what counts, and at which a beam
has buckled or the linear beam has no stiffness left."""

CURE = "Set the force along the beam (payload.axial_load) to first-order."


class AxialWarning(NamedTuple):
    """What there is to say of a run, and how grave it is."""

    level: int = 0
    """Grows with each limit that was passed; 0: none was."""
    text: str = ""
    """A sentence or two; empty: there is nothing to say."""


def axial_warning(payload: Payload, seen: Survey) -> AxialWarning:
    """Of all samples so far: at `NOTABLE` and at `WHOLE`, of the paper's beam; of one that feels the force, at `WHOLE`."""
    critical = buckling_load(payload.length, payload.bending_stiffness, payload.boundary)
    share, spin, felt = seen.load_share, seen.spin_share, payload.axial_load != "none"
    force, limit = f"up to {number_text(share * critical, 3)} N along it", f"{number_text(critical, 3)} N"
    said = []
    if felt and share >= WHOLE:
        said.append(
            f"The beam is pressed with {force}, more than the {limit} that buckle it: it buckles, and where it bends "
            "far the model ends."
        )
    elif not felt and share >= WHOLE:
        said.append(
            f"The beam is pressed with {force}, more than the {limit} that buckle it: a real beam would have buckled. "
            f"{CURE}"
        )
    elif not felt and share >= NOTABLE:
        said.append(
            f"The beam is pressed with {force}, {100 * share:.0f} % of what buckles it: the paper's model leaves out what that "
            f"does. {CURE}"
        )
    if not felt and spin >= WHOLE:
        said.append(
            "The link spins faster than the beam's first mode rings: the paper's model has no stiffness left, where a real "
            f"beam gets stiffer. {CURE}"
        )
    elif not felt and spin >= NOTABLE:
        said.append(
            f"The spin takes up to {100 * spin:.0f} % of the beam's stiffness in the paper's model, where a real beam gets "
            f"stiffer. {CURE}"
        )
    limits = (WHOLE,) if felt else (NOTABLE, WHOLE)
    passed = [share >= limit for limit in limits] + ([] if felt else [spin >= limit for limit in limits])
    return AxialWarning(sum(passed), " ".join(said))


def bounds(scenario: Scenario, peak: float) -> Sizes:
    """Errors up to which a run is called accurate whose largest force is `peak`, N or N·m."""
    return max(POSE_BOUND, scenario.simulation.accuracy), FORCE_BOUND * max(peak, LEAST_PEAK)


def amplified(scenario: Scenario) -> str:
    """The sentence of a sampled loop in which errors of any size grow."""
    period = scenario.controller.control_period
    return (
        f"Results depend on rounding: with a control period of {period:g} s this controller answers each error with a larger "
        "one, whatever the step. Choose a shorter control period or lower gains."
    )


def unled(time: float, cure: str) -> str:
    """The sentence of errors that grow as torques are at their limits."""
    return (
        f"Results are no longer accurate since about t = {time:.3f} s: a torque is at its limit, so that nothing leads errors of "
        f"the steps back, and they grow. Reset with {cure}, lower gains or a slower path."
    )


def inaccurate(scenario: Scenario, time: float, coming: Sizes, found: Sizes, peak: float) -> str:
    """A sentence once errors until `time`, s, are beyond their bounds, else empty.

    `coming`: errors of the pose, m or rad, and of the force, N or N·m, with what is ahead; `found`: so far; `peak`: the largest
    force so far, N or N·m.
    """
    (pose, force), said = coming, []
    bound, least = bounds(scenario, peak)
    if pose > bound:
        said.append(f"the pose may be off by {number_text(pose, 1)} m or rad")
    if force > least:
        share = f"{number_text(force / peak, 1)} of its peak" if peak > LEAST_PEAK else f"{number_text(force, 1)} N"
        name = "internal" if len(scenario.arms) > 1 else "moving"
        said.append(f"the {name} force may be off by {share}")
    if not said:
        return ""
    cause, cure = "errors of the steps add up in modes that ring on", "more damping, fewer elements"
    smaller = " or a smaller simulation.accuracy"
    if found[0] > bound or found[1] > least:
        cause = "the start or a change excites modes that are faster than the steps, or errors of the steps add up"
        cure = "a smooth start, more damping, fewer elements"
    if scenario.simulation.step is not None:
        cure, smaller = "a shorter simulation.step or null", ""
    return (
        f"Results are no longer accurate since about t = {time:.3f} s: {' and '.join(said)}, as {cause}. "
        f"Reset with {cure}{smaller}."
    )
