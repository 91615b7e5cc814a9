"""Linear models of a scenario: `scipy.signal.StateSpace` with names and units."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.signal import StateSpace, dlti, lti

from flexlab.errors import StudyError

if TYPE_CHECKING:
    from flexlab.analysis.stability import DiskMargin


class Named(NamedTuple):
    """One state, input or output."""

    name: str
    """Name, as in "pose_x" or "joint_torque_left_2"."""
    unit: str
    """SI."""


class About(NamedTuple):
    """The names, matrices and rest point of a linear model."""

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
    """Delay of the torques in samples, which the states include."""
    note: str
    """A remark on the rest point; empty: none."""
    disk_margin: "DiskMargin | None"
    """Margins of the closed loop."""


class LinearModel(StateSpace):
    """dz/dt = A z + B u (or z at the next control instant), y = C z + D u for small changes from rest.

    It is a `scipy.signal.StateSpace`, which `scipy.signal.lsim`, `step`, `dlsim` and `bode` take; `about` holds M, C, K and
    the rest point. `flexlab.linearize` makes it.
    """

    about: About
    state_names: tuple[str, ...]
    """Names of the states, in the order of A's rows."""
    input_names: tuple[str, ...]
    """Names of the inputs, in the order of B's columns."""
    output_names: tuple[str, ...]
    """Names of the outputs, in the order of C's rows."""
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    mass: np.ndarray
    """M of M p̈ + C ṗ + K p = Σ𝒥ᵀτ, where p are the first n states."""
    damping: np.ndarray
    """C of the same equation."""
    stiffness: np.ndarray
    """K of the same equation."""
    disk_margin: "DiskMargin | None"
    """Margins of the closed loop at the joint torques."""

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of A, 1/s (or factors from one control instant to the next)."""
        return np.linalg.eigvals(self.A)  # scipy takes the roots of a polynomial, and fails for several outputs.

    def to_control(self) -> Any:
        """The model as a `control.StateSpace` of python-control. Raises `StudyError` if that is not installed."""
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


def make_model(matrices: tuple[np.ndarray, ...], period: float | None, about: About) -> LinearModel:
    """The model with A, B, C, D; sampled if `period`, s, is given."""
    # By scipy's annotations, a subclass constructs its parent.
    model: Any = ContinuousLinearModel(*matrices) if period is None else SampledLinearModel(*matrices, dt=period)
    model.about = about
    vars(model).update(mass=about.mass, damping=about.damping, stiffness=about.stiffness, disk_margin=about.disk_margin)
    for kind, named in (("state", about.states), ("input", about.inputs), ("output", about.outputs)):
        vars(model).update({f"{kind}_names": tuple(name for name, _ in named)})
        vars(model).update({f"{kind}_units": tuple(unit for _, unit in named)})
    return model
