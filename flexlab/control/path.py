"""Desired motions of the payload: the definition of a path, the registry, and how the engine takes one.

A path is a file in `control/paths` (or any file, see `add_path_file`) that defines `PATH = Path(...)`: its numbers as a scenario
model, with what a screen and the checks before a run need, and its kernel

    kernel(path, rows, t, desired)     fills x_d, ẋ_d, ẍ_d (3, 3) at time t ≥ 0, s

with `path` a record of the model's numbers by name, and `rows` the table from `Path.rows`, (rows, columns), of any length and
empty for most paths. `control.motion` adds ramp, shaper and transition.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from pydantic import Field

from flexlab.compiled import MATRIX, kernel_address
from flexlab.control.motion import INSIDE, NO_ROWS, DesiredMotion, Shaper, poses
from flexlab.quantities import Number, Part, Triple, own_numbers, quantity
from flexlab.registry import Registry

OUTLINE_POINTS = 1001
"""Number of instants at which the extent of a path without a formula for it is computed."""
MOST_INSTANTS = 20_000
"""Most instants at which a path's reach is checked; motions of incommensurable frequencies never repeat."""
TRANSITION_TIME = 0.5
"""Duration of the transition from the old target to a path that was changed in motion, s: about a stroke of an arm."""


class Transition(Part):
    """The difference from the old path when it was changed in motion; it fades, so that the target does not jump."""

    time: Number = quantity(..., "When", unit="s", low=0, high=1e9)
    duration: Number = quantity(TRANSITION_TIME, "Fades within", unit="s", low=1e-3, high=100)
    pose: Triple = quantity(..., "Left over", unit="m, m, rad", low=-1e3, high=1e3)
    rate: Triple = quantity(..., "Rate left over", unit="m/s, m/s, rad/s", low=-1e6, high=1e6)
    acceleration: Triple = quantity(..., "Acceleration left over", unit="m/s², m/s², rad/s²", low=-1e9, high=1e9)


class Trajectory(Part):
    """What every path has and can tell, besides its own numbers."""

    if TYPE_CHECKING:
        kind: Any  # Each path's own name, a Literal.

    smooth_start: Number = quantity(0.0, "Smooth start within", "T_r", "s", low=0, high=60, slider=(0, 2))
    """The path is entered at a speed that grows from 0 to 1 times its own over this time."""
    shaper: Shaper = quantity("none", "Input shaper")
    shaper_frequency: Number | None = quantity(
        None, "Shaped mode (null: the closed loop's first)", "f_s", "Hz", low=1e-2, high=1e5
    )
    shaper_damping: Number | None = quantity(
        None, "Its damping ratio (null: the closed loop's)", "ζ_s", "1", low=0, high=0.9
    )
    bending_feedforward: Number = quantity(0.0, "Feed-forward of the bending", unit="1", low=0, high=2, slider=(0, 1))
    """Share of the force of the beam's quasi-static bending that every law adds to its inputs."""
    transition: Transition | None = Field(
        None,
        description="Set by the engine when the path is changed in motion; of no account in a run that begins anew.",
    )

    @property
    def span(self) -> float:
        """Time after which the path ends or repeats, or, if it never does, many periods of its parts, s; 0: it rests."""
        raise NotImplementedError

    @property
    def end(self) -> float | None:
        """Time from which the path stands still, s; None: it never does."""
        return None

    @property
    def jumps(self) -> bool:
        """Whether the acceleration jumps during the motion."""
        return False

    @property
    def discontinuities(self) -> tuple[float, ...]:
        """Instants at which velocity, acceleration or jerk jump, s."""
        return ()

    @property
    def window(self) -> tuple[float, float]:
        """First and last instant between which the whole path is seen once, s."""
        return 0.0, self.slowest_period

    @property
    def shortest_time(self) -> float:
        """Time in which the path stays close to a straight line, s: the time between two checks of the path's reach."""
        return (self.window[1] - self.window[0]) / 400

    @property
    def instants(self) -> np.ndarray:
        """Instants at which the path's reach is checked, s."""
        begin, end = min(self.window[0], self.span), self.span
        return np.linspace(begin, end, min(MOST_INSTANTS, max(2, int((end - begin) / self.shortest_time) + 1)))

    @property
    def fastest_period(self) -> float:
        """Time over which poses repeat or differ most, s; the step is chosen for poses within it."""
        return self.slowest_period

    @property
    def slowest_period(self) -> float:
        """Time in which the whole path is seen once, s."""
        return self.span or 1.0

    @property
    def middle(self) -> tuple[float, ...]:
        """The pose about which the motion happens, (3,)."""
        low, high, _ = _outline(self)
        return tuple(0.5 * (a + b) for a, b in zip(low, high, strict=True))

    @property
    def reach(self) -> tuple[float, ...]:
        """Largest distances from `middle`, (3,)."""
        low, high, _ = _outline(self)
        return tuple(0.5 * (b - a) for a, b in zip(low, high, strict=True))

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """Largest |ẍ_d|, (3,)."""
        return _outline(self)[2]

    def place_text(self, time: float) -> str:
        """The name of the pose at `time`, s, in a sentence."""
        return "the desired pose"

    def keeping(self, changed: "Trajectory", changes: Mapping[str, Any], time: float) -> "Trajectory":
        """`changed`, a path of the same kind that replaces this one at `time`, s, adjusted to begin close to the target.

        changes: the fields that a person set, by name.
        """
        return changed

    def taken_up(self, old: "Trajectory", given: Collection[str], time: float) -> "Trajectory":
        """This path, adjusted to replace `old`, one of another kind, at `time`, s; fields in `given`, set by a person, stay."""
        if "center" in type(self).model_fields and "center" not in given:
            return self.model_copy(update={"center": at_nearest_turn(old.middle, old, time)})
        return self


def at_nearest_turn(pose: Sequence[float], path: Trajectory, time: float) -> tuple[float, ...]:
    """`pose`, its angle by whole turns nearest to the path's at `time`, s, so that a new path does not unwind a spin."""
    x, y, angle = pose
    ahead = float(poses(build_motion(path), [time])[0, 0, 2]) - angle
    return x, y, angle + 2 * np.pi * round(ahead / (2 * np.pi))


@dataclass(frozen=True)
class Path:
    """One kind of desired motion. The field `kind` of `model` is its name everywhere."""

    model: type[Trajectory]
    kernel: Callable[..., None]
    rows: Callable[[Any], np.ndarray] | None = None
    """The kernel's table, from the model."""
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
        fields = [(name, "f8", (size,)) if size > 1 else (name, "f8") for name, size in own.items()]
        return np.dtype(fields or [("none", "f8")])

    def numbers(self, trajectory: Trajectory) -> np.ndarray:
        """The record of a model's numbers, (1,)."""
        record = np.zeros(1, self.record)
        for name in own_numbers(self.model, Trajectory):
            record[name] = getattr(trajectory, name)
        return record

    @cached_property
    def address(self) -> int:
        """Address of the kernel, compiled or loaded when first used."""
        return kernel_address(self.kernel, self.record, MATRIX, numba.float64, MATRIX)

    @property
    def is_loaded(self) -> bool:
        """Whether `address` is compiled or loaded."""
        return "address" in vars(self)


def _lacks(path: Path) -> str:
    if not hasattr(path.model, "kinks"):
        return ""
    return f"The path {path.kind!r} has a property 'kinks', which nothing asks for any more: call it 'discontinuities'."


PATHS = Registry(Path, "path", "PATH", "flexlab.control.paths", _lacks)
paths, add_path, add_path_file, forget_path, on_new_path = (
    PATHS.all,
    PATHS.add,
    PATHS.add_file,
    PATHS.forget,
    PATHS.on_new,
)


def build_motion(trajectory: Trajectory) -> DesiredMotion:
    """The kernel and numbers of a path, without ramp, shaper and transition."""
    path = PATHS[trajectory.kind]
    # A copy: kernels are compiled for arrays that can be written to, and only for those.
    rows = NO_ROWS if path.rows is None else np.array(path.rows(trajectory), dtype=float, order="C")
    inside = INSIDE * max(1.0, trajectory.end or 0.0) if trajectory.jumps else 0.0
    return DesiredMotion(path.address, path.numbers(trajectory).view(np.float64), rows, inside=inside)


@lru_cache(maxsize=64)
def _outline(trajectory: Trajectory) -> tuple[tuple[float, ...], ...]:
    """Lowest and highest pose and largest |acceleration| of the path itself, (3,) each."""
    motion = poses(build_motion(trajectory), np.linspace(*trajectory.window, OUTLINE_POINTS))
    found = motion[:, 0].min(axis=0), motion[:, 0].max(axis=0), np.abs(motion[:, 2]).max(axis=0)
    return tuple(tuple(map(float, part)) for part in found)
