"""The force of a hand's spring at the beam or at an arm's link (`plant.Hand`), as kernels."""

from flexlab.compiled import inlined
from flexlab.physics.grips import own_pose, own_trig
from flexlab.physics.plant import ETA, PULL, hand_of


@inlined
def beam_is_held(plant):
    """Whether a hand pulls at the beam itself."""
    hand = hand_of(plant.pull)
    return hand.stiffness != 0 and hand.arm < 0


@inlined
def pull_force(plant, y, c, s):
    """Force (x, y), N, of the spring at the beam, and the deflection w(s) of the pulled point, m."""
    n = plant.modal.shape[1]
    w = 0.0
    for k in range(n):
        w += plant.modal[PULL, k] * y[ETA + k]
    hand = hand_of(plant.pull)
    fx = hand.stiffness * (hand.target_x - (y[0] + hand.position * c - w * s))
    fy = hand.stiffness * (hand.target_y - (y[1] + hand.position * s + w * c))
    return fx, fy, w


@inlined
def pull_on_link(plant, y, ws, force):
    """Fill (∂R/∂x)ᵀF (3,), as an arm's input, of the spring's force F on a link's point R, after `arm_configuration`.

    R = base + Σ d_k (cos α_k, sin α_k) with d_k the links' lengths up to the point, so that (∂R/∂x)ᵀF = 𝒥ᵀ(d_k n_k·F).
    """
    hand, terms = hand_of(plant.pull), ws.arm
    held, link, at = int(hand.arm), int(hand.link), hand.position
    arm = plant.arms[held]
    if link == 2:
        reach = arm.reach + arm.tip * at
        c, s = own_trig(plant.grips, ws, held)
        at_x, at_y, _ = own_pose(plant.grips, y, ws, held)
        fx = hand.stiffness * (hand.target_x - (at_x + reach * c))
        fy = hand.stiffness * (hand.target_y - (at_y + reach * s))
        force[0], force[1], force[2] = fx, fy, reach * (c * fy - s * fx)
    else:
        c1, s1 = terms.direction[held, 0], terms.direction[held, 1]
        c2, s2 = terms.direction[held, 2], terms.direction[held, 3]
        d1, d2 = (at, 0.0) if link == 0 else (arm.l1, at)
        fx = hand.stiffness * (hand.target_x - (arm.base_x + d1 * c1 + d2 * c2))
        fy = hand.stiffness * (hand.target_y - (arm.base_y + d1 * s1 + d2 * s2))
        turn_1, turn_2 = d1 * (c1 * fy - s1 * fx), d2 * (c2 * fy - s2 * fx)
        for a in range(3):
            force[a] = terms.J[held, 0, a] * turn_1 + terms.J[held, 1, a] * turn_2


@inlined
def hand_load(plant, y, ws):
    """Force of a hand at the beam along e1 and e2, N, and moment about the middle, N·m; fills ws.hand for a hand on a link."""
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    f1 = f2 = pull_turn = 0.0
    for i in range(len(plant.arms)):
        for a in range(3):
            ws.hand[i, a] = 0.0
    hand = hand_of(plant.pull)
    if hand.stiffness != 0 and hand.arm >= 0:
        pull_on_link(plant, y, ws, ws.hand[int(hand.arm)])
    elif hand.stiffness != 0:
        fx, fy, deflection = pull_force(plant, y, c, s)
        f1, f2 = c * fx + s * fy, c * fy - s * fx
        pull_turn = hand.position * f2 - deflection * f1
    return f1, f2, pull_turn
