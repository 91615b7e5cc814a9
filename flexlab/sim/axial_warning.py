"""Where the beam's model ends: the force along the beam and the spin, beside what the beam bears."""

from typing import NamedTuple

from flexlab.physics.axial_load import buckling_load
from flexlab.scenario import Payload
from flexlab.sim.row_survey import Survey

NOTABLE, WHOLE = 0.1, 1.0
"""Share of the buckling load, or of the stiffness, from which on the paper's model leaves out what counts, and at which a beam
has buckled or the linear beam has no stiffness left."""

CURE = "Set payload.axial_load to first-order."


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
    force = f"up to {share * critical:.3g} N along it"
    said = []
    if felt and share >= WHOLE:
        said.append(
            f"The beam is pressed with {force}, more than the {critical:.3g} N that buckle it: it buckles, and where it bends "
            "far the model ends."
        )
    elif not felt and share >= WHOLE:
        said.append(
            f"The beam is pressed with {force}, more than the {critical:.3g} N that buckle it: a real beam would have buckled. "
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
