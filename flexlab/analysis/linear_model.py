"""Linear models of a scenario, in the form that control tools take: `scipy.signal.StateSpace` with names and units."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.signal import StateSpace, dlti, lti

from flexlab.errors import StudyError

if TYPE_CHECKING:
    from flexlab.analysis.stability import DiskMargin


class Named(NamedTuple):
    """One state, input or output."""

    name: str
    """As "pose_x", "joint_torque_left_2"."""
    unit: str
    """SI."""


class About(NamedTuple):
    """What a linear model is of."""

    states: tuple[Named, ...]
    inputs: tuple[Named, ...]
    outputs: tuple[Named, ...]
    mass: np.ndarray
    """M, (n, n), over the first n states: pose (m, m, rad) and modal coordinates (m·kg^½)."""
    damping: np.ndarray
    """C, (n, n)."""
    stiffness: np.ndarray
    """K, (n, n), under the torques that hold the rest point."""
    pose: np.ndarray
    """Pose of the rest point, m, m, rad, (3,)."""
    torque: np.ndarray
    """Joint torques that hold it, N·m, (arms, 3)."""
    output_at_rest: np.ndarray
    """The outputs' values at the rest point, (outputs,): a run shows these plus the model's outputs."""
    closed: bool
    """Whether the control law is part of the model."""
    input_delay: int
    """Samples by which torques come late; part of the states."""
    note: str
    """What there is to know about the rest point, as a sentence."""
    disk_margin: "DiskMargin | None"
    """Margins of the closed loop; None of a law without torque."""


class LinearModel(StateSpace):
    """dz/dt = A z + B u (or z at the next control instant), y = C z + D u, all small changes from rest.

    A `scipy.signal.StateSpace`, so that `scipy.signal.lsim`, `step`, `dlsim`, `bode` take it; `about` holds M, C, K and the
    rest point. Made by `flexlab.linearize`.
    """

    about: About

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, in the order of A's rows."""
        return tuple(each.name for each in self.about.states)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of B's columns."""
        return tuple(each.name for each in self.about.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in the order of C's rows."""
        return tuple(each.name for each in self.about.outputs)

    @property
    def state_units(self) -> tuple[str, ...]:
        """Their units."""
        return tuple(each.unit for each in self.about.states)

    @property
    def input_units(self) -> tuple[str, ...]:
        """Their units."""
        return tuple(each.unit for each in self.about.inputs)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Their units."""
        return tuple(each.unit for each in self.about.outputs)

    @property
    def mass(self) -> np.ndarray:
        """M of M p̈ + C ṗ + K p = Σ𝒥ᵀτ, p: the first n states."""
        return self.about.mass

    @property
    def damping(self) -> np.ndarray:
        """C of the same equation."""
        return self.about.damping

    @property
    def stiffness(self) -> np.ndarray:
        """K of the same equation."""
        return self.about.stiffness

    @property
    def disk_margin(self) -> "DiskMargin | None":
        """Margins of the closed loop at the joint torques."""
        return self.about.disk_margin

    def to_control(self) -> Any:
        """The same model as a `control.StateSpace` of python-control; raises `StudyError` where that is not installed."""
        try:
            import control
        except ImportError:
            text = "python-control is not installed: pip install 'flexlab[control]' brings it."
            raise StudyError(text) from None
        names = {"states": self.state_names, "inputs": self.input_names, "outputs": self.output_names}
        step = 0 if self.dt is None else self.dt
        return control.ss(self.A, self.B, self.C, self.D, step, **{key: list(value) for key, value in names.items()})

    def __repr__(self) -> str:
        loop = "closed loop" if self.about.closed else "plant"
        kind = "continuous" if self.dt is None else f"sampled at {1e3 * float(self.dt):g} ms"
        counts = f"{len(self.about.states)} states, {len(self.about.inputs)} inputs, {len(self.about.outputs)} outputs"
        return f"LinearModel({loop}, {kind}, {counts})"

    def __str__(self) -> str:
        groups = (("inputs", self.about.inputs), ("outputs", self.about.outputs), ("states", self.about.states))
        lines = [repr(self), *(f"{title}: {', '.join(f'{n} [{u}]' for n, u in each)}" for title, each in groups)]
        return "\n".join(lines + ([self.about.note] if self.about.note else []))


class ContinuousLinearModel(LinearModel, lti):
    """A `LinearModel` of differential equations."""


class SampledLinearModel(LinearModel, dlti):
    """A `LinearModel` from one control instant to the next."""


def make_model(
    matrices: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], period: float | None, about: About
) -> LinearModel:
    """The model of A, B, C, D; sampled with a period, s."""
    # scipy's annotations say that a subclass makes its parent.
    model: Any = ContinuousLinearModel(*matrices) if period is None else SampledLinearModel(*matrices, dt=period)
    model.about = about
    return model
