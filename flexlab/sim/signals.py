"""The one table of signals: every row is a field of `Signals`, and `write_sample` below computes what is simulated.

Row layout, arrays with their documentation, export columns, recordings and empty runs follow from the table. A signal that
follows from others is one more `@derived` property; one that is simulated is one more row, and its line in `write_sample`.
A control law adds signals of its own, which its kernel writes (`control.law.Law.signals`).

A row of samples holds the signals of fixed size, then those of each arm, those of the beam's coordinates, and the law's own.
"""

from collections.abc import Mapping
from dataclasses import fields
from itertools import accumulate

import numpy as np

from flexlab.compiled import disjoint, inlined
from flexlab.control.law import law_of, laws
from flexlab.control.sliding_surface import sliding_variable
from flexlab.physics.arm import joint_angles
from flexlab.physics.axial_load import SPIN, axial_load_at, axial_terms, first_stiffness, largest_compression
from flexlab.physics.beam import quasi_static_deflection
from flexlab.physics.dynamics import acceleration
from flexlab.physics.energy import arms_kinetic_energy, elastic_energy, gravity_energy, kinetic_energy, spring_energy
from flexlab.physics.grips import PER_ARM as GRIP_STATES
from flexlab.physics.grips import own_pose
from flexlab.physics.internal_force import payload_force
from flexlab.physics.joints import LOSS, is_limited, motor_torques
from flexlab.physics.mass_change import mass_factor
from flexlab.physics.plant import (
    AXIAL_WORK,
    DISSIPATED,
    ETA,
    MID,
    WORK,
    grips_start,
    joints_start,
    material_start,
    memory_start,
)
from flexlab.scenario import Scenario
from flexlab.signal import ARM, AXIS, COORDINATE, JOINT, Signal, derived, numbered, row, table
from flexlab.sim.extension_signals import GRIP_SIGNALS, JOINT_SIGNALS, MATERIAL_SIGNALS, grip_signals, joint_signals

POSE_UNITS, RATE_UNITS, ACCELERATION_UNITS = ("m", "m", "rad"), ("m/s", "m/s", "rad/s"), ("m/s²", "m/s²", "rad/s²")
GAUGES = 4
"""Number of places at which the axial load is given."""
FORCE_UNITS = ("N", "N", "N·m")


@table
class Signals:
    """Signals of a run on N instants, of `arms` arms and n_q beam coordinates."""

    time: np.ndarray = row("t", "s", "exactly k · sample period")
    pose: np.ndarray = row("x", POSE_UNITS, "pose (x0, y0, θ) of the virtual link", AXIS, equation="Eq. (8)")
    pose_rate: np.ndarray = row("ẋ", RATE_UNITS, "pose rate", AXIS, equation="Eq. (8)")
    pose_acceleration: np.ndarray = row("ẍ", ACCELERATION_UNITS, "pose acceleration", AXIS, equation="Eq. (16)")
    desired_pose: np.ndarray = row("x_d", POSE_UNITS, "desired pose", AXIS, equation="Section IV")
    beam_coordinates: np.ndarray = row(
        "q", ("m", "rad"), "nodal deflections and slopes, left to right", COORDINATE, equation="Eq. (3)"
    )
    beam_rates: np.ndarray = row("q̇", ("m/s", "rad/s"), "their rates", COORDINATE, equation="Eq. (8)")
    tracking_error: np.ndarray = row("e", POSE_UNITS, "tracking error x - x_d", AXIS, equation="Section III")
    sliding_variable: np.ndarray = row("s", RATE_UNITS, "sliding variable ẋ - r", AXIS, equation="Section III")
    bound_estimates: np.ndarray = row(
        "b̂", ("N", "N/m", "N·s²/m²"), "what the law has learnt to bound", numbered(3), equation="Eq. (25)"
    )
    joint_angle: np.ndarray = row("θ_i", "rad", "relative joint angles", ARM, JOINT, equation="Eq. (11)")
    joint_torque: np.ndarray = row("τ_i", "N·m", "joint torques", ARM, JOINT, equation="Eq. (11)")
    arm_input: np.ndarray = row("u_i", FORCE_UNITS, "arm inputs 𝒥ᵀτ", ARM, AXIS, equation="Eq. (13)")
    internal_force: np.ndarray = row("F_i", FORCE_UNITS, "internal forces", ARM, AXIS, equation="Eqs. (13)-(15)")
    moving_force: np.ndarray = row(
        "f/arms", FORCE_UNITS, "each arm's equal share of what moves the payload", AXIS, equation="Eq. (14)"
    )
    midspan_deflection: np.ndarray = row("w(0, t)", "m", "deflection at mid-span", equation="Eq. (3)")
    quasi_static_deflection: np.ndarray = row(
        "w_qs",
        "m",
        "deflection at mid-span that the desired motion's acceleration and the weight would hold, of all modes of the mesh",
        equation="-N(0) K_F⁻¹ [h (e2_d·a_d + g cos θ_d) + g θ̈_d]",
        since=2,
    )
    kinetic_energy: np.ndarray = row("T", "J", "kinetic energy of arms and payload")
    elastic_energy: np.ndarray = row("½ qᵀ K_F q", "J", "elastic energy of the beam, and of grips that give way")
    gravity_energy: np.ndarray = row("U_g", "J", "potential energy of weight, zero at y = 0")
    input_work: np.ndarray = row("∫ P dt", "J", "work of motors and of pulls")
    dissipated_energy: np.ndarray = row("∫ q̇ᵀ D q̇ dt", "J", "energy that the beam's damping took", computed_since=4)
    axial_work: np.ndarray = row("-∫ q̇ᵀ K_G q dt", "J", "work of the axial load on the beam's bending", since=2)
    axial_load: np.ndarray = row(
        "N(s_j)",
        "N",
        "force along the beam at four places, left to right, tension positive: the gauges' places of `physics.sensors`",
        numbered(GAUGES),
        equation="N_L + ρ a₁ (s + L/2) + ½ρω²(L²/4 - s²)",
        since=2,
    )
    axial_load_share: np.ndarray = row(
        "-min N/P_cr", "1", "largest compression beside the beam's buckling load", equation="P_cr = c π²EI/L²", since=2
    )
    spin_share: np.ndarray = row(
        "ω²/ω₁²",
        "1",
        "what the spin takes of the linear beam's stiffness, of its first mode: at 1 none is left",
        since=2,
    )
    saturated: np.ndarray = row("sat", "1", "whether any joint torque stands at its limit, 1 or 0")

    @derived("w - w_qs", "m", since=2)
    def vibration(self) -> np.ndarray:
        """Deflection at mid-span less its quasi-static part: what can be driven to zero.

        A beam that is soft against the motion also answers its changes (forced, at the motion's own frequency): that part
        stays and is not a free ring.
        """
        return self.midspan_deflection - self.quasi_static_deflection

    @derived("T + ½ qᵀ K_F q + U_g", "J")
    def total_energy(self) -> np.ndarray:
        """Kinetic, elastic and gravity energy together."""
        return self.kinetic_energy + self.elastic_energy + self.gravity_energy


TABLE: Mapping[str, Signal] = {f.name: f.metadata["signal"](f.name) for f in fields(Signals)}
"""The signals that are simulated and recorded, by name, in the order of rows and files."""
DERIVED: Mapping[str, Signal] = {name: part.signal for name, part in vars(Signals).items() if isinstance(part, derived)}
"""The signals that follow from those, by name."""


def own_signals(scenario: Scenario) -> tuple[Signal, ...]:
    """The signals that the grips, the payload, the law and the joints of a scenario add to the table."""
    material = MATERIAL_SIGNALS if scenario.payload.mass_change.active else ()
    return (*grip_signals(scenario), *material, *law_of(scenario.controller).signals, *joint_signals(scenario))


def known_signals() -> Mapping[str, Signal]:
    """Every signal of the table and of any law, grips, joints and payload, by name."""
    of_laws = {signal.name: signal for law in laws().values() for signal in law.signals}
    others = (*JOINT_SIGNALS, *MATERIAL_SIGNALS, *GRIP_SIGNALS)
    return {**TABLE, **of_laws, **{signal.name: signal for signal in others}}


def _offsets(signals: list[Signal]) -> dict[str, int]:
    firsts = accumulate((signal.fixed_size for signal in signals), initial=0)
    return {signal.name: first for signal, first in zip(signals, firsts, strict=False)}


PER_SAMPLE = [signal for signal in TABLE.values() if not {ARM, COORDINATE} & set(signal.axes)]
OF_EACH_ARM = [signal for signal in TABLE.values() if ARM in signal.axes]
OF_THE_BEAM = [signal for signal in TABLE.values() if COORDINATE in signal.axes]
COLUMN: Mapping[str, int] = _offsets(PER_SAMPLE) | _offsets(OF_EACH_ARM)
"""First column of a signal in the row, or for signals of each arm in the arm's part of it."""
ARMS = sum(signal.fixed_size for signal in PER_SAMPLE)
"""First column of the arms."""
PER_ARM = sum(signal.fixed_size for signal in OF_EACH_ARM)
"""Columns of one arm."""

# Kernels know numbers, not mappings.
TIME, POSE, RATE, ACCELERATION = COLUMN["time"], COLUMN["pose"], COLUMN["pose_rate"], COLUMN["pose_acceleration"]
DESIRED, ERROR, SLIDING = COLUMN["desired_pose"], COLUMN["tracking_error"], COLUMN["sliding_variable"]
ESTIMATES, MOVING, SATURATED = COLUMN["bound_estimates"], COLUMN["moving_force"], COLUMN["saturated"]
ANGLE, TORQUE, INPUT, INTERNAL = (
    COLUMN[name] for name in ("joint_angle", "joint_torque", "arm_input", "internal_force")
)
MIDSPAN, QUASI_STATIC = COLUMN["midspan_deflection"], COLUMN["quasi_static_deflection"]
KINETIC, ELASTIC, GRAVITY = COLUMN["kinetic_energy"], COLUMN["elastic_energy"], COLUMN["gravity_energy"]
INPUT_WORK, DISSIPATION = COLUMN["input_work"], COLUMN["dissipated_energy"]
WORK_ALONG, LOAD = COLUMN["axial_work"], COLUMN["axial_load"]
LOAD_SHARE, SPIN_SHARE = COLUMN["axial_load_share"], COLUMN["spin_share"]
PLACES = (-0.25 * (1 + 3**-0.5), -0.25 * (1 - 3**-0.5), 0.25 * (1 - 3**-0.5), 0.25 * (1 + 3**-0.5))
"""s/L at which the axial load is given: `sensors.gauge_places`, to the last bit on every machine."""
AT_LIMIT = 1e-9
"""Relative distance from its limit at which a torque counts as saturated: the rounding error of turning τ into u and back."""


@inlined
def write_sample(system, t, y, beam_rate, ws, row):
    """Write the sample of state y at time t into `row`, after `rates` at the same instant; beam_rate (n_m,): η̇."""
    plant = system.plant
    x_ddot, factor = row[ACCELERATION : ACCELERATION + 3], mass_factor(plant.mass_change, ws)
    along = acceleration(plant, y, beam_rate, ws.w_bar[0], ws.beam_rate[0], ws.u, ws, x_ddot)
    row[TIME] = t
    estimates = memory_start(plant) + system.control.estimates
    sliding_variable(system.control.sliding_slope, y[0:3], ws.velocity, ws.desired, row[SLIDING : SLIDING + 3])
    for a in range(3):
        row[POSE + a], row[RATE + a] = y[a], ws.velocity[a]
        row[DESIRED + a], row[ERROR + a] = ws.desired[0, a], y[a] - ws.desired[0, a]
        row[ESTIMATES + a] = y[estimates + a] if system.control.estimates >= 0 else np.nan
    _write_arms(system, y, x_ddot, along, ws, row)
    row[QUASI_STATIC] = factor * quasi_static_deflection(plant.compliance, plant.gravity, ws.desired)
    row[KINETIC] = kinetic_energy(y, ws.velocity, ws.eta_dot, factor)
    row[ELASTIC] = elastic_energy(plant, y)
    row[GRAVITY] = gravity_energy(plant, y, ws.w_bar[0], factor, ws)
    row[INPUT_WORK], row[DISSIPATION], row[WORK_ALONG] = y[WORK], y[DISSIPATED], y[AXIAL_WORK]
    _write_beam(plant, y, beam_rate, row)
    own, first = memory_start(plant) + system.control.memory_size, len(row) - system.control.signal_count
    first -= _write_joints(plant.joints, y[joints_start(plant) :], ws, row)
    for k in range(system.control.signal_count):
        row[first + k] = y[own + k]
    first -= _write_material(plant.mass_change, plant, y, first, ws, row)
    _write_grips(plant.grips, y[grips_start(plant) :], first, ws, row)


@inlined
def _write_material(change, plant, y, end, ws, row):
    """Write the signals of a payload whose mass changes, up to column `end`; returns the number of columns."""
    if change is None:
        return 0
    row[end - 2], row[end - 1] = mass_factor(change, ws) * plant.m, y[material_start(plant)]
    return 2


@inlined
def _write_grips(grips, states, end, ws, row):
    """Write the signals of compliant grips, up to column `end`, and add the arms' and the springs' energies to the others."""
    if grips is None:
        return
    arm_count, stored = len(ws.grips.displacement), spring_energy(grips, ws)
    row[end - 2], row[end - 1] = stored, states[GRIP_STATES * arm_count]
    for i in range(arm_count):
        for a in range(3):
            row[end - 2 - 3 * (arm_count - i) + a] = ws.grips.displacement[i, a]
    row[KINETIC] += arms_kinetic_energy(ws)
    row[ELASTIC] += stored


@inlined
def _write_joints(joints, states, ws, row):
    """Write the joints' signals last, and add friction's loss to the work that reached the links; returns the column count."""
    if joints is None:
        return 0
    count, taken = ws.joint_friction.size, 0
    if joints.has_motors:
        taken = count
        for k in range(count):
            row[len(row) - taken + k] = ws.joint_command[k // 3, k % 3]
    if joints.has_friction:
        taken += count + 1
        first = len(row) - taken
        for k in range(count):
            row[first + k] = ws.joint_friction[k // 3, k % 3]
        row[first + count] = states[LOSS]
        row[INPUT_WORK] += states[LOSS]
    return taken


@inlined
def _write_arms(system, y, x_ddot, along, ws, row):
    """Write angles, torques, inputs and forces of the arms, and the axial load; `along`: F₁, N."""
    plant, moving, saturated = system.plant, row[MOVING : MOVING + 3], 0.0
    limit = system.control.torque_limit
    for a in range(3):
        moving[a] = 0.0
    for i in range(len(plant.arms)):
        arm = row[ARMS + PER_ARM * i : ARMS + PER_ARM * (i + 1)]
        tau, force = arm[TORQUE : TORQUE + 3], arm[INTERNAL : INTERNAL + 3]
        _, _, theta = own_pose(plant.grips, y, ws, i)
        joint_angles(theta, plant.arms[i], ws.arm.direction[i], arm[ANGLE : ANGLE + 3])
        motor_torques(plant.joints, plant.grips, plant.arms[i], i, ws, tau)
        payload_force(plant.grips, i, ws.u, x_ddot, ws, force)
        for a in range(3):
            arm[INPUT + a] = ws.u[i, a]
            moving[a] += force[a]
            most = (1 - AT_LIMIT) * limit[a]
            if abs(tau[a]) >= most or is_limited(plant.joints, i, a, most, ws):
                saturated = 1.0
    row[SATURATED] = saturated
    first = row[ARMS + INTERNAL : ARMS + INTERNAL + 3]
    _write_axial_load(plant, x_ddot, along, first, ws, row)
    for a in range(3):
        moving[a] /= len(plant.arms)
        for i in range(len(plant.arms)):
            row[ARMS + PER_ARM * i + INTERNAL + a] -= moving[a]


@inlined
def _write_axial_load(plant, x_ddot, along, grip, ws, row):
    """Write N at its places, and N and the spin relative to what the beam bears; grip (3,): `payload_force` of arm 0."""
    terms, factor = ws.axial, mass_factor(plant.mass_change, ws)
    axial_terms(plant, x_ddot, along, grip, ws, terms)
    for j in range(GAUGES):
        row[LOAD + j] = axial_load_at(plant, terms, factor, PLACES[j] * plant.length)
    row[LOAD_SHARE] = largest_compression(plant, terms, factor) / plant.buckling_load
    row[SPIN_SHARE] = factor * terms[SPIN] / first_stiffness(plant)


@inlined
def _write_beam(plant, y, beam_rate, row):
    """Write the mid-span deflection, q and q̇."""
    n, n_q = plant.shapes.shape
    middle = 0.0
    for k in range(n):
        middle += plant.modal[MID, k] * y[ETA + k]
    row[MIDSPAN] = middle
    first = ARMS + PER_ARM * len(plant.arms)
    _add_modes(plant.shapes, y[ETA : ETA + n], beam_rate, row[first : first + n_q], row[first + n_q : first + 2 * n_q])


@disjoint
def _add_modes(shapes, eta, eta_dot, q, rate):
    """Write q and q̇ (n_q,) for modal coordinates and rates (n_m,). Sums take four modes at a time, in their order."""
    n, n_q = shapes.shape
    for j in range(n_q):
        q[j] = rate[j] = 0.0
    k = 0
    while k + 4 <= n:
        s0, s1, s2, s3 = shapes[k], shapes[k + 1], shapes[k + 2], shapes[k + 3]
        a0, a1, a2, a3 = eta[k], eta[k + 1], eta[k + 2], eta[k + 3]
        b0, b1, b2, b3 = eta_dot[k], eta_dot[k + 1], eta_dot[k + 2], eta_dot[k + 3]
        for j in range(n_q):
            q[j] = (((q[j] + a0 * s0[j]) + a1 * s1[j]) + a2 * s2[j]) + a3 * s3[j]
            rate[j] = (((rate[j] + b0 * s0[j]) + b1 * s1[j]) + b2 * s2[j]) + b3 * s3[j]
        k += 4
    while k < n:
        for j in range(n_q):
            q[j] += eta[k] * shapes[k, j]
            rate[j] += eta_dot[k] * shapes[k, j]
        k += 1
