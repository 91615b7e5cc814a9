"""B1: the paper's own experiment."""

from flexlab.analysis.leaderboard.case import Case
from flexlab.analysis.leaderboard.score import internal_force, peak_error, peak_torque, rms_error, settled

CASE = Case(
    "B1",
    "The paper's sine",
    "Section IV of the paper for 3 s: it begins at rest on a path that is already moving, so that the beam rings.",
    3.0,
    (settled(), peak_error(), rms_error((1.0, 3.0)), peak_torque(), internal_force()),
)
