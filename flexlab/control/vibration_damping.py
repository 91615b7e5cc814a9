"""The paper's law with active damping of the beam, which the paper leaves as future work.

The beam sees the arms only through the lateral and angular acceleration of the virtual link. Accelerating the link by
a_lat = k_v hᵀq̇ along e2 and α = k_θ gᵀq̇ takes energy out of every mode that this motion can reach.
"""

from flexlab.compiled import inlined


@inlined
def add_vibration_damping(gains, terms, beam_rate, u):
    """u += (ΣM̄_i)[a_lat e2; α] in equal shares; gains: k_v, k_θ (2,); beam_rate: hᵀq̇, gᵀq̇ (2,)."""
    share = 1.0 / len(u)
    lateral, turn = gains[0] * beam_rate[0], gains[1] * beam_rate[1]
    ax, ay = -terms.trig[1] * lateral, terms.trig[0] * lateral
    for a in range(3):
        total = 0.0
        for i in range(len(u)):
            total += terms.M[i, a, 0] * ax + terms.M[i, a, 1] * ay + terms.M[i, a, 2] * turn
        for i in range(len(u)):
            u[i, a] += share * total
