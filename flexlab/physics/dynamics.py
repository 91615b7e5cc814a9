"""The equations of motion of arms and payload, as kernels over a `plant.Plant` and its state y (Eqs. (8) to (16)).

The module docstring of `physics.plant` defines the state and the equations.
"""

from flexlab.compiled import compiled, disjoint, inlined
from flexlab.numerics.elementary import sin_cos
from flexlab.numerics.linear_algebra import solve_symmetric
from flexlab.physics.arm import arm_configuration
from flexlab.physics.grips import add_grip_loads, begin_powers, carried_arms, move_arms, place_each, pull_arm
from flexlab.physics.hand import hand_load, pull_force, pull_on_link
from flexlab.physics.mass_change import FACTOR, RATE, mass_factor
from flexlab.physics.plant import (
    AXIAL_WORK,
    DG,
    DH,
    DISSIPATED,
    ETA,
    OMEGA2,
    PULL,
    WORK,
    G,
    H,
    P,
    X,
    grips_start,
    hand_of,
    material_start,
)


@disjoint
def block_product(block_start, matrix, z, product):
    """product = matrix z (n_m,) for a symmetric matrix, block by block."""
    for k in range(len(z)):
        product[k] = 0.0
    for block in range(len(block_start) - 1):
        low, high = block_start[block], block_start[block + 1]
        own = product[low:high]
        for j in range(low, high):
            zj, column = z[j], matrix[j, low:high]
            for i in range(high - low):
                own[i] += zj * column[i]


@inlined
def configure_arms(plant, pose, terms, fault):
    """Fill cos θ, sin θ and 𝒥, M̄, Ḡ of every arm at a pose (3,); returns `arm.OK` or the fault of arm fault[0]."""
    s, c = sin_cos(pose[2])
    terms.trig[0], terms.trig[1] = c, s
    for i in range(len(plant.arms)):
        code = arm_configuration(
            plant.arms[i], pose[0], pose[1], c, s, plant.gravity, terms.M[i], terms.G[i], terms.J[i], terms.direction[i]
        )
        if code != 0:
            fault[0] = i
            return code
    return 0


@compiled
def arms_at(plant, pose, ws):
    """`configure_arms` in ws.arm, for Python."""
    return configure_arms(plant, pose, ws.arm, ws.fault)


@inlined
def place_arms(grips, plant, y, ws):
    """`configure_arms` at the pose of y; with compliant grips each arm at its own pose."""
    if grips is None:
        return configure_arms(plant, y[X : X + 3], ws.arm, ws.fault)
    return place_each(grips, plant.arms, plant.gravity, y[X : X + 3], y[grips_start(plant) :], 0.0, ws)


@inlined
def rigid_inertia(plant, factor, terms, arm_count, c, s, w_bar, eta_norm2, S):
    """S = ΣM̄_i + A11 - A12 A21 (3, 3) (Eq. (19)), the inertia that the pose feels with the beam's momenta held.

    `factor`: the payload's mass over its mass at the start, 1; `arm_count`: number of arms that move with it.
    """
    hh, hg, gg = plant.kappa[0], plant.kappa[1], plant.kappa[2]
    # Sums stay in registers: through memory, each arm would wait for the one before.
    xx, yy, tt = plant.m - s * s * hh, plant.m - c * c * hh, plant.I + eta_norm2 - gg
    xy = s * c * hh
    xt, yt = -c * w_bar + s * hg, -s * w_bar - c * hg
    xx, xy, yy, xt, yt, tt = factor * xx, factor * xy, factor * yy, factor * xt, factor * yt, factor * tt
    for i in range(arm_count):
        M = terms.M[i]
        xx, xy, yy = xx + M[0, 0], xy + M[1, 0], yy + M[1, 1]
        xt, yt, tt = xt + M[2, 0], yt + M[2, 1], tt + M[2, 2]
    S[0, 0], S[0, 1], S[0, 2] = xx, xy, xt
    S[1, 0], S[1, 1], S[1, 2] = xy, yy, yt
    S[2, 0], S[2, 1], S[2, 2] = xt, yt, tt


@inlined
def find_velocities(plant, y, ws):
    """Configure the arms and turn momenta into ẋ and η̇ (ws.velocity, ws.eta_dot); returns a fault code and h·η, h·η̇.

    Leaves the Schur complement in ws.S. Call it after `find_mass` if the payload's mass changes.
    """
    n, factor = plant.modal.shape[1], mass_factor(plant.mass_change, ws)
    code = place_arms(plant.grips, plant, y, ws)
    if code != 0:
        return code, 0.0, 0.0
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    w_bar = eta_norm2 = h_pi = g_pi = 0.0
    for k in range(n):
        eta, pi = y[ETA + k], y[ETA + n + k]
        w_bar += plant.modal[H, k] * eta
        eta_norm2 += eta * eta
        h_pi += plant.modal[H, k] * pi
        g_pi += plant.modal[G, k] * pi
    rigid_inertia(plant, factor, ws.arm, carried_arms(plant.grips, plant.arms), c, s, w_bar, eta_norm2, ws.S)
    v = ws.velocity
    v[0], v[1], v[2] = y[P] + factor * (s * h_pi), y[P + 1] - factor * (c * h_pi), y[P + 2] - factor * g_pi
    solve_symmetric(ws.S, v)
    v2 = c * v[1] - s * v[0]
    for k in range(n):
        ws.eta_dot[k] = y[ETA + n + k] - plant.modal[H, k] * v2 - plant.modal[G, k] * v[2]
    return code, w_bar, h_pi - plant.kappa[0] * v2 - plant.kappa[1] * v[2]


@compiled
def velocities_at(plant, y, ws):
    """`find_velocities` for Python; returns a fault code."""
    return find_velocities(plant, y, ws)[0]


@compiled
def set_momenta(plant, y, velocity, eta_dot, ws):
    """Set P and π of y from ẋ (3,) and η̇ (n_m,) at y's coordinates, after `find_mass`; returns a fault code."""
    n, factor = plant.modal.shape[1], mass_factor(plant.mass_change, ws)
    code = place_arms(plant.grips, plant, y, ws)
    if code != 0:
        return code
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    v2 = c * velocity[1] - s * velocity[0]
    w_bar = eta_norm2 = h_pi = g_pi = 0.0
    for k in range(n):
        eta = y[ETA + k]
        pi = eta_dot[k] + plant.modal[H, k] * v2 + plant.modal[G, k] * velocity[2]
        y[ETA + n + k] = pi
        w_bar += plant.modal[H, k] * eta
        eta_norm2 += eta * eta
        h_pi += plant.modal[H, k] * pi
        g_pi += plant.modal[G, k] * pi
    rigid_inertia(plant, factor, ws.arm, carried_arms(plant.grips, plant.arms), c, s, w_bar, eta_norm2, ws.S)
    for a in range(3):
        y[P + a] = ws.S[a, 0] * velocity[0] + ws.S[a, 1] * velocity[1] + ws.S[a, 2] * velocity[2]
    y[P] -= factor * (s * h_pi)
    y[P + 1] += factor * (c * h_pi)
    y[P + 2] += factor * g_pi
    return code


@inlined
def add_axial_load(axial, ease, ws, dy):
    """Add the axial load's part of π̇ to dy, and its power. `ease`: 1/s of `mass_change`."""
    if axial is None:
        return
    if axial.shape[1] == 0:
        return
    n, given = len(ws.eta_dot), 0.0
    for k in range(n):
        dy[ETA + n + k] -= ease * ws.axial_force[0, k]
        given -= ws.eta_dot[k] * ws.axial_force[0, k]
    dy[AXIAL_WORK] = given


@inlined
def resist_axially(axial, plant, ease, h_force, g_force, ws):
    """Add the axial load's part of -η̈ to ws.restoring; returns h_force and g_force with it."""
    if axial is None:
        return h_force, g_force
    if axial.shape[1] > 0:
        for k in range(plant.modal.shape[1]):
            force = ease * ws.axial_force[0, k]
            ws.restoring[k] += force
            h_force += plant.modal[H, k] * force
            g_force += plant.modal[G, k] * force
    return h_force, g_force


@inlined
def momentum_rates(plant, y, w_bar, w_bar_rate, u, ws, dy, whole):
    """Fill ẋ, Ṗ, η̇, π̇ and the powers of dy, after `find_velocities`, C̄_i and the inputs u (arms, 3) are known.

    `whole`: fill the complete derivative. Otherwise, for a constant mass only, fill (η̇, π̇) without the beam's linear part (π,
    -Ω²η - Dπ), and no loss, as no sum over stages gives it for modes that are damped faster than the step.
    """
    n, factor = plant.modal.shape[1], mass_factor(plant.mass_change, ws)
    ease = 1 / factor
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    v, g = ws.velocity, plant.gravity
    w = v[2]
    v1, v2 = c * v[0] + s * v[1], c * v[1] - s * v[0]
    power = 0.0
    for a in range(3):
        rate = 0.0
        for i in range(carried_arms(plant.grips, plant.arms)):
            rate += u[i, a] - ws.arm.G[i, a]
            for b in range(3):
                rate += ws.arm.C[i, b, a] * v[b]
            power += u[i, a] * v[a]
        dy[X + a], dy[P + a] = v[a], rate
    power = begin_powers(plant.grips, u, ws, power)
    add_grip_loads(plant.grips, ws, dy, P)
    dy[P + 1] -= factor * (plant.m * g)
    dy[P + 2] += factor * (g * s * w_bar - w * w_bar * v2 - w_bar_rate * v1)

    lift = w * v1 + g * c
    dissipation = 0.0
    if whole:
        block_product(plant.block_start, plant.damping, ws.eta_dot, ws.damping_force)
        for k in range(n):
            dissipation += ws.eta_dot[k] * ws.damping_force[k]
    if whole:
        for k in range(n):
            dy[ETA + k] = ws.eta_dot[k]
            dy[ETA + n + k] = (
                (w * w - ease * plant.modal[OMEGA2, k]) * y[ETA + k]
                - ease * ws.damping_force[k]
                - plant.modal[H, k] * lift
            )
    else:
        for k in range(n):
            h, gk = plant.modal[H, k], plant.modal[G, k]
            dy[ETA + k] = -h * v2 - gk * w
            dy[ETA + n + k] = w * w * y[ETA + k] - h * lift + plant.modal[DH, k] * v2 + plant.modal[DG, k] * w
    hand = hand_of(plant.pull)
    if hand.stiffness != 0 and hand.arm >= 0:
        held = int(hand.arm)
        pull_on_link(plant, y, ws, ws.hand[held])
        power = pull_arm(plant.grips, held, ws, dy, P, power)
    elif hand.stiffness != 0:
        fx, fy, deflection = pull_force(plant, y, c, s)
        f1, f2, at = c * fx + s * fy, c * fy - s * fx, hand.position
        dy[P] += fx
        dy[P + 1] += fy
        dy[P + 2] += at * f2 - deflection * f1
        power += fx * v[0] + fy * v[1] + (at * f2 - deflection * f1) * w
        for k in range(n):
            dy[ETA + n + k] += ease * (plant.modal[PULL, k] * f2)
            power += plant.modal[PULL, k] * f2 * ws.eta_dot[k]
    dy[WORK], dy[DISSIPATED], dy[AXIAL_WORK] = power, dissipation, 0.0
    add_axial_load(plant.axial, ease, ws, dy)
    bring_material(plant.mass_change, plant, y, w_bar, ws, dy)
    move_arms(plant.grips, u, ws, dy, grips_start(plant))


@inlined
def bring_material(change, plant, y, w_bar, ws, dy):
    """Add the momentum of added material, ṡ (A11 ẋ + A12 η̇), to Ṗ, and fill the rate of its energy."""
    if change is None:
        return
    n, v, factor, rate = plant.modal.shape[1], ws.velocity, ws.mass_factor[FACTOR], ws.mass_factor[RATE]
    twice = 0.0
    for a in range(3):
        own = y[P + a]
        for i in range(carried_arms(plant.grips, plant.arms)):
            for b in range(3):
                own -= ws.arm.M[i, a, b] * v[b]
        dy[P + a] += rate / factor * own
        twice += own / factor * v[a]
    for k in range(n):
        twice += y[ETA + n + k] * ws.eta_dot[k]
    height = plant.gravity * (plant.m * y[1] + ws.arm.trig[0] * w_bar)
    dy[material_start(plant)] = rate * (twice / 2 + height)


@inlined
def pose_load(plant, w_bar, w_bar_rate, eta_eta_dot, h_force, g_force, f1, f2, pull_turn, u, ws, result):
    """Fill S ẍ (3,): inputs, arms, -(B11 ẋ + B12 q̇), weight, `hand_load`, and A12 times the beam's restoring force."""
    c, s, v, g = ws.arm.trig[0], ws.arm.trig[1], ws.velocity, plant.gravity
    w, factor = v[2], mass_factor(plant.mass_change, ws)
    for a in range(3):
        total = 0.0
        for i in range(carried_arms(plant.grips, plant.arms)):
            total += u[i, a] + ws.hand[i, a] - ws.arm.G[i, a]
            for b in range(3):
                total -= ws.arm.C[i, a, b] * v[b]
        result[a] = total
    add_grip_loads(plant.grips, ws, result, 0)
    inward, sideways = factor * (2 * w * w_bar_rate) + f1, factor * (w * w * w_bar + h_force) + f2
    result[0] += c * inward - s * sideways
    result[1] += s * inward + c * sideways - factor * (plant.m * g)
    result[2] += factor * (g * s * w_bar - 2 * w * eta_eta_dot + g_force) + pull_turn


@inlined
def acceleration(plant, y, beam_rate, w_bar, w_bar_rate, u, ws, result):
    """ẍ (3,) by Eq. (19): Eq. (16) with the beam eliminated by Eq. (17), after the same preparation as `momentum_rates`.

    `beam_rate` (n_m,): the η̇ on which damping acts. Fills ws.restoring, with which η̈ = -restoring - A21 ẍ, and ws.hand for a hand
    on a link. Returns the force of a hand at the beam along e1, N.
    """
    n, ease = plant.modal.shape[1], 1 / mass_factor(plant.mass_change, ws)
    c, w, g = ws.arm.trig[0], ws.velocity[2], plant.gravity
    block_product(plant.block_start, plant.damping, beam_rate, ws.damping_force)
    f1, f2, pull_turn = hand_load(plant, y, ws)
    h_force = g_force = eta_eta_dot = 0.0
    for k in range(n):
        force = (ease * plant.modal[OMEGA2, k] - w * w) * y[ETA + k] + ease * ws.damping_force[k]
        force -= ease * (plant.modal[PULL, k] * f2)
        force += plant.modal[H, k] * g * c
        ws.restoring[k] = force
        h_force += plant.modal[H, k] * force
        g_force += plant.modal[G, k] * force
        eta_eta_dot += y[ETA + k] * ws.eta_dot[k]
    h_force, g_force = resist_axially(plant.axial, plant, ease, h_force, g_force, ws)
    pose_load(plant, w_bar, w_bar_rate, eta_eta_dot, h_force, g_force, f1, f2, pull_turn, u, ws, result)
    solve_symmetric(ws.S, result)
    return f1
