"""Feed-forward of the beam's quasi-static bending, for every law.

With q̈ from the beam's own equation the pose feels (A11 - A12A22⁻¹A21)ẍ - A12A22⁻¹(K_F q + Dq̇) = u. The laws drive the first
term; the second is the force of the bent beam. Bent as the desired motion bends it at rest, K_F q = -A21 ẍ_d, it is
A12A22⁻¹A21 ẍ_d at q = 0: most of what a pinned beam's mass asks for laterally, and what otherwise the feedback must find.
(The weight that bends the beam cancels: the grips carry all of it.)
"""

from flexlab.compiled import inlined


@inlined
def feed_forward_bending(share, payload, now):
    """Add `share` of A12A22⁻¹A21 ẍ_d to now.u, shared as the law shares the common part; `payload`: `BelievedPayload`.

    In the beam's frame: κ (a_lat, α), a_lat = e2·ẍ_d along e2, α = θ̈_d.
    """
    c, s = now.trig[0], now.trig[1]
    lateral, turn = c * now.desired[2, 1] - s * now.desired[2, 0], now.desired[2, 2]
    force = share * (payload.kappa[0] * lateral + payload.kappa[1] * turn)
    moment = share * (payload.kappa[1] * lateral + payload.kappa[2] * turn)
    for i in range(now.arm_count):
        now.u[i, 0] -= now.share[i] * s * force
        now.u[i, 1] += now.share[i] * c * force
        now.u[i, 2] += now.share[i] * moment
