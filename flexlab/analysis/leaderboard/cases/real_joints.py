"""Case B8: joints as machines have them, with friction, late motors and encoders that count."""

from flexlab.analysis.leaderboard.case import (
    Case,
    Variant,
    internal_force,
    largest_vibration,
    peak_error,
    peak_torque,
    rms_error,
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

B8 = Case(
    "B8",
    "Joints of machines",
    "B1 at 1 kHz with friction in the joints, motors that are late by 2 ms and weaken with their speed, and encoders of 20 bits, "
    "from which rates are differences: once the controller knows nothing of friction, once all.",
    3.0,
    (
        rms_error((1.0, 3.0)),
        peak_error(),
        largest_vibration((2.0, 3.0)),
        internal_force((1.0, 3.0)),
        peak_torque((1.0, 3.0)),
    ),
    JOINTS,
    (Variant("friction unknown"), Variant("friction known", {"controller.model.friction_factor": 1.0})),
)
