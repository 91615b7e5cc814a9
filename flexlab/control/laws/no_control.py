"""Motors off."""

from typing import Literal

from flexlab.compiled import pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import Law


class NoControl(Controller):
    """Motors without torque: the arms swing freely."""

    kind: Literal["none"] = "none"


@pluggable
def no_control(gains, now, memory, memory_rate, signals):
    """u_i = 0."""
    for i in range(now.arm_count):
        for a in range(3):
            now.u[i, a] = 0.0


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """0, as there is no feedback."""
    return 0.0


LAW = Law(NoControl, no_control, fastest_rate, drives=False, place=90)
