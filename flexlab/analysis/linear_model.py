"""Linear models of a scenario: `scipy.signal.StateSpace` with names and units."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.linalg import eigvals
from scipy.signal import StateSpace, TransferFunction, ZerosPolesGain, dlti, lti

from flexlab.arguments import whole_number
from flexlab.errors import StudyError
from flexlab.text import counted

if TYPE_CHECKING:
    from flexlab.analysis.stability import DiskMargin


INFINITE = 1e6
"""Magnitude from which a zero counts as infinite, as a multiple of the fastest pole's."""
OUTSIDE = (1.5, 2.1, 2.9)
"""Points at which the gain may be evaluated, as multiples of the fastest pole's magnitude: one is far from all zeros."""
LOST = 1e-3
"""Largest error of the polynomials that `to_tf` returns, relative to the largest response."""


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
    """A remark on the rest point, or ""."""
    disk_margin: "DiskMargin | None"
    """Margins of the closed loop."""


class LinearModel(StateSpace):
    """dz/dt = A z + B u (or z at the next control instant), y = C z + D u for small changes from rest.

    It is a `scipy.signal.StateSpace` for `scipy.signal.lsim` and `dlsim`; with one input also for `step`, and with one input and
    one output for `bode` and `dbode`. `about` holds M, C, K and the rest point. `flexlab.linearize` returns it.
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

    @property
    def _matrices(self) -> tuple[np.ndarray, ...]:
        return tuple(np.asarray(part) for part in (self.A, self.B, self.C, self.D))

    def response(self, points: complex | np.ndarray) -> np.ndarray:
        """C (s - A)⁻¹ B + D at complex `points` (…): s = iω in 1/s, or z = exp(iωT_c); (…, outputs, inputs).

        Raises `StudyError` at a pole, and for what is not a finite number.
        """
        s, (A, B, C, D) = np.asarray(points), self._matrices
        if s.dtype.kind not in "iufc" or not np.isfinite(s).all():
            raise StudyError(f"points = {points!r:.60} is not usable: give finite numbers s in 1/s, as in [2j, 20j].")
        try:
            return C @ np.linalg.solve(s[..., None, None] * np.eye(len(A)) - A, B.astype(complex)) + D
        except np.linalg.LinAlgError:
            raise StudyError(f"points = {points!r:.60}: one is a pole, where the response is infinite.") from None

    def _of_input(self, number: int) -> "LinearModel":
        number = whole_number("input", number, 0, len(self.about.inputs) - 1)
        (A, B, C, D), chosen = self._matrices, slice(number, number + 1)
        return make_model(
            (A, B[:, chosen], C, D[:, chosen]), self.dt, self.about._replace(inputs=self.about.inputs[chosen])
        )

    def to_zpk(self, input: int | None = None) -> ZerosPolesGain:
        """Zeros, poles and gain, as `zeros`, `bode` and `freqresp` use them. Raises `StudyError` for more than one channel.

        `input`: the number of the input if there are several, from 0. Zeros and poles are computed as eigenvalues, since
        scipy's polynomials lose all digits in a sampled loop.
        """
        if input is not None:
            return self._of_input(input).to_zpk()
        self._check_channel("A transfer function", outputs=True)
        (A, B, C, D), poles = self._matrices, self.poles
        b, c = (float(np.abs(part).max()) for part in (B, C))
        if (b == 0 or c == 0) and not D.any():
            return ZerosPolesGain([], poles, 0.0, **self._dt_dict)
        b, c = b or 1.0, c or 1.0
        pencil, weight = np.block([[A, B / b], [C / c, D / (b * c)]]), np.diag([*np.ones(len(A)), 0.0])
        zeros = eigvals(pencil, weight)
        fastest = max(1.0, float(np.abs(poles).max(initial=0.0)))
        zeros = zeros[np.abs(zeros) < INFINITE * fastest]
        place = max((ratio * fastest for ratio in OUTSIDE), key=lambda s: np.abs(s - zeros).min(initial=np.inf))
        ratio = np.exp(np.log(place - poles + 0j).sum() - np.log(place - zeros + 0j).sum())
        gain = float((self.response(np.array([place]))[0, 0, 0] * ratio).real)
        return ZerosPolesGain(zeros, poles, gain, **self._dt_dict)

    def to_tf(self, input: int | None = None) -> TransferFunction:
        """The transfer function of the channel of `to_zpk`. Raises `StudyError` if its polynomials lose the digits."""
        if input is not None:
            return self._of_input(input).to_tf()
        factors = self.to_zpk()
        function = factors.to_tf()
        fastest = max(1.0, float(np.abs(factors.poles).max(initial=0.0)))
        points = (
            1j * fastest * np.logspace(-4, 0, 40) if self.dt is None else np.exp(1j * np.pi * np.logspace(-3, 0, 40))
        )
        exact = self.response(points)[:, 0, 0]
        error = np.abs(np.polyval(function.num, points) / np.polyval(function.den, points) - exact)
        if not np.all(error <= LOST * np.abs(exact).max()):
            raise StudyError(
                f"Polynomials of {len(self.A)} states lose the digits of this transfer function: use to_zpk, bode, response "
                "or to_control."
            )
        return function

    def _check_channel(self, what: str, outputs: bool = False) -> None:
        inputs, those = len(self.about.inputs), len(self.about.outputs)
        if inputs == 1 and (not outputs or those == 1):
            return
        wants = "one input and one output" if outputs else "one input"
        has = counted(inputs, "input") + (f" and {counted(those, 'output')}" if outputs else "")
        example = 'inputs="desired_pose_y"' + (', outputs="pose_y"' if outputs else "")
        raise StudyError(f"{what} needs {wants}, and this model has {has}: name one, as in linearize(…, {example}).")

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
        about = (("state", self.about.states), ("input", self.about.inputs), ("output", self.about.outputs))
        return f"LinearModel({loop}, {kind}, {', '.join(counted(len(names), thing) for thing, names in about)})"

    def __str__(self) -> str:
        groups = (("inputs", self.about.inputs), ("outputs", self.about.outputs), ("states", self.about.states))
        lines = [repr(self), *(f"{title}: {', '.join(f'{n} [{u}]' for n, u in each)}" for title, each in groups)]
        return "\n".join(lines + ([self.about.note] if self.about.note else []))


class ContinuousLinearModel(LinearModel, lti):
    """A `LinearModel` of differential equations."""

    def step(self, X0: Any = None, T: Any = None, N: Any = None) -> Any:
        """The response to a step of the only input, as by `scipy.signal.step`. Raises `StudyError` for more inputs."""
        self._check_channel("A step response")
        return super().step(X0, T, N)

    def impulse(self, X0: Any = None, T: Any = None, N: Any = None) -> Any:
        """The response to an impulse in the only input, as by `scipy.signal.impulse`. Raises `StudyError` for more inputs."""
        self._check_channel("An impulse response")
        return super().impulse(X0, T, N)

    def to_discrete(self, dt: float, method: str = "zoh", alpha: float | None = None) -> StateSpace:
        """The model sampled with a period of `dt`, s, as by `scipy.signal.StateSpace.to_discrete`."""
        return StateSpace(self.A, self.B, self.C, self.D).to_discrete(dt, method, alpha)


class SampledLinearModel(LinearModel, dlti):
    """A `LinearModel` from one control instant to the next."""

    def _as_tf(self) -> Any:
        return self.to_zpk()  # scipy's dfreqresp accepts both forms, but asks for polynomials.


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
