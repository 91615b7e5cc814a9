"""Energies of arms, payload and grips."""

from flexlab.compiled import inlined
from flexlab.physics.grips import own_trig
from flexlab.physics.plant import ETA, OMEGA2, P


@inlined
def kinetic_energy(y, velocity, eta_dot, factor):
    """T = ½(Pᵀẋ + s πᵀη̇), J, of arms and payload, after `find_velocities`; `factor`: s of `mass_change`, 1."""
    total = 0.0
    for a in range(3):
        total += y[P + a] * velocity[a]
    n = len(eta_dot)
    for k in range(n):
        total += factor * (y[ETA + n + k] * eta_dot[k])
    return total / 2


@inlined
def elastic_energy(plant, y):
    """½ηᵀΩ²η, J."""
    total = 0.0
    for k in range(plant.modal.shape[1]):
        total += plant.modal[OMEGA2, k] * y[ETA + k] * y[ETA + k]
    return total / 2


@inlined
def gravity_energy(plant, y, w_bar, factor, ws):
    """Potential energy of all weights, J, zero where y = 0; `factor`: s of `mass_change`, 1."""
    terms = ws.arm
    moment = factor * (plant.m * y[1] + terms.trig[0] * w_bar)
    for i in range(len(plant.arms)):
        arm = plant.arms[i]
        moment += arm.mass * arm.base_y + arm.gamma_1 * terms.direction[i, 1] + arm.gamma_2 * terms.direction[i, 3]
        _, sine = own_trig(plant.grips, ws, i)
        moment += arm.gamma_3 * arm.tip * sine
    return plant.gravity * moment


@inlined
def arms_kinetic_energy(ws):
    """½Σẋ_iᵀM̄_iẋ_i, J."""
    total = 0.0
    for i in range(len(ws.grips.velocity)):
        for a in range(3):
            for b in range(3):
                total += ws.grips.velocity[i, a] * ws.arm.M[i, a, b] * ws.grips.velocity[i, b]
    return total / 2


@inlined
def spring_energy(grips, ws):
    """½Σk δ², J."""
    total = 0.0
    for i in range(len(ws.grips.displacement)):
        for a in range(3):
            total += grips.stiffness[a] * (ws.grips.displacement[i, a] * ws.grips.displacement[i, a])
    return total / 2
