"""B6: a path whose frequency goes through the beam's first mode."""

from math import pi, sqrt

from flexlab.analysis.leaderboard.case import Case, Variant
from flexlab.analysis.leaderboard.score import largest_vibration, peak_torque, rms_error
from flexlab.presets import load_preset

RATIOS = (0.25, 0.5, 0.8, 0.9, 1.0, 1.1, 1.25, 2.0)
"""Path frequency over f1."""
ACCELERATION = 2.0
"""m/s², the path's peak across the beam: the same at all frequencies, so that the beam's load is."""

STIFFNESS = 10.0
"""N·m²: twice the first mode is still a path that arms can be asked for."""

_payload = load_preset("paper").payload
FIRST_MODE = pi / (2 * _payload.length**2) * sqrt(STIFFNESS / _payload.linear_density)
"""f1 of the beam on two pins that stand still, Hz."""


def _path(ratio: float) -> dict[str, object]:
    frequency = ratio * FIRST_MODE
    amplitude = ACCELERATION / (2 * pi * frequency) ** 2
    return {"trajectory.frequency": (frequency,) * 3, "trajectory.amplitude": (0.0, amplitude, 0.0)}


CASE = Case(
    "B6",
    "Through the resonance",
    f"A soft beam (EI = {STIFFNESS:g} N·m²) on a sine across it with {ACCELERATION:g} m/s² of peak acceleration, at frequencies "
    f"about its first mode of {FIRST_MODE:.1f} Hz. It starts in step with the path and smoothly; the last second counts.",
    3.0,
    (largest_vibration((2.0, 3.0)), rms_error((2.0, 3.0)), peak_torque((2.0, 3.0))),
    {"payload.bending_stiffness": STIFFNESS, "initial.pose_rate": None, "trajectory.smooth_start": 0.5},
    tuple(Variant(f"{ratio:g} f1", _path(ratio)) for ratio in RATIOS),
)
