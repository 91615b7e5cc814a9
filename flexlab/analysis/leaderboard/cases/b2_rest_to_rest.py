"""B2: point to point, with beams of three stiffnesses."""

from flexlab.analysis.leaderboard.case import Case, Variant
from flexlab.analysis.leaderboard.score import peak_error, peak_torque, residual

STIFFNESSES = (100.0, 10.0, 1.27)
"""N·m²: first modes of 44, 14 and 5 Hz."""

CASE = Case(
    "B2",
    "From rest to rest",
    "0.2 m up in 0.5 s along a quintic, then it stands still: what rings afterwards is what the next move waits for.",
    1.5,
    (residual(), residual(later=False), peak_error(), peak_torque()),
    {"trajectory.kind": "rest-to-rest"},
    tuple(Variant(f"EI = {EI:g} N·m²", {"payload.bending_stiffness": EI}) for EI in STIFFNESSES),
)
