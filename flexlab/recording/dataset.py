"""A run's signals as an xarray dataset: named axes, units and meanings beside the numbers."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.errors import StudyError
from flexlab.presets import scenario_text
from flexlab.recording.run_info import package_version
from flexlab.recording.table_columns import axis_labels
from flexlab.scenario import Scenario
from flexlab.signal import ARM, AXIS, COORDINATE, JOINT, Signal
from flexlab.sim.samples import Run
from flexlab.sim.signals import TABLE, own_signals

if TYPE_CHECKING:
    import xarray

NAMES = {ARM: "arm", AXIS: "axis", JOINT: "joint", COORDINATE: "coordinate"}
"""Of axes that several signals have; any other is called after its signal."""


def to_dataset(run: Run) -> "xarray.Dataset":
    """All signals over time, with labels along their axes where these fit. Raises `StudyError` where xarray is not installed."""
    try:
        import xarray
    except ImportError:
        raise StudyError("xarray is not installed: pip install 'flexlab[xarray]' brings it.") from None
    signals = dict(TABLE) | {signal.name: signal for signal in own_signals(run.scenario)}
    arrays = {name: array for name, array in run.signals().items() if name in signals}
    found = {name: _variable(signals[name], array, run.scenario) for name, array in arrays.items()}
    about = {
        "scenario": scenario_text(run.scenario),
        "status": str(run.status),
        "status_text": run.status.text,
        "source": f"flexlab {package_version()}",
    }
    return xarray.Dataset(
        {name: variable for name, (variable, _) in found.items()},
        {name: names for _, labels in found.values() for name, names in labels.items()},
        about,
    )


def _variable(signal: Signal, array: np.ndarray, scenario: Scenario) -> tuple[tuple, dict[str, list[str]]]:
    """(dimensions, numbers, attributes) of a signal, and the labels along its dimensions."""
    names, labels = ["time"], {}
    for place, axis in enumerate(signal.axes, 1):
        known = ["_".join(words) for words, _ in axis_labels(axis, scenario)]
        # Where a command has changed the mesh on the way, the widest one's coordinates have no one name.
        fits = len(known) == array.shape[place]
        shared = NAMES.get(axis) if fits else None
        names.append(shared or f"{signal.name}_{NAMES.get(axis, 'entry')}")
        if shared:
            labels[shared] = known
    about = {"long_name": signal.meaning, "symbol": signal.symbol, "units": signal.unit_text}
    return (tuple(names), array, about | ({"source": signal.equation} if signal.equation else {})), labels
