"""What sample rows say of forces and torques, in one pass over them: a run is watched by it, tick by tick."""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import compiled
from flexlab.sim.signals import ARMS, INTERNAL, MOVING, PER_ARM, TORQUE

JUMP, LEAST_JUMP = 1.5, 0.05
"""A tick in which a torque changes by more than the first times what it did in any tick that was looked at, and by more than
the second times the largest torque, excites fast modes anew: a sampled law, or a path with a kink."""


class Survey(NamedTuple):
    """Of a run so far."""

    peak: float
    """Largest internal force, N or N·m; of one arm alone, which has none, the moving force."""
    strongest: float
    """Largest torque, N·m."""
    change: float
    """Largest change of a torque from the sample before, N·m, of the rows surveyed last."""
    torque: np.ndarray | None
    """Joint torques of the newest sample, N·m, (3 arms,); None: of none yet."""
    jump: int
    """Index of the first of the rows surveyed last with a `JUMP`; -1: there is none."""


NOTHING_SURVEYED = Survey(0.0, 0.0, 0.0, None, -1)


def survey_more(before: Survey, arm_count: int, rows: np.ndarray, looked_at: float) -> Survey:
    """The survey after `rows` (N ≥ 1, row length); `looked_at`: largest change of a torque in ticks looked at so far, N·m."""
    torque = np.empty(3 * arm_count)
    if before.torque is not None:
        torque[:] = before.torque
    peak, strongest, change, jump = _survey(
        rows, arm_count, before.torque is not None, torque, before.peak, before.strongest, looked_at
    )
    return Survey(peak, strongest, change, torque, jump)


@compiled
def _survey(rows, arm_count, follows, torque, peak, strongest, looked_at):
    """(peak, strongest, change, jump) of a `Survey`; `torque`, those of the sample before if it `follows` one, becomes the newest."""
    largest, jump = 0.0, -1
    for k in range(len(rows)):
        row, change = rows[k], 0.0
        for i in range(arm_count):
            first = ARMS + PER_ARM * i
            for joint in range(3):
                now = row[first + TORQUE + joint]
                if follows:
                    change = max(change, abs(now - torque[3 * i + joint]))
                torque[3 * i + joint] = now
                strongest = max(strongest, abs(now))
                force = row[first + INTERNAL + joint] if arm_count > 1 else row[MOVING + joint]
                peak = max(peak, abs(force))
        follows = True
        largest = max(largest, change)
        if jump < 0 and change > JUMP * looked_at and change > LEAST_JUMP * strongest:
            jump = k
    return peak, strongest, largest, jump
