"""The standard cases, B1 to B8: from the paper's own experiment to ten minutes with noise, and to real joints and grips."""

from math import pi, sqrt

import numpy as np

from flexlab.analysis.leaderboard.case import (
    Case,
    Score,
    Variant,
    internal_force,
    largest_vibration,
    peak_error,
    peak_torque,
    residual,
    rms_error,
    settled,
)
from flexlab.analysis.lesson_measures import bound_terms
from flexlab.analysis.metrics import Column, Metric
from flexlab.analysis.metrics.run_metrics import Window
from flexlab.presets import load_preset
from flexlab.sim.commands import Tap
from flexlab.sim.samples import Samples

B1 = Case(
    "B1",
    "The paper's sine",
    "Section IV of the paper for 3 s: it begins at rest on a path that is already moving, so that the beam rings.",
    3.0,
    (settled(), peak_error(), rms_error((1.0, 3.0)), peak_torque(), internal_force()),
)
STIFFNESSES = (100.0, 10.0, 1.27)
"""Bending stiffnesses, N·m²; the first modes are at 44, 14 and 5 Hz."""

B2 = Case(
    "B2",
    "From rest to rest",
    "0.2 m up in 0.5 s along a quintic, then it stands still: the next move has to wait for what still rings.",
    1.5,
    (residual(), residual(later=False), peak_error(), peak_torque()),
    {"trajectory.kind": "rest-to-rest"},
    tuple(Variant(f"EI = {EI:g} N·m²", {"payload.bending_stiffness": EI}) for EI in STIFFNESSES),
)
AT = 0.1  # s
IMPULSE = 0.2
"""Impulse of a tap with a finger across the beam, N·s."""
QUIET = 0.2
"""Time after the tap from which the vibration counts, s."""

B3 = Case(
    "B3",
    "Impulse at mid-span",
    f"The pose is held; at t = {AT:g} s a tap of {IMPULSE:g} N·s hits the middle of the beam.",
    1.1,
    (largest_vibration((AT + QUIET, 1.1)), settled((AT, 1.1)), peak_error(), peak_torque()),
    {"trajectory.kind": "hold"},
    commands=((AT, Tap(0.0, (0.0, IMPULSE))),),
)
WRONG = (-0.5, -0.2, 0.2, 0.5)
BELIEVED = {"EI": "controller.model.stiffness_factor", "ρ": "controller.model.linear_density_factor"}

B4 = Case(
    "B4",
    "Wrong EI and ρ",
    "B1 with a controller whose EI or ρ is wrong by this much. The beam is always the paper's.",
    3.0,
    (rms_error((1.0, 3.0)), settled(), peak_error()),
    variants=tuple(
        Variant(f"{name} {wrong * 100:+.0f} %".replace("-", "−"), {path: 1 + wrong})
        for name, path in BELIEVED.items()
        for wrong in WRONG
    ),
)
PERIOD = 0.001  # s
POSE_NOISE = (2e-6, 2e-6, 5e-6)
"""Noise of the pose, m, m, rad, as from 20-bit encoders at the end of such arms."""
RATE_NOISE = tuple(sqrt(2) / PERIOD * noise for noise in POSE_NOISE)
"""Noise of the pose rate, m/s, m/s, rad/s, as from differences of two readings."""
STRAIN_NOISE = 1e-6
TORQUE_LIMIT = (300.0, 300.0, 100.0)
"""Torque limits, N·m: the paper's start asks for twice as much, its steady motion for less than half."""

HARDWARE = {
    "controller.control_period": PERIOD,
    "controller.input_delay": 1,
    "controller.torque_limit": TORQUE_LIMIT,
    "controller.sensor_noise.pose": POSE_NOISE,
    "controller.sensor_noise.pose_rate": RATE_NOISE,
    "controller.sensor_noise.strain": STRAIN_NOISE,
}

B5 = Case(
    "B5",
    "Clock, delay, limits, noise",
    "B1 at 1 kHz, torques one sample late and limited, with encoder and strain gauge noise: the paper's beam of two elements, "
    "and one of eight elements that hardly damps itself (ζ = 0.1 %).",
    3.0,
    (largest_vibration((2.0, 3.0)), settled(), rms_error((1.0, 3.0)), peak_error(), peak_torque((1.0, 3.0))),
    HARDWARE,
    (
        Variant("2 elements"),
        Variant(
            "8 elements, ζ = 0.1 %",
            {"payload.element_count": 8, "payload.damping.kind": "modal", "payload.damping.ratio": 0.001},
        ),
    ),
)


RATIOS = (0.25, 0.5, 0.8, 0.9, 1.0, 1.1, 1.25, 2.0)
"""Path frequency over f1."""
ACCELERATION = 2.0
"""Peak acceleration of the path across the beam, m/s²: the same at all frequencies, and so is the load on the beam."""
STIFFNESS = 10.0
"""Bending stiffness, N·m², with which arms can follow a path at twice the first mode's frequency."""
_payload = load_preset("paper").payload
FIRST_MODE = pi / (2 * _payload.length**2) * sqrt(STIFFNESS / _payload.linear_density)
"""f1 of the beam on two fixed pins, Hz."""


def _path(ratio: float) -> dict[str, object]:
    frequency = ratio * FIRST_MODE
    amplitude = ACCELERATION / (2 * pi * frequency) ** 2
    return {"trajectory.frequency": (frequency,) * 3, "trajectory.amplitude": (0.0, amplitude, 0.0)}


B6 = Case(
    "B6",
    "Through the resonance",
    f"A soft beam (EI = {STIFFNESS:g} N·m²) on a sine across it with {ACCELERATION:g} m/s² of peak acceleration, at frequencies "
    f"about its first mode of {FIRST_MODE:.1f} Hz. It starts in step with the path and smoothly; the last second counts.",
    3.0,
    (largest_vibration((2.0, 3.0)), rms_error((2.0, 3.0)), peak_torque((2.0, 3.0))),
    {"payload.bending_stiffness": STIFFNESS, "initial.pose_rate": None, "trajectory.smooth_start": 0.5},
    tuple(Variant(f"{ratio:g} f1", _path(ratio)) for ratio in RATIOS),
)
DURATION = 600.0  # s
SETTLED, END = 60.0, 540.0
"""Start of the window of the drift, and start of the last minute, s."""
LEAKAGE = 0.1
"""Leakage, 1/s, with which the estimates forget within ten seconds."""


class BoundDrift(Metric):
    """Slope of the straight line through the bound b̂ᵀ(1, ‖x‖, ‖ẋ‖²), N/s."""

    name, place = "bound_drift", 0
    columns = (Column("drift", "Drift of the learnt bound", "drift", "N/min", 60.0),)

    def __init__(self) -> None:
        self._sums = np.zeros(5)

    def update(self, samples: Samples) -> None:
        """Take in the next piece of a run."""
        bound = np.sum(samples.bound_estimates * bound_terms(samples.pose, samples.pose_rate), axis=1)
        t = samples.time
        self._sums += [len(t), t.sum(), bound.sum(), (t * t).sum(), (t * bound).sum()]

    def compute(self) -> tuple[float, ...]:
        """N/s."""
        count, t, bound, tt, t_bound = self._sums
        spread = count * tt - t * t
        return ((count * t_bound - t * bound) / spread if spread > 0 else np.nan,)


def drift(window: Window) -> Score:
    """The score of the bound estimate's growth."""
    formula = f"slope of b̂ᵀ(1, ‖x‖, ‖ẋ‖²) over t, least squares, t ≥ {window[0]:g} s"
    return Score(BoundDrift.columns[0], formula, BoundDrift, window=window)


LAST = (END, DURATION)
B7 = Case(
    "B7",
    "Ten minutes",
    f"B5's clock, delay, limits and noise for {DURATION:g} s; once more with the leakage σ = {LEAKAGE:g} 1/s for laws that learn "
    "the bound b̂. Ten minutes of each law take a processor about a minute: only with --long.",
    DURATION,
    (rms_error(LAST), drift((SETTLED, DURATION)), largest_vibration(LAST), peak_torque(LAST)),
    HARDWARE,
    (Variant("σ as it is"), Variant(f"σ = {LEAKAGE:g} 1/s", law_fields={"leakage": LEAKAGE})),
    long=True,
)
ENCODER = 2.0**20
"""Counts per turn of a joint: 20 bits."""
JOINTS = {
    "controller.control_period": 0.001,
    "joints.encoders.counts": (ENCODER,) * 3,
    "joints.motor.time_constant": 0.002,
    "joints.motor.stall_torque": (600.0, 400.0, 200.0),
    "joints.motor.no_load_speed": (10.0, 10.0, 10.0),
    "joints.friction.viscous": (5.0, 5.0, 2.0),
    "joints.friction.coulomb": (8.0, 6.0, 2.0),
    "joints.friction.static_factor": 1.5,
}
KNOWN = {"controller.model.friction_factor": 1.0}
FILLED = {"payload.mass_change.factor": 1.5, "payload.mass_change.begin": 0.5, "payload.mass_change.duration": 1.0}

B8 = Case(
    "B8",
    "Joints and grips of machines",
    "B1 at 1 kHz with friction in the joints, motors that lag by 2 ms and weaken with their speed, and encoders of 20 bits, "
    "whose differences give the rates. The controller knows nothing of the friction, or all; with all known, the grips also give "
    "way, or the payload is filled to 1.5 times its mass from 0.5 s to 1.5 s, of which the controller knows nothing, or all.",
    3.0,
    (
        rms_error((1.0, 3.0)),
        peak_error(),
        largest_vibration((2.0, 3.0)),
        internal_force((1.0, 3.0)),
        peak_torque((1.0, 3.0)),
    ),
    JOINTS,
    (
        Variant("friction unknown"),
        Variant("friction known", KNOWN),
        Variant("grips that give way", {**KNOWN, "grips.model": "compliant"}),
        Variant("payload that is filled", {**KNOWN, **FILLED}),
        Variant("payload that is filled, as is known", {**KNOWN, **FILLED, "controller.model.mass_change_factor": 1.0}),
    ),
)
