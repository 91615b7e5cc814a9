"""What a law in Python knows of plant and sensors besides what it measures: a block of numbers that goes with each call."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexlab.physics.law_input import MOST_GAUGES

MOST_MODES, PLACES = 8, 17
"""Modes, and even places on the beam at which shapes are told."""
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
"""`counts`: of modes and of gauges; arrays are filled from their first places. `loads`: h and g."""
BELIEVED_SIZE = BELIEVED.itemsize // 8


class Modes(NamedTuple):
    """The beam's lowest modes, undamped, with held ends, as the controller believes."""

    frequencies: np.ndarray
    """Hz, (modes,)."""
    places: np.ndarray
    """s on the beam from its middle, m, (17,)."""
    shapes: np.ndarray
    """Deflection at `places` by modal coordinates η, 1/kg^½, (17, modes)."""


class Believed:
    """The linear plant that the controller believes in, with its lowest modes, and its sensors' noise; nothing is measured.

    M p̈ + D ṗ + K p = f over p = (x, η), pose and modal coordinates, for a straight beam at rest at the path's centre, with f the
    forces on them; n = 3 + modes. Weight and what turns with the pose are left out. Arrays are shared: read only.
    """

    def __init__(self, block: np.ndarray, modes: int | None = None):
        """`block`: (BELIEVED_SIZE,); `modes`: as many, if there are so many."""
        block = block.copy()
        block.flags.writeable = False
        own = self._block = block.view(BELIEVED)[0]
        self._known: dict[int, Believed] = {}
        most, gauges = own["counts"].astype(int).tolist()
        count = most if modes is None else min(modes, most)
        self.mode_count: int = count
        """Modes that are told: 8, or all that the beam has."""
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
        """s of the strain gauges from the beam's middle, m, (gauges,)."""
        self.pose_noise: np.ndarray = own["pose_noise"]
        """Standard deviation of the measured pose, m, m, rad, (3,)."""
        self.rate_noise: np.ndarray = own["rate_noise"]
        """Of the measured pose rate, m/s, m/s, rad/s, (3,)."""
        self.strain_noise: float = float(own["strain_noise"])
        """Of each gauge's reading, 1."""
        self.moment_rate_noise: np.ndarray = own["moment_rate_noise"]
        """Of hᵀq̇ and gᵀq̇, besides what the gauges' noise adds, kg·m/s, kg·m²/s, (2,)."""
        self.wanted_force: float = float(own["wanted_force"])
        """F_d, N; see `Measurement.wanted_force`."""

    @cached_property
    def modes(self) -> Modes:
        """Their frequencies and shapes."""
        places = np.linspace(-0.5, 0.5, PLACES) * float(self._block["length"])
        return Modes(self.omega / (2 * np.pi), places, self._block["shapes"][:, : self.mode_count])

    def lowest(self, modes: int) -> "Believed":
        """The same plant with its lowest modes alone."""
        if modes not in self._known:
            self._known[modes] = Believed(np.frombuffer(self._block.tobytes()), modes)
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
        """Φ and Γ over `period` s in which u of dz/dt = A z + `inputs` u is held; `inputs`: B unless given, (2 n, any)."""
        from flexlab.numerics.matrix_functions import exponential  # It takes its time to load: laws that need it do.

        B = self.input_matrix if inputs is None else np.asarray(inputs, float)
        n, count = B.shape
        whole = np.zeros((n + count, n + count))
        whole[:n, :n], whole[:n, n:] = self.state_matrix, B
        over = exponential(period * whole)
        return over[:n, :n], over[:n, n:]
