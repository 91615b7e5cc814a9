"""Vibration modes of the payload, and poles of the whole closed loop about its rest point."""

from dataclasses import dataclass, field
from functools import cached_property
from html import escape

import numpy as np

from flexlab.analysis.disk_margin import DiskMargin, find_disk_margin
from flexlab.analysis.linearization import Linearization, linearize_loop
from flexlab.analysis.loop_poles import NEUTRAL, find_poles
from flexlab.analysis.loop_probe import LoopProbe
from flexlab.analysis.pole_table import PoleRow, modes_text, pole_rows
from flexlab.analysis.rest_point import find_rest
from flexlab.errors import StudyError
from flexlab.scenario import Scenario
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.build import build_beam
from flexlab.sim.termination import pose_fault

POSE, MEMORY, ON_THEIR_WAY = "pose", "law's memory", "torques on their way"
"""What a pole can be of, besides the beam's modes."""


@dataclass(frozen=True, repr=False)
class Modes:
    """Modes in ascending frequency; n_m modes, n_q nodal coordinates, arrays read-only. `print` shows a table."""

    frequency: np.ndarray
    """Undamped frequencies of the beam with its grips held, Hz, (n_m,)."""
    damping_ratio: np.ndarray
    """ζ of each mode alone, D_kk/(2ω_k), (n_m,); nodal damping also couples modes, see `poles`."""
    shape: np.ndarray
    """Mass-normalised nodal shapes, deflections (1/√kg) and slopes, (n_q, n_m)."""
    lateral_participation: np.ndarray
    """Share of the payload's mass that moves with a mode when both grips move sideways, (n_m,)."""
    angular_participation: np.ndarray
    """Share of the payload's inertia that moves with a mode when the virtual link turns, (n_m,)."""
    pose: np.ndarray
    """Where the loop rests while the pose asked for is held (weight may pull it down), m, m, rad, (3,)."""
    poles: np.ndarray
    """Poles of arms, beam and control law about that rest point, 1/s, complex, by magnitude, (poles,).

    2 n_m + 6, and those of the law's memory that moves in the first order. With a control period T_c: of the map over one
    period, log(z)/T_c, so that frequencies fold at 1/(2 T_c); torques on their way are part of it.
    """
    pole_origin: tuple[str, ...]
    """What each pole is of: "pose", "beam mode 3", "law's memory" or "torques on their way", (poles,)."""
    control_period: float | None
    """T_c, s; None: a continuous law."""
    input_delay: int
    """Samples by which torques come late."""
    note: str
    """What there is to know about the poles, as a sentence; why there are none, if there are none."""
    linearization: Linearization | None = field(repr=False, compare=False)
    """What the poles are of; None without a rest point."""

    @property
    def pole_frequency(self) -> np.ndarray:
        """|pole|/2π, Hz."""
        return np.abs(self.poles) / (2 * np.pi)

    @property
    def pole_damping_ratio(self) -> np.ndarray:
        """-Re/|pole|: 1 for a decay without oscillation, negative for an unstable pole."""
        return -self.poles.real / np.maximum(np.abs(self.poles), np.finfo(float).tiny)

    @property
    def growth(self) -> float:
        """The largest real part of the poles, 1/s: how fast the loop runs away, if positive. NaN without poles."""
        return float(self.poles.real.max()) if len(self.poles) else float("nan")

    @property
    def unstable(self) -> bool:
        """Whether some pole grows by more than `loop_poles.NEUTRAL`."""
        return bool(np.any(self.poles.real > NEUTRAL))

    @cached_property
    def disk_margin(self) -> DiskMargin | None:
        """How much all motors' gain and phase may change; None without poles."""
        if self.linearization is None:
            return None
        with one_blas_thread():
            return find_disk_margin(self.linearization, self.poles)

    def pole_rows(self, most: int | None = None) -> list[PoleRow]:
        """One row for each pole or conjugate pair: those that grow first, then by magnitude; `most`: rows at most."""
        return pole_rows(self.poles, self.pole_origin, most)

    def __str__(self) -> str:
        return modes_text(self)

    def _repr_html_(self) -> str:
        """The modes' and the poles' tables, for notebooks."""
        return f"<p>{escape(repr(self))}</p><pre>{escape(str(self))}</pre>"

    def __repr__(self) -> str:
        loop = "no rest point" if not len(self.poles) else "the loop grows" if self.unstable else "a stable loop"
        return (
            f"<Modes: {len(self.frequency)}, the first at {self.frequency[0]:.4g} Hz; {len(self.poles)} poles, {loop}>"
        )


def modes(scenario: Scenario, pose: tuple[float, float, float] | None = None) -> Modes:
    """Modes of the payload, and poles of the closed loop while `pose` (None: the trajectory's centre) is held.

    The loop is linearised about its rest point, with the law's memory as at its start or, where it moves, as it comes to
    rest. Without a rest point there are no poles, and `note` says why. Raises `ScenarioError` for a scenario that is not
    valid and `StudyError` for a pose that an arm cannot take.
    """
    with one_blas_thread():
        return _modes(scenario.replace({}), pose)


def _modes(scenario: Scenario, pose: tuple[float, float, float] | None) -> Modes:
    at = check_pose(scenario, pose)
    beam = build_beam(scenario.payload)
    order = np.argsort(beam.modes.omega)
    omega, V = beam.modes.omega[order], beam.modes.V[:, order]
    h, g = V.T @ beam.matrices.h, V.T @ beam.matrices.g
    try:
        linear, note = linearize_at(scenario, at), ""
    except StudyError as error:
        linear, note = None, str(error)
    poles = np.zeros(0, dtype=complex)
    origin: tuple[str, ...] = ()
    if linear is not None:
        found = find_poles(linear)
        rank = np.argsort(order)
        names = [POSE, *(f"beam mode {rank[k] + 1}" for k in range(len(omega))), MEMORY, ON_THEIR_WAY]
        poles, origin = found.value, tuple(names[k] for k in np.argmax(found.share, axis=1))
        note = drift_note(linear)
    result = Modes(
        frequency=omega / (2 * np.pi),
        damping_ratio=np.diag(beam.modes.D)[order] / (2 * omega),
        shape=V,
        lateral_participation=h**2 / beam.matrices.m,
        angular_participation=g**2 / beam.matrices.I,
        pose=at if linear is None else linear.rest.motion.x.copy(),
        poles=poles,
        pole_origin=origin,
        control_period=scenario.controller.control_period,
        input_delay=scenario.controller.input_delay,
        note=note,
        linearization=linear,
    )
    for array in vars(result).values():
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return result


def check_pose(scenario: Scenario, pose: tuple[float, float, float] | None) -> np.ndarray:
    """The pose to hold, (3,); raises `StudyError` for one that is no pose or that an arm cannot take."""
    try:
        at = np.array(scenario.trajectory.middle if pose is None else pose, dtype=float)
    except (TypeError, ValueError):
        at = np.zeros(0)
    if at.shape != (3,) or not np.all(np.isfinite(at)):
        raise StudyError(f"pose = {pose!r} is not usable: give three numbers, x and y in m and θ in rad.")
    fault = pose_fault(scenario, at, 0.0, "the pose of the linearisation")
    if fault is not None:
        raise StudyError(fault.text)
    return at


def linearize_at(scenario: Scenario, pose: np.ndarray) -> Linearization:
    """The loop linearised about where it rests while `pose` (3,) is held; raises `StudyError` if it rests nowhere."""
    probe = LoopProbe(scenario)
    return linearize_loop(probe, find_rest(probe, pose))


def drift_note(linear: Linearization) -> str:
    """A sentence where the law's memory never rests; empty otherwise."""
    if not linear.rest.drifting:
        return ""
    return (
        "The law's memory never comes to rest here (its estimates go on growing): poles with its values at the start."
    )
