"""Computed torque: the rigid system's inverse dynamics with linear pose feedback."""

from flexlab.compiled import inlined
from flexlab.control.load_sharing import drive_arms


@inlined
def computed_torque(gains, payload, gravity, x, v, terms, desired, scratch, u):
    """u_i = (M̄_i + share Ā) a + C̄_i ẋ + Ḡ_i + share weight with a = ẍ_d - K_d ė - K_p e; gains: `FeedbackGains`."""
    acceleration, nothing, A = scratch[0], scratch[2], scratch[3:6]
    for a in range(3):
        nothing[a] = 0.0
        acceleration[a] = (
            desired[2, a] - gains.velocity[a] * (v[a] - desired[1, a]) - gains.position[a] * (x[a] - desired[0, a])
        )
    drive_arms(payload, gravity, terms, acceleration, v, nothing, A, u)
