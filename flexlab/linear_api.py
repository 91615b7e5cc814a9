"""The Python interface to linear models, apart from the rest: what it needs of scipy takes as long to load as all else."""

from collections.abc import Sequence

from flexlab.analysis import linearize as study
from flexlab.analysis.linear_model import LinearModel
from flexlab.api import AnyScenario, named_scenario


def linearize(
    scenario: AnyScenario,
    pose: tuple[float, float, float] | None = None,
    inputs: str | Sequence[str] = study.TORQUE,
    outputs: str | Sequence[str] = "pose",
    closed: bool | None = None,
) -> LinearModel:
    """See `analysis.linearize.linearize`."""
    return study.linearize(named_scenario(scenario)[1], pose, inputs, outputs, closed)


linearize.__doc__ = study.linearize.__doc__
