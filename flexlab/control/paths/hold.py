"""No motion: one pose, held."""

from collections.abc import Collection
from typing import Literal

from flexlab.compiled import pluggable
from flexlab.control.motion import poses
from flexlab.control.path import Path, Trajectory, build_motion
from flexlab.quantities import Triple, quantity


class Hold(Trajectory):
    """x_d = pose."""

    kind: Literal["hold"] = "hold"
    pose: Triple = quantity(
        (0.0, 0.75, 0.0), "Pose (x, y, θ)", "x_d", "m, m, rad", low=-100, high=100, slider=(-1, 1.5)
    )

    @property
    def span(self) -> float:
        """0, as it rests."""
        return 0.0

    @property
    def end(self) -> float:
        """0, as it never moves."""
        return 0.0

    @property
    def middle(self) -> tuple[float, ...]:
        """The pose."""
        return self.pose

    @property
    def reach(self) -> tuple[float, ...]:
        """It does not move."""
        return 0.0, 0.0, 0.0

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """It does not accelerate."""
        return 0.0, 0.0, 0.0

    def taken_up(self, old: Trajectory, given: Collection[str], time: float) -> Trajectory:
        """It holds the present target."""
        here = tuple(poses(build_motion(old), [time])[0, 0].tolist())
        return self if "pose" in given else self.model_copy(update={"pose": here})


@pluggable
def hold(path, rows, t, desired):
    """A constant."""
    for a in range(3):
        desired[0, a] = path.pose[a]
        desired[1, a] = desired[2, a] = 0.0


PATH = Path(Hold, hold, place=80)
