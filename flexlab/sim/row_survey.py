"""What sample rows say of forces and torques, in one pass over them: a run is watched by it, tick by tick."""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import compiled
from flexlab.sim.signals import ARMS, INTERNAL, LOAD_SHARE, MOVING, PER_ARM, SPIN_SHARE, TORQUE

JUMP, LEAST_JUMP = 1.5, 0.05
"""A tick in which a torque changes by more than the first times what it did in any tick that was looked at, and by more than
the second times the largest torque, excites fast modes anew: a sampled law, or a path with a kink."""


class Survey(NamedTuple):
    """Of a run so far."""

    peak: float = 0.0
    """Largest internal force, N or N·m; of one arm alone, which has none, the moving force."""
    strongest: float = 0.0
    """Largest torque, N·m."""
    torque: np.ndarray | None = None
    """Joint torques of the newest sample, N·m, (3 arms,); None: of none yet."""
    load_share: float = 0.0
    """Largest compression of the beam beside its buckling load, 1."""
    spin_share: float = 0.0
    """Most that the spin took of the linear beam's stiffness, 1."""


def survey_rows(before: Survey, arm_count: int, rows: np.ndarray, looked_at: float) -> tuple[Survey, float, int]:
    """The survey after `rows` (N ≥ 1, row length), the largest change of a torque in one of them, N·m, and the first `JUMP`.

    `looked_at`: the largest change in ticks looked at so far, N·m. The jump is the index of its row; -1: there is none.
    """
    torque = np.empty(3 * arm_count)
    if before.torque is not None:
        torque[:] = before.torque
    peak, strongest, change, jump = _survey(
        rows, arm_count, before.torque is not None, torque, before.peak, before.strongest, looked_at
    )
    pressed, spun = rows[:, LOAD_SHARE].max(), rows[:, SPIN_SHARE].max()
    return (
        Survey(peak, strongest, torque, max(before.load_share, float(pressed)), max(before.spin_share, float(spun))),
        change,
        jump,
    )


@compiled
def _survey(rows, arm_count, follows, torque, peak, strongest, looked_at):
    """(peak, strongest, change, jump); `torque`, that of the sample before if it `follows` one, becomes the newest."""
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
