"""Writing one sample: every signal that follows from a state."""

from flexlab.compiled import inlined
from flexlab.control.adaptive_sliding_mode import sliding_variable
from flexlab.physics.arm import joint_angles, joint_torques
from flexlab.physics.dynamics import acceleration
from flexlab.physics.energy import elastic_energy, gravity_energy, kinetic_energy
from flexlab.physics.internal_force import internal_forces
from flexlab.physics.plant import DISSIPATED, ETA, MEMORY, MID, WORK
from flexlab.sim import row_layout

ACCELERATION, DESIRED, ERROR, SLIDING = (
    row_layout.ACCELERATION,
    row_layout.DESIRED,
    row_layout.ERROR,
    row_layout.SLIDING,
)
POSE, RATE, ESTIMATES, MOVING = row_layout.POSE, row_layout.RATE, row_layout.ESTIMATES, row_layout.MOVING
TIME, MIDSPAN, QUASI_STATIC, SATURATED = (
    row_layout.TIME,
    row_layout.MIDSPAN,
    row_layout.QUASI_STATIC,
    row_layout.SATURATED,
)
KINETIC, ELASTIC, GRAVITY, POWER_IN, LOSS = (
    row_layout.KINETIC,
    row_layout.ELASTIC,
    row_layout.GRAVITY,
    row_layout.WORK,
    row_layout.DISSIPATION,
)
ARMS, PER_ARM = row_layout.ARMS, row_layout.PER_ARM

AT_LIMIT = 1e-9
"""Relative distance from its limit at which a torque counts as standing there: the rounding of turning τ into u and back."""


@inlined
def write_sample(system, t, y, beam_rate, ws, row):
    """Write the sample of state y at time t into `row`, after `rates` at the same instant; beam_rate (n_m,): η̇."""
    plant = system.plant
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    x_ddot = row[ACCELERATION : ACCELERATION + 3]
    acceleration(plant, y, beam_rate, ws.w_bar[0], ws.beam_rate[0], ws.u, ws, x_ddot)
    row[TIME] = t
    sliding_variable(system.control.adaptive.Lambda, y[0:3], ws.velocity, ws.desired, row[SLIDING : SLIDING + 3])
    for a in range(3):
        row[POSE + a], row[RATE + a] = y[a], ws.velocity[a]
        row[DESIRED + a], row[ERROR + a] = ws.desired[0, a], y[a] - ws.desired[0, a]
        row[ESTIMATES + a] = y[MEMORY + a]
    row[SATURATED] = 0.0
    force = row[ARMS : ARMS + PER_ARM * len(plant.arms)].reshape(len(plant.arms), 4, 3)
    internal_forces(ws.arm, ws.u, ws.hand, x_ddot, ws.velocity, force[:, 3], row[MOVING : MOVING + 3])
    for i in range(len(plant.arms)):
        joint_angles(y[2], plant.arms[i], ws.arm.direction[i], force[i, 0])
        joint_torques(plant.arms[i], c, s, ws.arm.direction[i], ws.u[i], force[i, 1])
        for a in range(3):
            force[i, 2, a] = ws.u[i, a]
            if abs(force[i, 1, a]) >= (1 - AT_LIMIT) * system.control.torque_limit[a]:
                row[SATURATED] = 1.0
    _observe_beam(plant, y, beam_rate, row)
    lateral = c * x_ddot[1] - s * x_ddot[0] + plant.gravity * c
    row[QUASI_STATIC] = plant.compliance[0] * lateral + plant.compliance[1] * x_ddot[2]
    row[KINETIC] = kinetic_energy(y, ws.velocity, ws.eta_dot)
    row[ELASTIC] = elastic_energy(plant, y)
    row[GRAVITY] = gravity_energy(plant, ws.arm, y, ws.w_bar[0])
    row[POWER_IN], row[LOSS] = y[WORK], y[DISSIPATED]


@inlined
def _observe_beam(plant, y, beam_rate, row):
    """Write q, q̇ and the mid-span deflection."""
    n_q, n = plant.V.shape
    first = ARMS + PER_ARM * len(plant.arms)
    for j in range(n_q):
        q = rate = 0.0
        for k in range(n):
            q += plant.V[j, k] * y[ETA + k]
            rate += plant.V[j, k] * beam_rate[k]
        row[first + j], row[first + n_q + j] = q, rate
    middle = 0.0
    for k in range(n):
        middle += plant.modal[MID, k] * y[ETA + k]
    row[MIDSPAN] = middle
