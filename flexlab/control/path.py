"""Desired motions of the payload: what a path is, which ones there are, and the seam between them and the engine.

A path is a file in `control/paths` that defines `PATH = Path(...)`: its numbers as a scenario model that also says what a
screen and the checks before a run need (span, reach, peak acceleration), and its kernel

    kernel(path, t, desired)     fills x_d, ẋ_d, ẍ_d (3, 3) at time t, s

with `path` a record of the model's numbers under their names.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numba
import numpy as np

from flexlab.compiled import MATRIX, call_kernel, compiled, inlined, kernel_address
from flexlab.quantities import Part, own_numbers
from flexlab.registry import modules_in


class Trajectory(Part):
    """What every path says of itself, besides its own numbers."""

    @property
    def span(self) -> float:
        """Time after which the path repeats (or its parts have met often enough), or at which it ends, s; 0: it rests."""
        raise NotImplementedError

    @property
    def shortest_time(self) -> float:
        """Time in which the path stays close to a straight line, s: between two instants at which its reach is checked."""
        return max(self.span, 1.0) / 400

    @property
    def fastest_period(self) -> float:
        """Time over which poses repeat or differ most, s: some of it stand for all where the step is chosen."""
        return self.span or 1.0

    @property
    def slowest_period(self) -> float:
        """Time in which the whole path is seen once, s."""
        return self.span or 1.0

    @property
    def middle(self) -> tuple[float, ...]:
        """The pose about which the motion happens, (3,)."""
        raise NotImplementedError

    @property
    def reach(self) -> tuple[float, ...]:
        """Largest distances from `middle`, (3,)."""
        raise NotImplementedError

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """Largest |ẍ_d|, (3,)."""
        raise NotImplementedError

    def keeping(self, changed: "Trajectory", changes: Mapping[str, Any], time: float) -> "Trajectory":
        """The path that replaces this one at `time`, s, adjusted so that the target does not jump where it can be avoided.

        changes: the fields of the path that a person set, by name.
        """
        return changed


@dataclass(frozen=True)
class Path:
    """One kind of desired motion. `model`'s field `kind` is its name everywhere."""

    model: type[Trajectory]
    kernel: Callable[..., None]
    place: int = 50
    """Rank in menus."""

    @property
    def kind(self) -> str:
        """The name in scenarios."""
        return self.model.model_fields["kind"].default

    @cached_property
    def record(self) -> np.dtype:
        """The record of the model's numbers."""
        own = own_numbers(self.model, Trajectory)
        return np.dtype([(name, "f8", (size,)) if size > 1 else (name, "f8") for name, size in own.items()])

    @cached_property
    def address(self) -> int:
        """Of the kernel, compiled or loaded from the cache when first asked for."""
        return kernel_address(self.kernel, self.record, numba.float64, MATRIX)


class DesiredMotion(NamedTuple):
    """A path as kernels take it."""

    kernel: int
    """Address of the path's kernel."""
    numbers: np.ndarray
    """The path's record, flat."""


@inlined
def desired_motion(path, t, desired):
    """Fill x_d, ẋ_d, ẍ_d (3, 3) at time t, s."""
    call_kernel(path.kernel, path.numbers, (t, desired))


@compiled
def desired_motions(path, times, desired):
    """Fill x_d, ẋ_d, ẍ_d (N, 3, 3) at times (N,), s."""
    for k in range(len(times)):
        desired_motion(path, times[k], desired[k])


_paths: dict[str, Path] = {}


def paths() -> dict[str, Path]:
    """All kinds of paths, as menus show them."""
    if not _paths:
        for module in modules_in("flexlab.control.paths"):
            _paths[module.PATH.kind] = module.PATH
    return dict(sorted(_paths.items(), key=lambda item: (item[1].place, item[0])))


def build_motion(trajectory: Trajectory) -> DesiredMotion:
    """The kernel and numbers of a scenario's trajectory."""
    path = paths()[trajectory.kind]  # type: ignore[attr-defined]
    record = np.zeros(1, path.record)
    for name in path.record.names or ():
        record[name] = getattr(trajectory, name)
    return DesiredMotion(path.address, record.view(np.float64))


def poses(path: DesiredMotion, times: np.ndarray) -> np.ndarray:
    """x_d, ẋ_d, ẍ_d at times (N,), (N, 3, 3)."""
    desired = np.zeros((len(times), 3, 3))
    desired_motions(path, np.asarray(times, float), desired)
    return desired
