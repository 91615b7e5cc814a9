"""A controller that acts at fixed instants: it measures with noise, computes joint torques and holds them.

The torques computed at one instant take effect `delay` instants later. Until the first ones do, the motors are off, or hold
what a continuous controller asked for last. The controller's state (b̂) advances by explicit Euler, as in a digital controller.
"""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import call_whole_kernel, compiled, inlined, pluggable, whole_address
from flexlab.control.law_kernels import control_law, feed_forward_bending
from flexlab.control.motion import desired_motion
from flexlab.numerics.elementary import cos, log
from flexlab.physics.arm import arm_velocity_terms, joint_torques
from flexlab.physics.dynamics import configure_arms
from flexlab.physics.grips import place_rigidly
from flexlab.physics.joints import compensate_friction
from flexlab.physics.mass_change import believed_mass, find_mass
from flexlab.physics.plant import ETA, Plant, joints_start
from flexlab.physics.sensors import read_encoders
from flexlab.scenario import Scenario
from flexlab.sim.closed_loop import System, find_state, law_places, limit_torques, new_workspace, state_length


class LoopVariant(NamedTuple):
    """The kinds of plant for which kernels are compiled separately."""

    ideal_joints: bool = True
    mass_stays: bool = True
    rigid_grips: bool = True
    no_axial_load: bool = True
    """Also False for a plant with any other extension, whose loop then has the axial load too: that halves the variants."""


BEAM_CHANNEL, GAUGE_CHANNEL = 6, 8
"""First channels of random numbers for hᵀq̇, gᵀq̇ and for the strain gauges; earlier ones are for pose and pose rate."""
NEVER_ACTS = 1 << 40
"""`Sampling.steps` of a law that does not act, as torques come from outside."""


class Sampling(NamedTuple):
    """Constants and memory of sampled control."""

    period: float
    """T_c, s."""
    steps: int
    """Integration steps per control period."""
    delay: int
    """Input delay in samples."""
    noise: np.ndarray
    """Standard deviations of pose, pose rate and of hᵀq̇, gᵀq̇, (8,)."""
    gauge_noise: np.ndarray
    """What a unit change of each strain gauge's noise between two readings adds to the measured hᵀq̇ and gᵀq̇, kg·m/s and
    kg·m²/s, (2, gauges); no gauges without strain noise."""
    strain: np.ndarray
    """Strain -½ t w''(s_j) at each of the law's gauges per modal coordinate, 1/(m·kg^½), (gauges, n_m)."""
    strain_noise: float
    """Standard deviation of each gauge's reading, 1."""
    seed: int
    line: np.ndarray
    """Torques on their way, oldest first, N·m, (delay + 1, arms, 3)."""
    kernel: int = 0
    """Address of `control_instant`; 0 for continuous control, which starts without compiling it."""


def with_kernel(sampling: Sampling, system: System) -> Sampling:
    """The sampling with the address of its kernel."""

    def arguments():
        return system, sampling, 0, 0.0, np.zeros(state_length(system)), new_workspace(system)

    return sampling._replace(kernel=whole_address(control_instant, arguments, loop_variant(system.plant)))


def loop_variant(plant: Plant) -> LoopVariant:
    """The variant of the loop that a plant needs."""
    return LoopVariant(plant.joints is None, plant.mass_change is None, plant.grips is None, plant.axial is None)


def variant_of(scenario: Scenario) -> LoopVariant:
    """The variant of the loop that a scenario's plant needs."""
    extensions = scenario.joints, scenario.payload.mass_change, scenario.grips
    absent = [not extension.active for extension in extensions]
    return LoopVariant(*absent, no_axial_load=all(absent) and scenario.payload.axial_load == "none")


@inlined
def mix(z):
    """One round of the splitmix64 generator (Steele, Lea & Flood 2014): a well-mixed 64-bit number from a counter."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@compiled
def gaussian(seed, instant, channel):
    """A standard normal number that depends on its three whole-number arguments only, so that a replay draws the same."""
    key = mix(np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(instant))
    first = mix(key + np.uint64(2 * channel + 1) * np.uint64(0x9E3779B97F4A7C15))
    second = mix(key + np.uint64(2 * channel + 2) * np.uint64(0x9E3779B97F4A7C15))
    scale = 1.0 / 9007199254740992.0
    radius = np.sqrt(-2 * log((np.float64(first >> np.uint64(11)) + 0.5) * scale))
    return radius * cos(2 * np.pi * np.float64(second >> np.uint64(11)) * scale)


@inlined
def measure_pose(plant, sampling, instant, pose, rate, y, ws, now):
    """Fill now.x and now.v with encoder readings and noise at the true pose and pose rate (3,), after `configure_arms`."""
    for a in range(3):
        now.x[a], now.v[a] = pose[a], rate[a]
    read_encoders(plant.joints, plant.grips, plant.arms, sampling.period, y[joints_start(plant) :], ws, now)
    for a in range(3):
        now.x[a] += sampling.noise[a] * gaussian(sampling.seed, instant, a)
        now.v[a] += sampling.noise[3 + a] * gaussian(sampling.seed, instant, 3 + a)


@inlined
def measure_beam(sampling, instant, truth, measured):
    """Fill hᵀq̇ and gᵀq̇ (2,), with their own noise and that of strain gauges, whose readings are differenced.

    A reading is -½ t w''(s_j) plus white noise σ_ε. The moments hᵀq = Σ W_hj · reading_j (`physics.sensors`), differenced over
    T_c, have the noise Σ W_hj (n_j(k) - n_j(k-1)) / T_c. Its standard deviation is √2 σ_ε ‖W_h‖ / T_c, kg·m/s, and it is
    anticorrelated from one instant to the next, since each reading enters twice. Only the noise is modelled; the readings' own
    lag of half a control period is not, so that without noise the law sees the true rates.
    """
    for a in range(2):
        channel = BEAM_CHANNEL + a
        measured[a] = truth[a] + sampling.noise[channel] * gaussian(sampling.seed, instant, channel)
    for j in range(sampling.gauge_noise.shape[1]):
        channel = GAUGE_CHANNEL + j
        change = gaussian(sampling.seed, instant + 1, channel) - gaussian(sampling.seed, instant, channel)
        measured[0] += sampling.gauge_noise[0, j] * change
        measured[1] += sampling.gauge_noise[1, j] * change


@inlined
def noisy_strain(sampling, instant, gauge, strain):
    """The reading of a gauge at this strain."""
    if sampling.strain_noise > 0:
        return strain + sampling.strain_noise * gaussian(sampling.seed, instant + 1, GAUGE_CHANNEL + gauge)
    return strain


@inlined
def read_gauges(sampling, instant, eta, now):
    """Fill now.strain for modal coordinates η (n_m,), each gauge with the noise that `measure_beam` differences."""
    now.gauge_count = len(sampling.strain)
    for j in range(len(sampling.strain)):
        total = 0.0
        for k in range(len(eta)):
            total += sampling.strain[j, k] * eta[k]
        now.strain[j] = noisy_strain(sampling, instant, j, total)


@inlined
def note_torques(sampling, arm_count, now):
    """Fill now.torque with the torques held until now and those under way."""
    now.delay = sampling.delay
    for place in range(sampling.delay + 1):
        for i in range(arm_count):
            for joint in range(3):
                now.torque[place, i, joint] = sampling.line[place, i, joint]


@inlined
def answer(system, sampling, t, y, ws):
    """Run the law on the measurements in `ws.measured`, queue its torques and hold those that are due; returns a fault code."""
    plant, control, now = system.plant, system.control, ws.measured[0]
    x, v = now.x, now.v
    note_torques(sampling, len(plant.arms), now)
    code = configure_arms(plant, x, ws.measured_arm, ws.fault)
    if code != 0:
        return code
    c, s = ws.measured_arm.trig[0], ws.measured_arm.trig[1]
    for i in range(len(plant.arms)):
        arm_velocity_terms(
            plant.arms[i],
            c,
            s,
            v[0],
            v[1],
            v[2],
            ws.measured_arm.J[i],
            ws.measured_arm.direction[i],
            ws.measured_arm.C[i],
        )
    desired_motion(system.trajectory, t, ws.desired)
    ws.desired_time[0] = t
    desired_motion(system.trajectory, t + sampling.delay * sampling.period, now.coming)
    start, end = law_places(system)
    memory = y[start:end]
    now.time = t
    mass = believed_mass(plant.mass_change, control.payload.change, ws)
    control_law(control, plant.gravity, mass, x, v, now.beam_rate, ws.desired, now, memory, ws.memory_rate, y[end:])
    if control.drives:
        if system.trajectory.bending != 0:
            feed_forward_bending(system.trajectory.bending, now)
        compensate_friction(plant.joints, plant.arms, ws.measured_arm, v[0], v[1], v[2], now.u, ws.tau)
    for a in range(control.memory_size):
        memory[a] += sampling.period * ws.memory_rate[a]
    for i in range(len(plant.arms)):
        joint_torques(plant.arms[i], c, s, ws.measured_arm.direction[i], now.u[i], ws.tau)
        limit_torques(control.torque_limit, ws.tau)
        for joint in range(3):
            for place in range(sampling.delay):
                sampling.line[place, i, joint] = sampling.line[place + 1, i, joint]
            sampling.line[sampling.delay, i, joint] = ws.tau[joint]
            system.held_torque[i, joint] = sampling.line[0, i, joint]
    return code


@inlined
def _measure(grips, plant, sampling, instant, y, ws, now):
    """`measure_pose` of the pose that the controller measures, which compliant grips may shift."""
    if grips is None:
        measure_pose(plant, sampling, instant, y, ws.velocity, y, ws, now)
    else:
        measure_pose(plant, sampling, instant, ws.grips.measured[0], ws.grips.measured[1], y, ws, now)


@pluggable
def control_instant(system, sampling, instant, t, y, ws):
    """Measure, run the law, queue its torques and hold those that are due; returns a fault code."""
    code = find_state(system, t, y, ws)
    if code != 0:
        return code
    now = ws.measured[0]
    _measure(system.plant.grips, system.plant, sampling, instant, y, ws, now)
    measure_beam(sampling, instant, ws.beam_rate, now.beam_rate)
    read_gauges(sampling, instant, y[ETA : ETA + system.plant.modal.shape[1]], now)
    return answer(system, sampling, t, y, ws)


@compiled
def answer_sensors(system, sampling, instant, t, sensors, y, ws):
    """As `control_instant`, for a plant simulated elsewhere; `sensors`: pose, pose rate, hᵀq̇, gᵀq̇ and strains, (8 + gauges,).

    Of y, only the controller's state, the law's signals and the last encoder reading are used.
    """
    now = ws.measured[0]
    find_mass(system.plant.mass_change, t, ws)
    code = configure_arms(system.plant, sensors[0:3], ws.arm, ws.fault)
    if code != 0:
        return code
    place_rigidly(system.plant.grips, sensors[0:3], ws)
    measure_pose(system.plant, sampling, instant, sensors[0:3], sensors[3:6], y, ws, now)
    measure_beam(sampling, instant, sensors[6:8], now.beam_rate)
    now.gauge_count = len(sampling.strain)
    for j in range(len(sampling.strain)):
        now.strain[j] = noisy_strain(sampling, instant, j, sensors[8 + j])
    return answer(system, sampling, t, y, ws)


@inlined
def act_at_instant(system, sampling, instant, t, y, ws):
    """Call `control_instant` by its address."""
    return call_whole_kernel(sampling.kernel, (system, sampling, instant, t, y, ws))
