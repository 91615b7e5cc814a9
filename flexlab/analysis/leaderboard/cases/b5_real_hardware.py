"""B5: a clock, a delay, motors with limits, noisy encoders and gauges."""

from math import sqrt

from flexlab.analysis.leaderboard.case import Case, Variant
from flexlab.analysis.leaderboard.score import largest_vibration, peak_error, peak_torque, rms_error, settled

PERIOD = 0.001
"""s."""
POSE_NOISE = (2e-6, 2e-6, 5e-6)
"""m, m, rad: encoders of 20 bits at the end of arms of this length."""
RATE_NOISE = tuple(sqrt(2) / PERIOD * noise for noise in POSE_NOISE)
"""m/s, m/s, rad/s: rates are differences of two readings."""
STRAIN_NOISE = 1e-6
TORQUE_LIMIT = (300.0, 300.0, 100.0)
"""N·m: the paper's start asks for twice as much, its steady motion for less than half."""

HARDWARE = {
    "controller.control_period": PERIOD,
    "controller.input_delay": 1,
    "controller.torque_limit": TORQUE_LIMIT,
    "controller.sensor_noise.pose": POSE_NOISE,
    "controller.sensor_noise.pose_rate": RATE_NOISE,
    "controller.sensor_noise.strain": STRAIN_NOISE,
}

CASE = Case(
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
