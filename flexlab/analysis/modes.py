"""Vibration modes of the payload and poles of the closed loop about its rest point, with their tables."""

from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from typing import Any, NamedTuple

import numpy as np

from flexlab.analysis.linearization import Linearization, linearize_loop
from flexlab.analysis.rest_point import LoopProbe, find_rest
from flexlab.analysis.stability import NEUTRAL, DiskMargin, find_disk_margin, find_poles
from flexlab.errors import StudyError
from flexlab.lapack import one_blas_thread
from flexlab.presets import AnyScenario, any_scenario
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.termination import pose_fault
from flexlab.text import aligned, counted, number_text

SHOWN = 9
"""Decimals of a rest point: the others are rounding errors."""
MOST_ROWS = 16
"""Largest number of rows in a printed table, unless more poles grow: faster poles decay before anybody sees them."""


class PoleRow(NamedTuple):
    """A real pole, or a conjugate pair."""

    frequency: float
    """|pole|/2π of a pair, Hz; 0 of a real pole."""
    damping_ratio: float
    """-Re/|pole|; NaN of a pole at 0."""
    rate: float
    """Real part, 1/s: negative decays."""
    origin: str
    """What the pole belongs to, as in `Modes.pole_origin`."""

    @property
    def mode(self) -> int:
        """Number of the beam mode, from 1; 0: pose or memory."""
        return mode_number(self.origin)

    @property
    def verdict(self) -> str:
        """One of "grows", "stays" and "decays"."""
        if self.rate > NEUTRAL:
            return "grows"
        return "stays" if self.rate > -NEUTRAL else "decays"


def sampling_text(control_period: float | None, input_delay: int) -> str:
    """The sampling in words, as "sampled at 1 ms, torques 1 sample late"; "continuous" without a control period."""
    if control_period is None:
        return "continuous"
    text = f"sampled at {1e3 * control_period:g} ms"
    return f"{text}, torques {counted(input_delay, 'sample')} late" if input_delay else text


def _beam_lines(modes: "Modes") -> list[str]:
    rows = [("mode", "f (Hz)", "ζ (%)", "sideways (%)", "turning (%)")]
    for k, frequency in enumerate(modes.frequency[:MOST_ROWS]):
        shares = (f"{100 * each[k]:.1f}" for each in (modes.lateral_participation, modes.angular_participation))
        rows.append((f"{k + 1}", f"{frequency:.2f}", f"{100 * modes.damping_ratio[k]:.3g}", *shares))
    lines = aligned(rows, len(rows[0]))
    if len(modes.frequency) > MOST_ROWS:
        lines.append(f"… and {counted(len(modes.frequency) - MOST_ROWS, 'higher mode')}")
    return lines


def _pole_lines(modes: "Modes") -> list[str]:
    loop, pose = "continuous loop", ", ".join(f"{round(value, SHOWN) + 0.0:.4g}" for value in modes.pose)
    if modes.control_period is not None:
        loop = f"sampled loop, {sampling_text(modes.control_period, modes.input_delay)}"
    head = f"Poles of the {loop}, at rest at ({pose}) m, m, rad"
    everything = modes.pole_rows()
    if not everything:
        return [f"{head}: none"]
    rows = [("f (Hz)", "ζ (%)", "rate (1/s)", "", "of")]
    most = max(MOST_ROWS, sum(row.verdict == "grows" for row in everything))
    for row in everything[:most]:
        frequency = f"{row.frequency:.2f}" if row.frequency else "–"
        verdict = row.verdict.upper() if row.verdict == "grows" else row.verdict
        ratio = f"{100 * row.damping_ratio:.3g}" if row.rate or row.frequency else "–"
        rows.append((frequency, ratio, f"{row.rate:+.4g}" if row.rate else "0", verdict, row.origin))
    lines = [head, "", *aligned(rows, 3)]
    if len(everything) > most:
        lines.append(f"… and {len(everything) - most} more, none of which grows")
    if modes.unstable:
        lines += ["", f"UNSTABLE: small motions grow at {number_text(modes.growth, 3)} 1/s."]
    return lines


POSE, MEMORY, ON_THEIR_WAY = "pose", "law's memory", "torques on their way"
"""Origins of poles besides the beam's modes."""


@dataclass(frozen=True, repr=False, eq=False)
class Modes:
    """Modes in ascending frequency; n_m modes, n_q nodal coordinates, arrays read-only. `print` shows a table."""

    frequency: np.ndarray
    """Undamped frequencies of the beam with its grips held and without a force along it, Hz, (n_m,)."""
    damping_ratio: np.ndarray
    """ζ of each mode alone, D_kk/(2ω_k), (n_m,); nodal damping also couples modes, see `poles`."""
    shape: np.ndarray
    """Mass-normalised nodal shapes, deflections (1/√kg) and slopes, (n_q, n_m)."""
    lateral_participation: np.ndarray
    """Share of the payload's mass that moves with a mode when both grips move sideways, (n_m,)."""
    angular_participation: np.ndarray
    """Share of the payload's inertia that moves with a mode when the virtual link turns, (n_m,)."""
    pose: np.ndarray
    """Rest point under the desired pose, from which weight may pull it down, m, m, rad, (3,)."""
    poles: np.ndarray
    """Poles of arms, beam and control law about that rest point, 1/s, complex, by magnitude, (poles,).

    There are 2 n_m + 6, plus those of the law's memory that changes to first order. With a control period T_c they are log(z)/T_c
    for the eigenvalues z of the map over one period, torques on their way included; frequencies fold at 1/(2 T_c).
    """
    pole_origin: tuple[str, ...]
    """The origin of each pole: "pose", "beam mode 3", "law's memory" or "torques on their way", (poles,)."""
    control_period: float | None
    """T_c, s; None: a continuous law."""
    input_delay: int
    """Delay of the torques in samples."""
    note: str
    """A remark on the poles, or the reason why there are none; empty: no remark."""
    is_loaded: bool
    """Whether the beam feels the force along it, which changes its frequencies in the loop, see `poles`."""
    linearization: Linearization | None = field(repr=False, compare=False)
    """The linearised loop; None without a rest point."""

    def __post_init__(self) -> None:
        self.__setstate__(vars(self))

    def __setstate__(self, parts: dict[str, Any]) -> None:
        """Take the parts of new modes, or of a copy or a pickle; arrays become read-only."""
        vars(self).update(parts)
        for array in parts.values():
            if isinstance(array, np.ndarray):
                array.flags.writeable = False

    @property
    def pole_frequency(self) -> np.ndarray:
        """|pole|/2π, Hz."""
        return np.abs(self.poles) / (2 * np.pi)

    @property
    def pole_damping_ratio(self) -> np.ndarray:
        """-Re/|pole|: 1 for a decay without oscillation, negative for an unstable pole; NaN of a pole at 0."""
        with np.errstate(invalid="ignore"):
            return -self.poles.real / np.abs(self.poles) + 0.0

    @property
    def growth(self) -> float:
        """The largest real part of the poles, 1/s, which is the growth rate of an unstable loop. NaN without poles."""
        return float(self.poles.real.max()) if len(self.poles) else float("nan")

    @property
    def unstable(self) -> bool:
        """Whether some pole grows by more than `stability.NEUTRAL`."""
        return bool(np.any(self.poles.real > NEUTRAL))

    @cached_property
    def disk_margin(self) -> DiskMargin | None:
        """Margins of gain and phase at the motors; None without poles."""
        if self.linearization is None:
            return None
        with one_blas_thread():
            return find_disk_margin(self.linearization, self.poles)

    def pole_rows(self, most: int | None = None) -> list[PoleRow]:
        """A row per pole or conjugate pair: growing ones first, from the fastest, then by magnitude; at most `most` rows."""
        rows = []
        for pole, name in zip(self.poles, self.pole_origin, strict=True):
            if pole.imag >= 0:
                size = abs(pole)
                frequency = size / (2 * np.pi) if pole.imag > 0 else 0.0
                rows.append(PoleRow(frequency, -pole.real / size + 0.0 if size else np.nan, pole.real, name))
        return sorted(rows, key=lambda row: -max(row.rate, NEUTRAL))[:most]

    @property
    def beam_title(self) -> str:
        """What the beam's own modes are of."""
        return f"Beam with its grips held{', no axial force' if self.is_loaded else ''}"

    def __str__(self) -> str:
        lines = [self.beam_title, "", *_beam_lines(self), "", *_pole_lines(self)]
        return "\n".join(lines + (["", self.note] if self.note else []))

    def _repr_html_(self) -> str:
        return f"<p>{escape(repr(self))}</p><pre>{escape(str(self))}</pre>"

    def __repr__(self) -> str:
        loop = "no rest point" if not len(self.poles) else "the loop grows" if self.unstable else "a stable loop"
        rigid = ", with rigid grips" if RIGID in self.note else ""
        return f"<Modes: {len(self.frequency)}, the first at {self.frequency[0]:.4g} Hz; {len(self.poles)} poles, {loop}{rigid}>"


@one_blas_thread()
def modes(scenario: AnyScenario, pose: tuple[float, float, float] | None = None) -> Modes:
    """Modes of the payload, and poles of the closed loop while `pose` (None: the trajectory's centre) is held.

    `scenario`: as in `flexlab.simulate`. `print(flexlab.modes("paper"))` shows the tables.

    The loop is linearised about its rest point, with the law's memory at its start value or, if it moves, at its rest value.
    Without a rest point there are no poles, and `note` says why. Raises `ScenarioError` for an invalid scenario and
    `StudyError` for a pose that an arm cannot take.
    """
    scenario = any_scenario(scenario).replace({})
    at, beam = check_pose(scenario, pose), build_beam(scenario.payload)
    order = np.argsort(beam.modes.omega)
    omega, V = beam.modes.omega[order], beam.modes.V[:, order]
    h, g = V.T @ beam.matrices.h, V.T @ beam.matrices.g
    try:
        linear, note = linearize_at(scenario, at), ""
    except StudyError as error:
        linear, note = None, str(error)
    poles, origin = np.zeros(0, dtype=complex), tuple[str, ...]()
    if linear is not None:
        found = find_poles(linear)
        rank = np.argsort(order)
        names = [POSE, *(f"{BEAM_MODE}{rank[k] + 1}" for k in range(len(omega))), MEMORY, ON_THEIR_WAY]
        poles, origin = found.value, tuple(names[k] for k in np.argmax(found.share, axis=1))
        note = loop_note(linear)
    return Modes(
        frequency=omega / (2 * np.pi), damping_ratio=np.diag(beam.modes.D)[order] / (2 * omega), shape=V,
        lateral_participation=h**2 / beam.matrices.m, angular_participation=g**2 / beam.matrices.I,
        pose=at if linear is None else linear.rest.motion.x.copy(), poles=poles, pole_origin=origin,
        control_period=scenario.controller.control_period, input_delay=scenario.controller.input_delay, note=note,
        is_loaded=scenario.payload.axial_load != "none", linearization=linear,
    )  # fmt: skip


BEAM_MODE = "beam mode "
"""Prefix of the origin of a beam mode's pole."""


def mode_number(origin: str) -> int:
    """The number of the beam mode to which a pole of this origin belongs, from 1; 0 for no beam mode."""
    return int(origin.removeprefix(BEAM_MODE)) if origin.startswith(BEAM_MODE) else 0


class Ring(NamedTuple):
    """The oscillation of a beam mode in the closed loop."""

    frequency: float
    """Hz, without the folding by sampling."""
    rate: float
    """1/s: negative decays."""


def rings_of(found: Modes) -> dict[int, Ring]:
    """Mode number → its oscillation, for each mode that oscillates.

    Sampling folds frequencies: among those that fold to the same one, the nearest to the mode's own frequency is taken.
    """
    rings: dict[int, Ring] = {}
    for pole, name in zip(found.poles, found.pole_origin, strict=True):
        number, seen = mode_number(name), float(pole.imag) / (2 * np.pi)
        if seen <= 0 or not number:
            continue
        own = float(found.frequency[number - 1])
        if found.control_period is not None:
            rate = 1 / found.control_period
            folds = [turns * rate + side * seen for turns in range(int(own / rate) + 2) for side in (-1, 1)]
            seen = min((f for f in folds if f > 0), key=lambda f: abs(f - own))
        if number not in rings or pole.real > rings[number].rate:
            rings[number] = Ring(seen, float(pole.real))
    return rings


def fastest_growth(found: Modes) -> PoleRow | None:
    """The fastest growing pole, or the one that decays least; None without poles.

    Its frequency is that of its oscillation; for a beam mode, without the folding by sampling.
    """
    worst = max(found.pole_rows(), key=lambda row: row.rate, default=None)
    if worst is None:
        return None
    seen = worst.frequency * float(np.sqrt(1 - worst.damping_ratio**2)) if worst.frequency else 0.0
    rings = rings_of(found)
    return worst._replace(frequency=rings[worst.mode].frequency if worst.mode in rings else seen)


def check_pose(scenario: Scenario, pose: tuple[float, float, float] | None) -> np.ndarray:
    """The pose to hold, (3,). Raises `StudyError` if it is not a pose or an arm cannot take it."""
    try:
        given = np.array(scenario.trajectory.middle if pose is None else pose)
        at = given.astype(float) if given.dtype.kind in "iuf" else np.zeros(0)
    except (TypeError, ValueError, OverflowError):
        at = np.zeros(0)
    if at.shape != (3,) or not np.all(np.isfinite(at)):
        raise StudyError(f"pose = {pose!r:.60} is not usable: give three numbers, x and y in m and θ in rad.")
    fault = pose_fault(scenario, at, 0.0, "the pose of the linearisation")
    if fault is not None:
        raise StudyError(fault.text)
    return at


def linearize_at(scenario: Scenario, pose: np.ndarray) -> Linearization:
    """The loop linearised about its rest point under the desired pose (3,). Raises `StudyError` if there is none."""
    probe = LoopProbe(scenario)
    return linearize_loop(probe, find_rest(probe, pose))


def loop_note(linear: Linearization) -> str:
    """Sentences on what the linear model of a loop leaves out; empty for nothing."""
    notes = []
    if linear.rest.drifting:
        notes.append(
            "The law's memory never comes to rest here (its estimates keep growing): these poles are for its start values."
        )
    if linear.probe.original.grips.active:
        notes.append(RIGID)
    if linear.probe.original.payload.mass_change.active:
        notes.append("The payload's mass changes (payload.mass_change): this holds for its mass at the start.")
    return " ".join(notes)


RIGID = (
    "The grips give way here (grips.model), but this holds for rigid grips: only a run shows whether the loop is stable and how "
    "the beam rings."
)
