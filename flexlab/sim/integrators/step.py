"""One step of the chosen integrator."""

from flexlab.compiled import inlined
from flexlab.sim.integrators.etdrk4 import etdrk4_step
from flexlab.sim.integrators.generalized_alpha import generalized_alpha_step
from flexlab.sim.integrators.rk4 import rk4_step
from flexlab.sim.integrators.scheme import ETDRK4, GENERALIZED_ALPHA


@inlined
def integrate(system, scheme, t, dt, y, ws):
    """Advance y by dt in place, after its rates are in ws.stage[0]; returns a fault code."""
    if scheme.kind == ETDRK4:
        return etdrk4_step(system, scheme.operators, t, dt, y, ws)
    if scheme.kind == GENERALIZED_ALPHA:
        return generalized_alpha_step(system, scheme, t, dt, y, ws)
    return rk4_step(system, t, dt, y, ws)
