"""Plant mistakes in physics and control, one at a time, in a copy of the package: `flexlab validate` must notice each.

`python tests/analysis/planted_errors.py [WORDS OF A NAME ...]` tries them, up to a minute each where the engine has to be
compiled again. The test suite only tries two that need no compiling, and checks that every error can still be planted.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent.parent
DIGEST = "_DIGEST = _digest()"
"""The line of compiled.py that names the folder of machine code after a digest of all sources."""


class PlantedError(NamedTuple):
    """One mistake: a sign, a factor, an index."""

    name: str
    file: str
    right: str
    wrong: str


ERRORS = r"""
payload inertia that an arm drives: control/law_kernels.py
    A[1, 2] = s * c * hh, s * hg, -c * hg
    A[1, 2] = s * c * hh, s * hg, c * hg
centrifugal force on the beam: physics/dynamics.py
    w * w * y[ETA + k] - h * lift
    -w * w * y[ETA + k] - h * lift
first moment of the beam: physics/beam.py
    (element - n / 2) * h_element
    (element + n / 2) * h_element
bent beam's inertia about θ: physics/dynamics.py
    = -c * w_bar + s * hg
    = c * w_bar + s * hg
weight of the payload: physics/dynamics.py
    dy[P + 1] -= factor * (plant.m * g)
    dy[P + 1] += factor * (plant.m * g)
Coriolis terms of an arm: physics/arm.py
    C12, C13, C23 = -arm.mu_12
    C12, C13, C23 = arm.mu_12
torque of the last joint: physics/arm.py
    on_third = u[2] - arm.reach
    on_third = u[2] + arm.reach
inertia in the internal force: physics/internal_force.py
    grip -= terms.M
    grip += terms.M
robust term of the law: control/laws/adaptive_sliding_mode.py
    *= -(K[a] + bound)
    *= -(K[a] - bound)
adaptation: control/laws/adaptive_sliding_mode.py
    b_rate[1] = s_norm
    b_rate[1] = -s_norm
boundary: boundaries.py
    "pinned-pinned": (0, -2)
    "pinned-pinned": (0, -1)
stiffness of the beam: physics/beam.py
    - 4), 6 - 12 * xi
    - 4), 6 + 12 * xi
damping of the beam: scenario/payload.py
    self.coefficient * product(V.T
    -self.coefficient * product(V.T
joint rates: physics/arm.py
    J[1, 2] = Kx, Ky, Kt
    J[1, 2] = -Kx, Ky, Kt
inertia of an arm: physics/arm.py
    M23 = arm.mu_23 * arm.tip * (c2
    M23 = arm.mu_23 * arm.tip * (-c2
weight of an arm: physics/arm.py
    G[2] = G1 * Jx + G2
    G[2] = G1 * Jx - G2
acceleration of the path: control/paths/sine.py
    = -amplitude * rate
    = amplitude * rate
load that an arm shares: control/law_kernels.py
    total = now.G[i, a] + share * f
    total = now.G[i, a] + 0.5 * f
velocity terms of the law: control/law_kernels.py
    + now.C[i, a, b] * rate[b]
    - now.C[i, a, b] * rate[b]
slope of the surface: control/sliding_surface.py
    desired[2, a] - Lambda[a] *
    desired[2, a] + Lambda[a] *
wanted internal force: control/law_kernels.py
    now.u[1, a] -= squeeze
    now.u[1, a] += squeeze
believed density: sim/build.py
    factors = (settings.model.length_factor, settings.model.linear_density_factor)
    factors = (settings.model.length_factor, 1.0)
switching of the sliding mode: control/laws/sliding_mode.py
    gains.bound / max(s_norm
    0.5 * gains.bound / max(s_norm
root of super-twisting: control/laws/super_twisting.py
    * feedback[a] / root + w
    * feedback[a] / size + w
integral of super-twisting: control/laws/super_twisting.py
    w_rate[a] = -gains.integral_gain
    w_rate[a] = gains.integral_gain
observed disturbance: control/laws/disturbance_observer.py
    * feedback[a] - d_hat[a]
    * feedback[a] + d_hat[a]
momentum that the observer begins with: control/laws/disturbance_observer.py
    d_hat[a] - memory[a] - memory[3 + a]
    d_hat[a] + memory[a] - memory[3 + a]
velocity terms of the momentum: control/laws/disturbance_observer.py
    rate[a] += now.C[i, b, a]
    rate[a] += now.C[i, a, b]
adaptation of the mass: control/laws/regressor_adaptive.py
    * (r_dot[0] * s[0] + up * s[1])
    * (r_dot[0] * s[0] - up * s[1])
load of the second link: control/laws/regressor_adaptive.py
    load[1, 0] = l1 * (l1 * first + a2
    load[1, 0] = l1 * (l1 * first - a2
start of the estimates: control/laws/regressor_adaptive.py
    begin.gains.initial_estimate_factor * begin
    begin
direction of active damping: control/laws/vibration_damping.py
    ax, ay = -now.trig[1]
    ax, ay = now.trig[1]
angular rate of active damping: control/laws/composite.py
    gains.angular_vibration_gain * rate[1])
    gains.lateral_vibration_gain * rate[1])
K_d of computed torque halved: control/laws/computed_torque.py
    - gains.velocity_gain[a] * rate_error
    - 0.5 * gains.velocity_gain[a] * rate_error
weight in pd: control/laws/proportional_derivative.py
    now.u[i, 1] += now.share
    now.u[i, 1] -= now.share
joint rates in joint-pd: control/laws/joint_pd.py
    - gains.velocity_gain[a] * rate_error
    + gains.velocity_gain[a] * rate_error
rate of rest-to-rest: control/paths/rest_to_rest.py
    30 * u * u * w * w
    60 * u * u * w * w
braking of bang-bang: control/paths/bang_bang.py
    4 * (1 - u), -4.0
    4 * (1 - u), 4.0
acceleration of the circle: control/paths/circle.py
    -rate * rate * x
    rate * rate * x
rate of the figure of eight: control/paths/figure_eight.py
    desired[1, a] = path.amplitude[a] * own
    desired[1, a] = path.amplitude[a] * rate
jerk between waypoints: control/paths/waypoints.py
    dt * jerk / 6
    dt * jerk / 3
acceleration of a table: control/paths/table.py
    g = g * dt + 2 * v
    g = g * dt + v
smooth start: control/motion.py
    (2.5 - 3 * u + u * u)
    (2.5 - 2 * u + u * u)
acceleration of a smooth start: control/motion.py
    + desired[1, a] * growth
    - desired[1, a] * growth
impulse of zvd halved: control/motion.py
    [1.0, 2 * k, k * k]
    [1.0, k, k * k]
impulse of ei-shaper: control/motion.py
    (1 - TOLERATED) * k / 2
    (1 + TOLERATED) * k / 2
time between impulses: control/motion.py
    * np.pi / (omega * root)
    * np.pi / omega
bending fed forward: control/law_kernels.py
    now.u[i, 0] -= now.share
    now.u[i, 0] += now.share
input delay one sample short: sim/sampled_control.py
    sampling.line[0, i, joint]\n    return
    sampling.line[min(1, sampling.delay), i, joint]\n    return
estimates of a clocked law: sim/sampled_control.py
    += sampling.period * ws.memory_rate
    += 0.5 * sampling.period * ws.memory_rate
size of the noise: sim/sampled_control.py
    radius = np.sqrt(-2 *
    radius = np.sqrt(-4 *
noise that repeats: sim/sampled_control.py
    + np.uint64(instant))
    + np.uint64(instant // 2))
noise of gauges: sim/sampled_control.py
    gaussian(sampling.seed, instant + 1, channel) - gaussian
    gaussian(sampling.seed, instant + 1, channel) + gaussian
torque limit: sim/closed_loop.py
    tau[joint] = np.copysign(limit[joint]
    tau[joint] = np.copysign(1.01 * limit[joint]
a gauge doubled: physics/sensors.py
    return -thickness / 2 *
    return -thickness *
observer's own torques: control/observers/observer.py
    total += gains.force_input[k, a] * force[a]
    total -= gains.force_input[k, a] * force[a]
prediction half a period short: control/laws/composite.py
    settings.input_delay + 0.5 if
    settings.input_delay if
regulator's weight of the beam: control/laws/lqr.py
    beam * np.square(plant.omega)
    beam * plant.omega
regulator's gain: control/laws/lqr.py
    total = -feedback[r]
    total = -0.5 * feedback[r]
stiffness damping: scenario/payload.py
    self.coefficient * (omega * omega)
    self.coefficient * omega
modal damping: scenario/payload.py
    2 * self.ratio * omega
    self.ratio * omega
viscous friction: physics/joints.py
    return numbers[VISCOUS, joint] * rate + sliding
    return numbers[VISCOUS, joint] * rate * 1.02 + sliding
Stribeck's fall: physics/joints.py
    square * numbers[STRIBECK, joint]
    rate * numbers[STRIBECK, joint]
friction that drives: physics/joints.py
    tau[joint] = given - lost
    tau[joint] = given + lost
friction's loss: physics/joints.py
    loss += lost * rate
    loss += 0.5 * lost * rate
what is believed of friction: physics/joints.py
    joints.numbers[BELIEVED, joint] * lost
    0.9 * joints.numbers[BELIEVED, joint] * lost
gap of a grip across: physics/grips.py
    across = c * dy - s * dx + side * sine
    across = c * dy - s * dx - side * sine
turn of the link in a grip's rate: physics/grips.py
    (vt * sine) + w * across
    (vt * sine) - w * across
arm of a grip's pull: physics/grips.py
    (side + along) * f2 - across * f1
    side * f2 - across * f1
pull at an arm: physics/grips.py
    (cosine * f2 - sine * f1)
    (cosine * f2 + sine * f1)
loss in the grips: physics/grips.py
    + b[2] * (turn_rate * turn_rate)
    - b[2] * (turn_rate * turn_rate)
energy of the grips' springs: sim/signals.py
    row[ELASTIC] += stored
    row[ELASTIC] += 0.9 * stored
rounding of a count: physics/sensors.py
    np.floor(angle / count + 0.5)
    np.floor(angle / count)
arm whose encoders are read: physics/sensors.py
    arm.l2 * s2 - arm.reach
    arm.l2 * s2 + arm.reach
time constant of a motor: physics/joints.py
    lag_rate=1 / motor.time_constant
    lag_rate=1.1 / motor.time_constant
torque that falls with speed: physics/joints.py
    max(min(torque, numbers[STALL, joint] - fall)
    max(min(torque, numbers[STALL, joint] + fall)
torque of a late motor that turns the links: physics/joints.py
    given = states[place]
    given = 0.9 * states[place]
no-load speed: physics/joints.py
    stall / np.array(motor
    0.9 * stall / np.array(motor
reach of the arms in the function that falls: analysis/paper_equations.py
    grip_rate - l3 * turn_rate
    grip_rate + l3 * turn_rate
mid-span of a beam whose mesh changes: sim/bumpless_transfer.py
    product(payload_row(old, 0.0), q) - product(
    product(payload_row(old, 0.0), q) + product(
moment between the arms: analysis/metrics/magnitudes.py
    internal_force[:, 0, 2:]
    internal_force[:, 0, 1:2]
decay that the condition of lqr tells: control/laws/lqr.py
    eigvals(transition - inputs @ K)
    eigvals(transition + inputs @ K)
delay that a sampled loop allows: control/conditions.py
    np.pi / (4 * delay + 2)
    np.pi / (4 * delay + 1)
memory in the sampled loop: analysis/stability.py
    + len(kept)] += np.eye
    + len(kept)] -= np.eye
late motors in linear models: analysis/stability.py
    np.eye(count) / time_constant
    np.eye(count) / (1.1 * time_constant)
momentum that material brings: physics/dynamics.py
    dy[P + a] += rate / factor * own
    dy[P + a] += 0.98 * rate / factor * own
energy that material brings: physics/dynamics.py
    rate * (twice / 2 + height)
    rate * (twice + height)
stiffness over a filled beam's mass: physics/dynamics.py
    (w * w - ease * plant.modal[OMEGA2, k])
    (w * w - plant.modal[OMEGA2, k])
mass in the beam's push on the arms: physics/dynamics.py
    result[1] += s * inward + c * sideways - factor *
    result[1] += s * inward + c * sideways - 1.01 * factor *
part of a change of mass that a law follows: physics/mass_change.py
    factor = 1 + part * (ws.mass_factor[FACTOR] - 1)
    factor = 1 + part * part * (ws.mass_factor[FACTOR] - 1)
course of a change of mass: physics/mass_change.py
    (15 - 6 * u)
    (15 - 5.9 * u)
rate of two readings: physics/sensors.py
    / period\n
    / (1.1 * period)\n
lag of the rate in the linear model: analysis/linearization.py
    law.memory, -by_rate
    law.memory, by_rate
acceleration in the axial load that a law believes in: control/observers/believed_plant.py
    load[0] * G0 + load[1] * G1
    load[0] * G0 - load[1] * G1
weight in the axial load that a law believes in: control/observers/believed_plant.py
    * law.model.linear_density_factor * payload.length
    / law.model.linear_density_factor * payload.length
leg that does not reach its speed: control/paths/waypoints.py
    - 3 * rising) / 2
    + 3 * rising) / 2
leg that reaches no limit but its jerk: control/paths/waypoints.py
    _cube_root(0.5 / jerk)
    _cube_root(2.0 / jerk)
spin in the axial load: physics/axial_load.py
    density / 2 * terms[SPIN]
    density * terms[SPIN]
bending in the axial load: physics/axial_load.py
    h_force += own_h * force
    h_force -= own_h * force
spin in the axial stiffness: physics/axial_load.py
    factor * terms[SPIN], eta
    -factor * terms[SPIN], eta
growth of the payload as a controller believes it: physics/mass_change.py
    return factor, part * ws
    return factor, 0.5 * part * ws
force along a beam in grips that give way: physics/axial_load.py
    c * ws.grips.load[i, 0]
    0.5 * c * ws.grips.load[i, 0]
static friction: physics/joints.py
    (friction.static_factor - 1)
    0.5 * (friction.static_factor - 1)
largest acceleration of a straight path: control/straight_line.py
    factor * abs(b - a)
    0.5 * factor * abs(b - a)
centrifugal force in the loss of a step: sim/integrators/beam_flow.py
    = w * w * y[ETA + k] - plant
    = 0.5 * w * w * y[ETA + k] - plant
a table that repeats: control/paths/table.py
    step * (24 * jets
    step * (12 * jets
power of a hand on a link: physics/grips.py
            power += ws.hand[held, a] * ws.velocity[a]
            power += 0.5 * ws.hand[held, a] * ws.velocity[a]
hand on a last link: physics/hand.py
    hand.target_x - (at_x + reach * c)
    0.5 * hand.target_x - (at_x + reach * c)
noise of the beam's rates: sim/sampled_control.py
    truth[a] + sampling.noise[channel]
    truth[a] + 0.5 * sampling.noise[channel]
path that was changed in motion: control/motion.py
    x * h + v * k
    x * h + 0.5 * v * k
damping for which a shaper is made: sim/target.py
    np.clip(-value.real[place]
    np.clip(value.real[place]
target of lqr ahead of its time: sim/sampled_control.py
    desired_motion(system.trajectory, t + sampling.delay * sampling.period
    desired_motion(system.trajectory, t + 0.5 * sampling.delay * sampling.period
momentum until the law acts: control/laws/disturbance_observer.py
    return p + begin.wait * rate
    return p + 0.5 * begin.wait * rate
disturbance that a change passes on: control/laws/disturbance_observer.py
    _momentum_ahead(begin) - known - passed
    _momentum_ahead(begin) - known + passed
noise of gauges that an observer reads: sim/sampled_control.py
    return strain + sampling.strain_noise
    return strain + 0.5 * sampling.strain_noise
places at which a beam whose mesh changes is compared: sim/bumpless_transfer.py
    for p in (old, new)))
    for p in (new, new)))
loss of a held beam: sim/advance.py
    y[DISSIPATED] += before - unspent
    y[DISSIPATED] -= before - unspent
rate of a fast mode at a sample: sim/integrators/beam_flow.py
    rate[k] += late * (
    rate[k] += 0.5 * late * (
push of fast modes on the grips: sim/integrators/beam_flow.py
    m00, m01 = 1 - W_hh
    m00, m01 = 1 + W_hh
rate of a fast mode since the sample before: sim/integrators/beam_flow.py
    rate[k] += early * flow
    rate[k] += 0.5 * early * flow
shape of a beam whose mesh changes: sim/bumpless_transfer.py
    correction * (product(payload_row(old
    0.5 * correction * (product(payload_row(old
masses of the left arm for both: control/observers/believed_plant.py
    arm.link_mass,
    arms[0].link_mass,
height of a base in the energy of weight: physics/energy.py
    arm.mass * arm.base_y + arm.gamma_1
    arm.gamma_1
mass of the first link for the second: physics/arm.py
    inertia[0] + (m2 + m3)
    inertia[0] + (m1 + m3)
height of a base in the wrist: physics/arm.py
    reach * s - arm.base_y
    reach * s + arm.base_y
weight in the quasi-static deflection: physics/beam.py
    s * desired[2, 0] + gravity * c
    s * desired[2, 0] + gravity * s
turn in the quasi-static deflection: physics/beam.py
    lateral + compliance[1] * desired[2, 2]
    lateral - compliance[1] * desired[2, 2]
mass in the quasi-static deflection: sim/signals.py
    row[QUASI_STATIC] = factor * quasi
    row[QUASI_STATIC] = quasi
force beyond a hand: physics/axial_load.py
    load -= terms[HAND]
    load += terms[HAND]
stiffness beyond a hand: physics/axial_load.py
    force[k] -= pulled * G_F[k]
    force[k] += pulled * G_F[k]
part of an element beyond a hand: physics/axial_load.py
    xi = low + (1 - low) * (point + 1) / 2
    xi = (1 - low) * (point + 1) / 2
mass in the force along the beam: physics/axial_load.py
    density, half = factor * (plant.m / plant.length)
    density, half = (plant.m / plant.length)
mass in the axial stiffness: physics/axial_load.py
    factor * terms[ALONG], factor * terms[SPIN], eta
    terms[ALONG], factor * terms[SPIN], eta
compression at a hand: physics/axial_load.py
    least = min(least, at, at - terms[HAND])
    least = min(least, at)
compression over the buckling load: sim/signals.py
    terms, factor) / plant.buckling_load
    terms, factor) / (2 * plant.buckling_load)
spin over the stiffness: sim/signals.py
    factor * terms[SPIN] / first_stiffness
    terms[SPIN] / first_stiffness
hand on a beam that is filled: physics/dynamics.py
    dy[ETA + n + k] += ease * (plant.modal[PULL, k] * f2)
    dy[ETA + n + k] += plant.modal[PULL, k] * f2
deflection under a tap: sim/disturbance.py
    across - deflection * along
    across + deflection * along
mass under a tap: sim/disturbance.py
    shape * across / factor
    shape * across
impulse along a beam: sim/disturbance.py
    left * G0 + factor * along * G1
    left * G0 - factor * along * G1
impulse on the left arm: sim/disturbance.py
    left = c * by_arm[0] + s * by_arm[1] if
    left = c * by_arm[0] - s * by_arm[1] if
energy of the grips' springs alone: sim/signals.py
    row[end - 2], row[end - 1] = stored, states
    row[end - 2], row[end - 1] = 0.5 * stored, states
rate that is measured between grips: physics/grips.py
    rate + ws.grips.velocity[i, a]
    rate + ws.velocity[a]
torques at another pose: physics/grips.py
    task_input(ws.arm.J[i], ws.tau, ws.u[i])
    task_input(seen.J[i], ws.tau, ws.u[i])
where the pose is measured: physics/grips.py
    grips.measured_at == "arms"
    grips.measured_at != "arms"
whole beam in a law with few modes: sim/build.py
    loads = product(V.T, np.stack([matrices.h, matrices.g], axis=1))\n    kept
    loads = product(V[:, : payload.mode_count].T, np.stack([matrices.h, matrices.g], axis=1))\n    kept
modes that are kept: sim/build.py
    slice(0, payload.mode_count)
    slice(-(payload.mode_count or 0), None)
leakage that grows: control/laws/adaptive_sliding_mode.py
    b_rate[1] = s_norm * x_norm / k[1] - leakage
    b_rate[1] = s_norm * x_norm / k[1] + leakage
one adaptation gain for all: control/laws/adaptive_sliding_mode.py
    v_norm2 / k[2]
    v_norm2 / k[0]
one sliding slope for all: control/sliding_surface.py
    desired[2, a] - Lambda[a] *
    desired[2, a] - Lambda[0] *
one feedback gain for all: control/laws/sliding_mode.py
    gains.feedback_gain[a] + switching
    gains.feedback_gain[0] + switching
gain of the first joint for the second: control/laws/joint_pd.py
    -gains.position_gain[a] * error
    -gains.position_gain[max(a - 1, 0) if a < 2 else a] * error
reaction in the laws' conditions: analysis/law_conditions.py
    desired[:, 0, 2], desired[:, 2]
    desired[:, 0, 2], desired[:, 1]
Levant's condition: control/laws/super_twisting.py
    rate * (k2 + rate) / (k2 - rate)
    rate * (k2 - rate) / (k2 + rate)
growth in the conditions of rate feedback: control/conditions.py
    gains[0] * around.loads[0] ** 2
    gains[0] * around.loads[0]
slope in a law's fastest rate: control/sliding_surface.py
    now.scratch[3:6]) + max(Lambda)
    now.scratch[3:6])
participation of a mode: analysis/modes.py
    g**2 / beam.matrices.I
    g**2 / beam.matrices.m
damping ratio of a mode: analysis/modes.py
    [order] / (2 * omega)
    [order] / omega
input of a linear model: analysis/linearize.py
    effect[signal][:, place]
    effect[signal][place]
disk margin: analysis/stability.py
    identity + loop) / 2
    identity + loop)
gain of zeros and poles: analysis/linear_model.py
    [0, 0, 0] * ratio)
    [0, 0, 0] / ratio)
frequency of a ring: analysis/identification/ring.py
    natural = float(np.hypot(omega, sigma))
    natural = float(omega)
millimetres of a table: analysis/metrics/magnitudes.py
    "peak y", "mm", 1e3
    "peak y", "mm", 1e2
hand on a first link: physics/hand.py
    d1, d2 = (at, 0.0) if link == 0
    d1, d2 = (arm.l1, 0.0) if link == 0
reading before the first one: physics/sensors.py
    before[a] = y[a] - period * ws.velocity[a]
    before[a] = y[a] + period * ws.velocity[a]
noise of the turning moment's gauges: sim/sampled_control.py
    sampling.gauge_noise[1, j] * change
    sampling.gauge_noise[0, j] * change
torque at its limit as the run tells it: sim/signals.py
    row[SATURATED] = saturated
    row[SATURATED] = 1 - saturated
friction of the other arm: sim/signals.py
    row[first + k] = ws.joint_friction[k // 3, k % 3]
    row[first + k] = ws.joint_friction[count // 3 - 1 - k // 3, k % 3]
time at which a vibration is gone: analysis/metrics/vibration.py
    float(loud[-1] - self._first) if
    float(loud[-1]) if
torque at its lower limit: sim/signals.py
    if abs(tau[a]) >= most
    if tau[a] >= most
torque limit of a clocked law: sim/sampled_control.py
    limit_torques(control.torque_limit, ws.tau)
    limit_torques(control.torque_limit[::-1], ws.tau)
confidence of an interval: analysis/identification/ring.py
    0.5 + CONFIDENCE / 2
    CONFIDENCE
interval of a damping ratio: analysis/identification/ring.py
    omega**2]) / natural**3
    omega**2]) / natural**2
interval of a bending stiffness: analysis/identification/beam_parameters.py
    ** (1 / power)
    ** power
interval of a damping coefficient: analysis/identification/beam_parameters.py
    in (ratio.value, ratio.low, ratio.high)
    in (ratio.value, ratio.value, ratio.high)
interval in noise that is not white: analysis/identification/ring.py
    if exact else evidence.shifts(
    if True else evidence.shifts(
frequency that changes during a ring: analysis/identification/ring.py
    _merged(_without_noise(found, tau, y), tau, y)
    _without_noise(found, tau, y)
half of a ring: analysis/identification/evidence.py
    parts = (slice(0, middle), slice(middle, count))
    parts = (slice(0, middle), slice(0, count))
one coordinate's acceleration for all: control/sliding_surface.py
    desired[2, a] - Lambda[a] *
    desired[2, 0] - Lambda[a] *
one number's size for all channels of noise: sim/sampled_control.py
    first = mix(key + np.uint64(2 * channel + 1)
    first = mix(key + np.uint64(1)
noise of gauges that is the pose's: sim/sampled_control.py
    channel = GAUGE_CHANNEL + j
    channel = j
torques that come within an observer's horizon: control/observers/observer.py
    u[a] = now.u[i, a]
    u[a] = 0.0
payload's pose that a law measures: sim/closed_loop.py
    find_grip_forces(plant.grips, plant, y[0:3]
    find_grip_forces(plant.grips, plant, y[1:4]
hand on the left arm in the acceleration: physics/hand.py
    if hand.stiffness != 0 and hand.arm >= 0:
    if hand.stiffness != 0 and hand.arm >= 1:
hand that has let go of an arm: physics/hand.py
    ws.hand[i, a] = 0.0
    ws.hand[0, a] = 0.0
hand that has let go between grips: physics/grips.py
    ws.hand[i, a] = 0.0
    ws.hand[i, 0] = 0.0
states of the grips beside those of the material: sim/closed_loop.py
    end + 1)}, end + 1
    end + 1)}, end
modes that feel the force along a fine mesh: physics/axial_load.py
    eta[i] = y[ETA + k]
    eta[i] = y[ETA + i + 1]
rate of θ on a circle: control/paths/circle.py
    desired[1, 0], desired[1, 1], desired[1, 2] = -rate
    desired[1, 0], desired[1, 1], desired[0, 2] = -rate
beginning of a table: control/paths/table.py
    t - path.start, desired
    t + path.start, desired
angle that a path keeps: control/phase.py
    (old - new) * time
    (new - old) * time
pose from which a straight line begins: control/straight_line.py
    [time, time + 0.25
    [0.0, time + 0.25
excitation that ends a pause: analysis/metrics/vibration.py
    + near].max()
    + near].min()
first sample of a window: analysis/metrics/run_metrics.py
    [first - ROUNDING
    [first + ROUNDING
vibration in pieces: analysis/metrics/vibration.py
    np.hstack([self._extremes, [signal, -signal]])
    np.hstack([self._extremes, [signal, signal]])
fastest rate of damping the turn: control/laws/vibration_damping.py
    gains.angular_vibration_gain * kappa[2]
    gains.angular_vibration_gain * kappa[1]
fastest rate in the joints: control/laws/joint_pd.py
    else outer - inner
    else outer + inner
fastest rate of the regulator: control/laws/lqr.py
    singular_vectors(damping)[0][-1]
    singular_vectors(damping)[0][0]
slope of friction at rest: physics/joints.py
    static = numbers[COULOMB, joint] + numbers
    static = numbers[COULOMB, joint] - numbers
verdict on super-twisting: control/laws/super_twisting.py
    enough = k2 > rate
    enough = k1 > rate
eigenvalue of an inertia: control/rates.py
    half += B[0, 2] *
    half += B[0, 1] *
last term of exp: numerics/elementary.py
    z * 4.13813679705723846039e-08
    z * -4.13813679705723846039e-08
second digit of a large angle: numerics/elementary.py
    second * 2.0**-102
    second * 2.0**-101
eigenvalue after an exceptional shift: numerics/eigenvalues.py
    x + shift, 0.0
    x, 0.0
φ3 of a doubled matrix: numerics/matrix_functions.py
    third + phi1 / 2
    third + phi1
angle of a drawn beam: sim/geometry.py
    samples.pose[:, 2:3]
    samples.pose[:, 1:2]
modes that do not follow the force along the beam: physics/axial_load.py
    given[2, 1] + c * hg
    given[2, 1] - c * hg
deflection under a hand in the acceleration: physics/hand.py
    pull_turn = hand.position * f2 - deflection * f1
    pull_turn = hand.position * f2 + deflection * f1
loop that a delay allows: control/conditions.py
    return 2 * each(sin,
    return 0 * each(sin,
growth of modes that a late turn feeds: control/conditions.py
    + gains[1] * around.loads[1]
    + gains[0] * around.loads[1]
vibration that a shaper leaves: control/motion.py
    np.exp(1j * omega * shaped
    np.exp(2j * omega * shaped
turn in the friction that a sampled law makes up for: sim/sampled_control.py
    ws.measured_arm, v[0], v[1], v[2], now.u
    ws.measured_arm, v[0], v[1], v[1], now.u
lift in the loss of a step: sim/integrators/beam_flow.py
    + (lift + 4 * kept[MIDDLE + 2]
    - (lift + 4 * kept[MIDDLE + 2]
acceleration that ends a step: sim/integrators/beam_flow.py
    met = c * x_ddot[1] - s * x_ddot[0]
    met = c * x_ddot[1] + s * x_ddot[0]
tilt in what fast modes put on the grips: sim/integrators/beam_flow.py
    across[0], across[1], across[2] = -s, c, 0.0
    across[0], across[1], across[2] = s, c, 0.0
payload's angle for encoders between grips: physics/sensors.py
    _, _, theta = own_pose(grips, at, ws, i)
    _, _, theta = at[0], at[1], at[2]
reading before the first one between grips: physics/sensors.py
    y[0:3], states, -period, ws) != 0
    y[0:3], states, period, ws) != 0
instants at which a shaper's copies begin: sim/target.py
    own.append(0.0)
    own.append(1.0)
force along a beam of one mode: physics/axial_load.py
    if axial.shape[1] == 0:\n        return\n    along
    if axial.shape[1] == 1:\n        return\n    along
each motor of its own in the disk margin: analysis/stability.py
    scale[:, :, None] / scale[:, None, :]
    scale[:, None, :] / scale[:, :, None]
memory in a sampled disk margin: analysis/stability.py
    slope = (where if period is None else where - 1)
    slope = where
torques that turn with the pose: analysis/linearization.py
    return probe.forces(rest.motion.moved(step), rest.torque)
    return probe.forces(rest.motion.moved(step), idle)
folding of a ring's frequency: analysis/modes.py
    for side in (-1, 1)]\n            seen
    for side in (1, 1)]\n            seen
acceleration of a target in a sampled model: analysis/linearize.py
    answer[:, size:] += law.desired[rows] @ desired
    answer[:, size:] += law.desired[rows] @ (desired * (np.arange(9)[:, None] < 6))
ring in a loop at other poses: analysis/identification/beam_parameters.py
    rings[0, 0] / rings[:, 0]
    rings[:, 0] / rings[0, 0]
beam's stiffness as a controller believes it: control/observers/believed_plant.py
    payload.bending_stiffness * model.stiffness_factor
    payload.bending_stiffness
axial load of a single arm that a law believes in: control/observers/believed_plant.py
    return -mass * along, along
    return mass * along, along
limits of each axis of waypoints: control/paths/waypoints.py
    np.min(np.array(limit)[way != 0] / np.abs(way[way != 0]))
    np.min(np.array(limit)[way != 0]) / np.max(np.abs(way))
lag and speed of a motor in the saturation that the run tells: physics/joints.py
    return ws.joint_feasible[i, joint] != asked or abs(asked) >= limit
    return abs(asked) >= limit
weight at an angle in an observer: control/observers/observer.py
        weight = now.gravity * now.trig[0]\n        for k in range(2 * n):
        weight = now.gravity\n        for k in range(2 * n):
bending fed forward by asymmetric ends: control/law_kernels.py
    (now.kappa[0] * lateral + now.kappa[1] * turn)
    (now.kappa[0] * lateral - now.kappa[1] * turn)
axial load of a single arm whose payload is filled: physics/axial_load.py
    along - mass_factor(plant.mass_change, ws) * (plant.m * terms[ALONG])
    along - plant.m * terms[ALONG]
grips that begin to give way in motion: physics/grips.py
    [0.0, 0.0, 0.0, *rate]
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
hand on a beam that is changed: sim/bumpless_transfer.py
    set_pull_row(plant, assembly.scenario.payload, assembly.beam)
    plant.pull[:] = pull
force that a farsighted regulator foresees: control/laws/lqr.py
    if gains.predicted_periods > now.delay
    if gains.predicted_periods < now.delay
torques under way when the delay changes: sim/bumpless_transfer.py
    assembly.sampling.line[-length:] = old_line[-length:]
    assembly.sampling.line[:length] = old_line[:length]
load of a single arm: sim/build.py
    if arm_count == MOST_ARMS else np.ones(MOST_ARMS)
    if arm_count <= MOST_ARMS else np.ones(MOST_ARMS)
compression at one end of the beam: physics/axial_load.py
    least = min(axial_load_at(plant, terms, factor, -half), axial_load_at(plant, terms, factor, half))
    least = axial_load_at(plant, terms, factor, half)
inertia of a piece of an exported beam: multibody/bodies.py
    mass * float(length[k]) ** 2 / 12
    mass * float(length[k]) ** 2 / 3
turn of an exported arm at the start: multibody/bodies.py
    np.array([-sin(theta), cos(theta), 0.0])
    np.array([sin(theta), cos(theta), 0.0])
weight in MuJoCo's file: multibody/formats.py
    gravity = f"0 0 {-bodies
    gravity = f"0 0 {bodies
unit of a column: recording/table_columns.py
    signal.units[kind % len(signal.units)]
    signal.units[0]
arm of a curve in Figure 5: analysis/figures.py
    Curve(arms[i][0], force[:, i, k]
    Curve(arms[i][0], force[:, 0, k]
stiffness that a linear model tells: analysis/linearize.py
    (linear.plant.mass, linear.plant.damping, linear.plant.stiffness)
    (linear.plant.mass, linear.plant.stiffness, linear.plant.damping)
one step in the growth of errors: sim/parametric_resonance.py
    whole[2](-3 * N1 + 2 * N2
    whole[2](-3 * N1 + 1 * N2
distance of a wrist as a run ends: sim/termination.py
    distance - shortest), index, distance, longest))
    distance - shortest), index, longest - distance, longest))
vibration in the environment's reward: gym_environment/kernels.py
    (row[MIDSPAN] - row[QUASI_STATIC]) / VIBRATION_SCALE
    (row[MIDSPAN] + row[QUASI_STATIC]) / VIBRATION_SCALE
angle in the environment's reward: gym_environment/kernels.py
    ANGLE_SCALE if a == 2 else
    ANGLE_SCALE if a == 1 else
cost of an episode that fails: gym_environment/kernels.py
    -worst * period * (ticks - tick)
    -worst * period * (ticks - tick - 1)
pose that the environment tells: gym_environment/kernels.py
    seen[11 + a] = error + ws.desired[0, a]
    seen[11 + a] = y[a]
noise of rates in the environment: gym_environment/kernels.py
    rate += scale * noise[3 + a] * gaussian(seed, instant, 3 + a)
    rate += scale * noise[a] * gaussian(seed, instant, 3 + a)
moment rates in the environment: gym_environment/kernels.py
    moment = ws.beam_rate[a]
    moment = ws.beam_rate[0]
delay of actions: gym_environment/kernels.py
    held[i, joint] = line[0, i, joint]
    held[i, joint] = line[worlds.delay[w] // 2, i, joint]
end of an episode: gym_environment/kernels.py
    worlds.over[w] = tick + 1 >= ticks
    worlds.over[w] = tick >= ticks
arms' shares of an action: gym_environment/kernels.py
    system.control.share[i] * actions[w, a]
    actions[w, a]
effort in the environment's reward: gym_environment/kernels.py
    share = held[i, joint] / limits[joint]
    share = ws.tau[joint] / limits[joint]
longest delay in the environment: gym_environment/worlds.py
    settings.delay[1] + 1, size=number
    max(settings.delay[1], 1), size=number
stiffnesses of the environment's beams: gym_environment/worlds.py
    np.geomspace(*given
    np.linspace(*given
starts of episodes: gym_environment/worlds.py
    random.uniform(-1, 1, (number, 3))
    random.uniform(0, 1, (number, 3))
noise of many worlds: gym_environment/worlds.py
    random.integers(2**31, size=number)
    random.integers(2**31)
place of a unit's outputs: fmi/description.py
    causality, place + 8 * at)
    causality, place + 8 * at + 8)
units of a follower's inputs: fmi/description.py
    ("rate", RATE_UNITS, "ẋ_d
    ("rate", POSE_UNITS, "ẋ_d
inputs of a unit at the start: fmi/description.py
    place + 8 * k, begin[k])
    place + 8 * k, begin[0])
seconds in a newton: quantities.py
    "N": {"kg": 1, "m": 1, "s": -2}
    "N": {"kg": 1, "m": 1, "s": -1}
acceleration of a follower's target: fmi/parts.py
    (path.rate[a] + 0.5 * since * path
    (path.rate[a] + since * path
what a plant unit's sensors tell: fmi/parts.py
    *ws.velocity, *ws.beam_rate, *strains
    *ws.velocity, *ws.beam_rate[::-1], *strains
samples that a recording gives back: recording/codec.py
    x = difference + 3 * x1 - 3 * x2 + x3
    x = difference + 3 * x1 - 3 * x2 - x3
pieces of an exported run: recording/export.py
    [part[name] for part in parts])
    [part[name] for part in parts[:1] * len(parts)])
columns of an imported run: recording/table_columns.py
    array[(slice(None), *column.index)] = given
    array[(slice(None), *column.index[::-1])] = given
unit of a slope: recording/table_columns.py
    axis.labels[c % 2]), c % 2) for
    axis.labels[c % 2]), 0) for
works in the plot of energies: views.py
    total_energy, input_work, axial_work, dissipated
    total_energy, axial_work, input_work, dissipated
scale of a plot's curves: views.py
    np.multiply(self.scale, numbers
    np.multiply(1.0, numbers
second signal of a plot: views.py
    out=shown[:, first:last]
    out=shown[:, first - last :]
metrics in the units of tables: analysis/metrics/run_metrics.py
    MetricRow(column, column.scale * value
    MetricRow(column, value / column.scale
metrics by their earlier names: analysis/metrics/run_metrics.py
    return found.scale * self._values
    return self._values
metrics of compared runs: analysis/comparison.py
    row.value / row.column.scale
    row.value * row.column.scale
difference of two runs: text.py
    difference = other - value
    difference = value - other
place of a cell in a sweep's map: analysis/sweep/figures.py
    placed[np.searchsorted(lines, y), np
    placed[np.searchsorted(-lines[::-1], -y), np
edges of logarithmic cells: analysis/sweep/figures.py
    return np.exp(edges) if logarithmic
    return np.exp(edges - edges[0]) if logarithmic
metrics in a sweep's table: analysis/sweep/result.py
    *(cell.metrics or nothing), cell
    *(cell.metrics[::-1] if cell.metrics else nothing), cell
worst scenario of a tuning: analysis/tuning.py
    return max(found, key=lambda candidate
    return min(found, key=lambda candidate
candidates beyond the limits: analysis/tuning.py
    (BEYOND, self.excess, self.cost)
    (BEYOND, self.cost, self.excess)
means over a case's variants: analysis/leaderboard/report.py
    exp(sum(log(found[law]) for found in entered) / len(entered))
    sum(found[law] for found in entered) / len(entered)
scores as they are shown: analysis/leaderboard/board.py
    None if value is None else column.scale * value
    value
damping ratio in the table of modes: analysis/modes.py
    f"{100 * modes.damping_ratio[k]:.3g}"
    f"{modes.damping_ratio[k]:.3g}"
damping ratio in the table of poles: analysis/modes.py
    f"{100 * row.damping_ratio:.3g}"
    f"{200 * row.damping_ratio:.3g}"
share of a ring after a stop: analysis/explanations/vibration.py
    share = n(100 * left / seen
    share = n(left / seen
bending by a jerky start: analysis/explanations/vibration.py
    between(samples, start, start + FIRST).vibration
    between(samples, start, start + FIRST).midspan_deflection
error within the layer: analysis/explanations/steady_error.py
    largest_reaction / (stiffness * slope)
    largest_reaction / (gain * slope + slope**2)
leak of the estimates: analysis/explanations/steady_error.py
    {n(now * law.leakage)} N each
    {n(now)} N each
torque of an arm that is nearly stretched: analysis/explanations/forces.py
    joint_torque[:, index])
    joint_torque[:, 0])
squeeze along the link: analysis/explanations/forces.py
    + force[:, 0, 1] * np.sin(angle)
    - force[:, 0, 1] * np.sin(angle)
longest control period of a pose that runs away: analysis/explanations/growth.py
    n(1e3 * limit / around.fastest_rate)
    n(1e3 / around.fastest_rate)
limit of the joint that stands at it: analysis/explanations/measured_signals.py
    {n(allowed[joint])} N·m
    {n(allowed[0])} N·m
correlation of a torque's jumps: analysis/explanations/measured_signals.py
    np.sum(turns[1:] * turns[:-1]) / np
    0.9 * np.sum(turns[1:] * turns[:-1]) / np
error that a run tells of itself: sim/accuracy.py
    row[POSE : POSE + 3] - again[POSE : POSE + 3]
    0.1 * (row[POSE : POSE + 3] - again[POSE : POSE + 3])
share of the force's error: sim/run_warnings.py
    number_text(100 * force / peak, 1)
    number_text(force / peak, 1)
frequencies in the note on exported bodies: multibody/bodies.py
    frequency=omega / (2 * pi),
    frequency=omega / pi,
turn in a jump of accelerations: sim/integrators/generalized_alpha.py
    plant.modal[H, k] * lateral + plant.modal[G, k] * jump[2]
    plant.modal[H, k] * lateral - plant.modal[G, k] * jump[2]
memory under generalized-alpha: sim/integrators/generalized_alpha.py
    weight = 0.5 / (1 - ALPHA_F)
    weight = 0.5
strains that a law's unit is given: sim/sampled_control.py
    sensors[8 + j])
    sensors[7 + j])
part of a change of mass that a clocked law knows: sim/sampled_control.py
    believed_mass(plant.mass_change, control.payload.change, ws)
    believed_mass(plant.mass_change, 1.0, ws)
bending fed forward under a clock: sim/sampled_control.py
    feed_forward_bending(system.trajectory.bending, now)
    feed_forward_bending(0.5 * system.trajectory.bending, now)
rate that a clocked law measures between grips: sim/sampled_control.py
    ws.grips.measured[0], ws.grips.measured[1], y, ws, now)
    ws.grips.measured[0], ws.velocity, y, ws, now)
jump of an acceleration under generalized-alpha: sim/integrators/generalized_alpha.py
    noted[a] += jump[a]
    noted[a] += 0.5 * jump[a]
"""
"""Three lines per error: its name and file, the right code, the wrong code."""


def _planted() -> Iterator[PlantedError]:
    lines = ERRORS.strip().splitlines()
    for head, right, wrong in zip(lines[::3], lines[1::3], lines[2::3], strict=True):
        name, file = head.split(": ")
        yield PlantedError(name, file, *(text.strip(" ").replace("\\n", "\n") for text in (right, wrong)))


PLANTED = tuple(_planted())


def planted_text(error: PlantedError) -> str:
    """Return the file's text with the error in it. Raises ValueError unless there is exactly one place for it."""
    text = (ROOT / "flexlab" / error.file).read_text(encoding="utf-8")
    if text.count(error.right) != 1:
        raise ValueError(f"{error.file} has no single {error.right!r}: plant {error.name} elsewhere")
    return text.replace(error.right, error.wrong)


class Copy:
    """A copy of the package, with its own machine code beside it, in which errors are planted one after another.

    An inlined kernel is part of every kernel that calls it, so an error in a file with such kernels requires all to be
    compiled again. For any other file that changed, Numba itself compiles its kernels again.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        shutil.copytree(ROOT / "flexlab", folder / "flexlab", ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("presets", "web_assets"):
            (folder / name).symlink_to(ROOT / name)
        compiled = folder / "flexlab" / "compiled.py"
        text = compiled.read_text(encoding="utf-8")
        if text.count(DIGEST) != 1:
            raise ValueError(f"compiled.py has no single {DIGEST!r}")
        compiled.write_text(text.replace(DIGEST, '_DIGEST = os.environ["PLANTED"]'), encoding="utf-8")

    def validate(self, error: PlantedError | None = None) -> subprocess.CompletedProcess[str]:
        """Run `flexlab validate` with an error, or without one."""
        place = self._folder / "flexlab" / (error.file if error else "compiled.py")
        right = place.read_text(encoding="utf-8")
        everything = error is not None and "@inlined" in right
        environment = os.environ | {
            "PYTHONPATH": str(self._folder),
            "NUMBA_CACHE_DIR": str(self._folder / ("once" if everything else "cache")),
            "PLANTED": "of-a-copy",
            "COLUMNS": "200",
        }
        try:
            if error is not None:
                place.write_text(planted_text(error), encoding="utf-8")
            return subprocess.run(
                [sys.executable, "-m", "flexlab", "validate", "--to", "report.html"],
                cwd=self._folder, env=environment, capture_output=True, text=True, encoding="utf-8", check=False,
                timeout=1200,
            )  # fmt: skip
        finally:
            place.write_text(right, encoding="utf-8")
            shutil.rmtree(self._folder / "once", ignore_errors=True)


if __name__ == "__main__":
    wanted = [each for each in PLANTED if not sys.argv[1:] or any(word in each.name for word in sys.argv[1:])]
    passed = 0
    with tempfile.TemporaryDirectory() as place:
        copy = Copy(Path(place))
        if copy.validate().returncode != 0:
            sys.exit("Without any error flexlab validate fails already.")
        for planted in wanted:
            done = copy.validate(planted)
            failed = [line.split("  ")[0] for line in done.stdout.splitlines() if line.rstrip().endswith("NO")]
            passed += not failed  # An error that does not compile proves nothing.
            print(f"{planted.name}: exit {done.returncode}, {len(failed)} statements fail: {failed[:2]}", flush=True)
    sys.exit(f"{passed} of {len(wanted)} errors pass unnoticed." if passed else 0)
