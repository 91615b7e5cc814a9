"""B3: a tap on the middle of the beam."""

from flexlab.analysis.leaderboard.case import Case
from flexlab.analysis.leaderboard.score import largest_vibration, peak_error, peak_torque, settled
from flexlab.sim.commands import Tap

AT = 0.1
"""s."""
IMPULSE = 0.2
"""N·s across the beam: a tap with a finger."""
QUIET = 0.2
"""s after the tap from which on it counts what still rings."""

CASE = Case(
    "B3",
    "Impulse at mid-span",
    f"The pose is held; at t = {AT:g} s a tap of {IMPULSE:g} N·s hits the middle of the beam.",
    1.1,
    (largest_vibration((AT + QUIET, 1.1)), settled((AT, 1.1)), peak_error(), peak_torque()),
    {"trajectory.kind": "hold"},
    commands=((AT, Tap(0.0, (0.0, IMPULSE))),),
)
