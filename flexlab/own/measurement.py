"""What a control law in Python measures at an instant, and what it believes of the plant and the sensors.

Its beliefs are a block of numbers that goes with each call.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from flexlab.physics.law_input import MOST_GAUGES

MOST_MODES, PLACES = 8, 17
"""The most modes, and the number of equally spaced places on the beam at which their shapes are given."""
_SHAPES: dict[str, tuple[int, ...]] = {
    "counts": (2,),
    "wanted_force": (),
    "rigid_mass": (3, 3),
    "coupling": (3, MOST_MODES),
    "omega": (MOST_MODES,),
    "stiffness": (MOST_MODES, MOST_MODES),
    "damping": (MOST_MODES, MOST_MODES),
    "loads": (2, MOST_MODES),
    "shapes": (PLACES, MOST_MODES),
    "strain": (MOST_GAUGES, MOST_MODES),
    "gauge_places": (MOST_GAUGES,),
    "pose_noise": (3,),
    "rate_noise": (3,),
    "strain_noise": (),
    "moment_rate_noise": (2,),
    "length": (),
}
BELIEVED = np.dtype([(name, "f8", shape) for name, shape in _SHAPES.items()])
"""`counts`: numbers of modes and of gauges; arrays are filled from the start. `loads`: h and g."""
BELIEVED_SIZE = BELIEVED.itemsize // 8


def finite_numbers(given: Any, *shapes: tuple[int, ...]) -> np.ndarray | None:
    """`given` as `real_numbers`; None unless all are finite and the array has one of the shapes."""
    try:
        found = real_numbers(given)
    except (TypeError, ValueError):
        return None
    return found if found.shape in shapes and bool(np.isfinite(found).all()) else None


def real_numbers(given: Any) -> np.ndarray:
    """`given` as an array of floats. Raises TypeError for what NumPy would convert silently, ValueError for what is not an array.

    NumPy drops the imaginary part of complex numbers and the mask of masked arrays, and reads texts as numbers.
    """
    rows = given if isinstance(given, (list, tuple)) else (given,)
    if any(isinstance(row, np.ma.MaskedArray) for row in rows):
        raise TypeError("a masked array, where every number has to be there")
    found = np.asarray(given)
    if found.dtype.kind == "O":
        kinds = {np.asarray(one).dtype.kind for one in found.flat}
    else:
        kinds = {found.dtype.kind}
    if "c" in kinds:
        raise TypeError("complex numbers, where real ones are due")
    if kinds & set("SUMmV"):
        raise TypeError("texts or times, where numbers are due")
    try:
        return found.astype(float)
    except OverflowError as error:  # A whole number beyond all floats.
        raise ValueError(str(error)) from None


class Modes(NamedTuple):
    """The beam's lowest modes, undamped and with held ends, as the controller believes."""

    frequencies: np.ndarray
    """Hz, (modes,)."""
    places: np.ndarray
    """Places s on the beam, from its middle, m, (17,)."""
    shapes: np.ndarray
    """Deflection at `places` by modal coordinates η, 1/kg^½, (17, modes)."""


class Believed:
    """The linear plant that the controller believes in, with its lowest modes, and its sensors' noise; nothing is measured.

    M p̈ + D ṗ + K p = f over p = (x, η), pose and modal coordinates, for a straight beam at rest at the path's centre, with f the
    forces on them; n = 3 + modes. Weight and what turns with the pose are left out. Arrays are shared: do not change them.
    """

    def __init__(self, told: bytes, modes: int | None = None):
        """`told`: a `BELIEVED` record; `modes`: the most modes to keep, all unless given."""
        own = self._told = np.frombuffer(told, BELIEVED)[0]
        self._known: dict[int, Believed] = {}
        most, gauges = own["counts"].astype(int).tolist()
        count = most if modes is None else min(modes, most)
        self.mode_count: int = count
        """Number of modes: 8, or all if the beam has fewer."""
        self.mass: np.ndarray = np.eye(3 + count)
        """M, kg, kg·m, kg·m²; kg^½, m·kg^½; 1: (n, n)."""
        self.mass[:3, :3] = own["rigid_mass"]
        self.mass[:3, 3:] = own["coupling"][:, :count]
        self.mass[3:, :3] = self.mass[:3, 3:].T
        self.damping: np.ndarray = np.zeros((3 + count, 3 + count))
        """D, 1/s, of the modes alone, (n, n)."""
        self.damping[3:, 3:] = own["damping"][:count, :count]
        self.stiffness: np.ndarray = np.zeros((3 + count, 3 + count))
        """K, 1/s², of the modes alone, with what the steady force along the beam adds if that is believed, (n, n)."""
        self.stiffness[3:, 3:] = own["stiffness"][:count, :count]
        self.omega: np.ndarray = own["omega"][:count]
        """ω of the modes, rad/s, (modes,)."""
        self.h: np.ndarray = own["loads"][0, :count]
        """h: hᵀη̇ is `Measurement.beam_rate[0]`, kg^½, (modes,)."""
        self.g: np.ndarray = own["loads"][1, :count]
        """g: gᵀη̇ is `Measurement.beam_rate[1]`, m·kg^½, (modes,)."""
        self.strain: np.ndarray = own["strain"][:gauges, :count]
        """Strain at each gauge by modal coordinates, 1/(m·kg^½), (gauges, modes)."""
        self.gauge_places: np.ndarray = own["gauge_places"][:gauges]
        """Places s of the strain gauges, from the beam's middle, m, (gauges,)."""
        self.pose_noise: np.ndarray = own["pose_noise"]
        """Standard deviation of the measured pose, m, m, rad, (3,)."""
        self.rate_noise: np.ndarray = own["rate_noise"]
        """Standard deviation of the measured pose rate, m/s, m/s, rad/s, (3,)."""
        self.strain_noise: float = float(own["strain_noise"])
        """Standard deviation of each gauge's reading, 1."""
        self.moment_rate_noise: np.ndarray = own["moment_rate_noise"]
        """Standard deviation of hᵀq̇ and gᵀq̇, besides what the gauges' noise adds, kg·m/s, kg·m²/s, (2,)."""
        self.wanted_force: float = float(own["wanted_force"])
        """F_d, N; see `Measurement.wanted_force`."""

    @cached_property
    def modes(self) -> Modes:
        """Frequencies and shapes of the modes."""
        places = np.linspace(-0.5, 0.5, PLACES) * float(self._told["length"])
        return Modes(self.omega / (2 * np.pi), places, self._told["shapes"][:, : self.mode_count])

    def lowest(self, modes: int) -> "Believed":
        """This plant with its lowest `modes` alone."""
        if modes not in self._known:
            self._known[modes] = Believed(self._told.tobytes(), modes)
        return self._known[modes]

    @cached_property
    def state_matrix(self) -> np.ndarray:
        """A of d(p, ṗ)/dt = A (p, ṗ) + B f, (2 n, 2 n)."""
        n = len(self.mass)
        return np.block(
            [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(self.mass, np.hstack([self.stiffness, self.damping]))]]
        )

    @cached_property
    def input_matrix(self) -> np.ndarray:
        """B, (2 n, n)."""
        return np.vstack([np.zeros_like(self.mass), np.linalg.inv(self.mass)])

    def held(self, period: float, inputs: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Φ and Γ of z(t + period) = Φ z + Γ u, for dz/dt = A z + inputs u with u held; `inputs`: B unless given, (2 n, any)."""
        from flexlab.numerics.matrix_functions import exponential  # Slow to load: only for laws that need it.

        B = self.input_matrix if inputs is None else real_numbers(inputs)
        n, count = B.shape
        whole = np.zeros((n + count, n + count))
        whole[:n, :n], whole[:n, n:] = self.state_matrix, B
        over = exponential(period * whole)
        return over[:n, :n], over[:n, n:]


class Measurement:
    """What the controller measures and believes at a control instant; SI units; arms in the order left, right.

    Measured, with the scenario's sensor noise: `pose`, `pose_rate`, `beam_rate`, `strains`, and what follows from the pose:
    `jacobians`, `joint_angles`, `joint_rates`, and the arms' matrices. Known: time, `torques`, `delay` and the desired motion.
    Believed, from the scenario's `controller.model`: the payload's numbers, `believed`, `modes` and `internal_force`.
    """

    def __init__(self, now: Any, period: float, believed: Callable[[], Believed]):
        self._now, self._believe = now, believed
        arms = int(now["arm_count"])
        self.arm_count: int = arms
        """Number of arms: 2, or 1."""
        self.time: float = float(now["time"])
        """t, s."""
        self.period: float = period
        """T_c between control instants, s."""
        self.pose: np.ndarray = now["x"]
        """x = (x, y, θ) of the beam's middle, m, m, rad, (3,)."""
        self.pose_rate: np.ndarray = now["v"]
        """ẋ, m/s, m/s, rad/s, (3,)."""
        self.beam_rate: np.ndarray = now["beam_rate"]
        """hᵀq̇ and gᵀq̇: momentum and angular momentum of the vibration, kg·m/s, kg·m²/s, (2,)."""
        self.desired_pose: np.ndarray = now["desired"][0]
        """x_d, m, m, rad, (3,)."""
        self.desired_rate: np.ndarray = now["desired"][1]
        """ẋ_d, (3,)."""
        self.desired_acceleration: np.ndarray = now["desired"][2]
        """ẍ_d, (3,)."""
        self.inertias: np.ndarray = now["M"][:arms]
        """M̄_i of the arms in the payload's coordinates, kg, kg·m, kg·m², (arms, 3, 3)."""
        self.coriolis: np.ndarray = now["C"][:arms]
        """C̄_i, (arms, 3, 3)."""
        self.arm_weights: np.ndarray = now["G"][:arms]
        """Ḡ_i: inputs that hold the arms' own weight, N, N, N·m, (arms, 3)."""
        self.share: np.ndarray = now["share"][:arms]
        """Share of each arm in the common part, 1, (arms,)."""
        self.payload_mass: float = float(now["m"])
        """Mass of the payload, believed, kg."""
        self.payload_inertia: float = float(now["I"])
        """Inertia of the payload about its middle, believed, kg·m²."""
        self.gravity: float = float(now["gravity"])
        """Gravity along -y, m/s²."""

        self.strains: np.ndarray = now["strain"][: int(now["gauge_count"])]
        """-½ t w''(s_j) at the gauges, measured, 1, (gauges,); their places: `gauge_places`."""
        self.delay: int = int(now["delay"])
        """d, control periods until the inputs asked for now begin to act."""
        self.torques: np.ndarray = now["torque"][: self.delay + 1, :arms]
        """Joint torques, N·m, (d + 1, arms, 3): [0] those held until now, then those on their way, next one first."""
        self.coming: np.ndarray = now["coming"]
        """x_d, ẋ_d, ẍ_d when the inputs asked for now begin to act, (3, 3)."""

    @cached_property
    def believed(self) -> Believed:
        """The linear plant of arms and lowest modes, and the sensors' noise; the same object while it does not change."""
        return self._believe()

    @property
    def gauge_places(self) -> np.ndarray:
        """Places s of the strain gauges, from the beam's middle, believed, m, (gauges,)."""
        return self.believed.gauge_places

    @property
    def modes(self) -> Modes:
        """Frequencies and shapes of the beam's lowest modes, believed."""
        return self.believed.modes

    @property
    def wanted_force(self) -> float:
        """F_d, N, squeeze positive: the engine adds F_d (cos θ, sin θ, 0) to the left input, its opposite to the right one."""
        return self.believed.wanted_force

    @cached_property
    def payload_matrix(self) -> np.ndarray:
        """Ā = A11 - A12 A22⁻¹ A21, the payload's inertia where the beam may bend, believed, at the measured pose, (3, 3)."""
        c, s = self._now["trig"]
        hh, hg, gg = self._now["kappa"]
        bent = [[s * s * hh, -s * c * hh, -s * hg], [-s * c * hh, c * c * hh, c * hg], [-s * hg, c * hg, gg]]
        return np.diag([self.payload_mass, self.payload_mass, self.payload_inertia]) - bent

    @property
    def grip_forces(self) -> np.ndarray:
        """Forces of the arms on the payload, believed, N, N, N·m, (arms, 3).

        No sensor measures them: they are the torques in force less what moves and holds the arms, if the pose accelerates as
        desired.
        """
        used = self.inertias @ self.desired_acceleration + self.coriolis @ self.pose_rate + self.arm_weights
        return self.from_torques(self.torques[0]) - used

    @property
    def internal_force(self) -> float:
        """Squeeze along the beam, N, believed: half of the left grip's push less the right one's; 0 for one arm."""
        if self.arm_count == 1:
            return 0.0  # Nothing presses against it.
        push = self.grip_forces[0, :2] - self.grip_forces[1, :2]
        return 0.5 * float(push @ self._now["trig"])

    @cached_property
    def jacobians(self) -> np.ndarray:
        """𝒥 of each arm: joint rates from the pose rate, rad/m and 1, (arms, 3, 3), relative joints from the base on."""
        rows = np.zeros((self.arm_count, 3, 3))
        first, second = self._now["J"][: self.arm_count, 0], self._now["J"][: self.arm_count, 1]
        rows[:, 0], rows[:, 1], rows[:, 2] = first, second - first, -second
        rows[:, 2, 2] += 1.0
        return rows

    @property
    def joint_rates(self) -> np.ndarray:
        """θ̇ of the relative joints, rad/s, (arms, 3)."""
        return self.jacobians @ self.pose_rate

    @cached_property
    def joint_angles(self) -> np.ndarray:
        """θ of the relative joints, base first, rad in -π to π, (arms, 3)."""
        c1, s1, c2, s2 = self._now["direction"][: self.arm_count].T
        first, second = np.arctan2(s1, c1), np.arctan2(s2, c2)
        # The last link points along the beam; the right arm's against it.
        last = self.pose[2] + np.where(np.arange(self.arm_count) == 0, 0.0, np.pi)
        angles = np.stack([first, second - first, last - second], axis=1)
        return (angles + np.pi) % (2 * np.pi) - np.pi

    @property
    def weights(self) -> np.ndarray:
        """Inputs that hold the arms' weight and their shares of the payload's, N, N, N·m, (arms, 3)."""
        held = self.arm_weights.copy()
        held[:, 1] += self.share * self.payload_mass * self.gravity
        return held

    def shared(self, common: Any) -> np.ndarray:
        """A common input (3,), N, N, N·m, divided between the arms by their shares, (arms, 3)."""
        return self.share[:, None] * real_numbers(common)

    def inputs_for(self, acceleration: Any) -> np.ndarray:
        """The inputs (arms, 3) that give a rigid payload an acceleration (3,), m/s², m/s², rad/s²: inverse dynamics."""
        a = real_numbers(acceleration)
        payload = np.array([self.payload_mass, self.payload_mass, self.payload_inertia])
        return self.inertias @ a + self.coriolis @ self.pose_rate + self.weights + self.shared(payload * a)

    def net_force(self, inputs: Any) -> np.ndarray:
        """Net force of inputs (arms, 3) on the pose, less the arms' velocity terms and all weight, N, N, N·m, (3,)."""
        force = (real_numbers(inputs) - self.coriolis @ self.pose_rate - self.arm_weights).sum(axis=0)
        force[1] -= self.payload_mass * self.gravity
        return force

    def from_torques(self, torques: Any) -> np.ndarray:
        """The inputs u_i = 𝒥_iᵀτ_i, (arms, 3), of joint torques (arms, 3), N·m."""
        return np.einsum("ija,ij->ia", self.jacobians, real_numbers(torques).reshape(self.arm_count, 3))
