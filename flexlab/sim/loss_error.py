"""The estimate of the dissipated energy's accuracy, from the ticks that `accuracy` has repeated with finer steps.

Errors of a loss do not decay. All losses between two checked ticks are taken to have the relative error of these two together.
"""

from typing import NamedTuple

from flexlab.scenario import Scenario
from flexlab.text import number_text

BOUND = 0.01
"""Largest error of the dissipated energy, as a share of it, that is not reported."""
LEAST_ERROR = 1e-14
"""Smallest error, J, that is reported: rounding of the energies in the beam is smaller."""
FIRST_VERDICT = 32
"""Ticks after a disturbance in which nothing is judged: the loss of its first ticks is small, and its share of error large."""
GROWN = 2.0
"""Factor by which an error must exceed the reported one to be reported again."""


class LossError(NamedTuple):
    """What is known of the error of a run's dissipated energy so far."""

    total: float = 0.0
    """Dissipated energy after the newest checked tick, J."""
    of_tick: float = 0.0
    """Energy that this tick dissipated, J."""
    missed: float = 0.0
    """Size of the error of that energy, J."""
    error: float = 0.0
    """Size of the error of `total`, J."""
    said: float = 0.0
    """Share that the warning states."""
    warning: str = ""
    """A sentence that says since when, and by how much, the dissipated energy may be off; empty while it is accurate."""


def noted(
    old: LossError, scenario: Scenario, time: float, since: int, energies: tuple[float, float, float]
) -> LossError:
    """The error after a checked tick that ends at `time`, s, `since` ticks after a disturbance.

    `energies`: the dissipated energy at its beginning, at its end, and at the end of its repetition, J.
    """
    start, total, again = energies
    of_tick, missed = total - start, abs(total - again)
    both = abs(old.of_tick + of_tick)
    share = (old.missed + missed) / both if both > 0 else 0.0
    new = old._replace(total=total, of_tick=of_tick, missed=missed, error=old.error + share * abs(total - old.total))
    if since < FIRST_VERDICT or not new.error > max(LEAST_ERROR, max(BOUND, GROWN * new.said) * total):
        return new
    said = new.error / total if total > 0 else 1.0
    return new._replace(said=said, warning=imprecise(scenario, time, said))


def imprecise(scenario: Scenario, time: float, share: float) -> str:
    """The warning for a dissipated energy that is off by this share of it from `time`, s, on."""
    cure = "a smaller tolerance of the pose (simulation.accuracy)"
    if scenario.simulation.step is not None:
        cure = "a shorter step (simulation.step) or null"
    return (
        f"The dissipated energy may be off by {number_text(100 * share, 1)} % from about t = {time:.3f} s on, as the beam's "
        f"fast modes are damped faster than the steps. Reset with less damping or {cure}."
    )
