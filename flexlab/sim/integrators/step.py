"""One stage of a step of the chosen integrator: it turns the rates at its state into the next stage's state, or into the new y.

The loop of `advance` finds the rates of all stages in one place: they are most of the machine code. Here, each integrator has
an `if` of its own, as only branches of what is None are not compiled.
"""

from flexlab.compiled import inlined
from flexlab.sim.integrators import generalized_alpha as alpha
from flexlab.sim.integrators.etdrk4 import etdrk4_stage
from flexlab.sim.integrators.generalized_alpha import generalized_alpha_stage
from flexlab.sim.integrators.rk4 import rk4_stage

CLASSICAL_STAGES, ALPHA_STAGES = 4, alpha.CORRECTIONS + 1
ALPHA_PART = 1 - alpha.ALPHA_F


@inlined
def stage_count(generalized_alpha):
    """Evaluations of the rates per step."""
    return CLASSICAL_STAGES if generalized_alpha is None else ALPHA_STAGES


@inlined
def stage_instant(generalized_alpha, stage, t, dt, inside):
    """The instant of a stage of the step from t, s; the ends of the step are taken `inside` s inside it."""
    if stage == 0:
        return t + inside
    if generalized_alpha is not None:
        return t + ALPHA_PART * dt
    return t + (dt - inside if stage == 3 else dt / 2)


@inlined
def rates_row(etdrk4, stage):
    """Row of `Workspace.stage` that takes the rates of a stage."""
    return min(stage, 1) if etdrk4 is None else stage


@inlined
def take_stage(system, etdrk4, generalized_alpha, rk4, stage, dt, y, ws):
    """Go on from the rates of a stage, which stand in their row: to the next state, or after the last to y.

    Returns a fault code.
    """
    code = 0
    if etdrk4 is not None:
        etdrk4_stage(system, etdrk4, stage, dt, y, ws)
    if generalized_alpha is not None:
        code = generalized_alpha_stage(system, generalized_alpha, stage, dt, y, ws)
    if rk4 is not None:
        rk4_stage(system, stage, dt, y, ws)
    return code
