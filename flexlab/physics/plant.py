"""Arms and flexible payload together, in modal coordinates and Hamiltonian form (Eqs. (8) to (16)).

State `y` of n_m modes, in this order: pose x (3), its momentum P = ∂T/∂ẋ (3), work done on the system, energy dissipated, work
of the axial load, modal coordinates η (n_m), their momenta π = ∂T/∂η̇ (n_m), the algorithmic accelerations of generalized-alpha
(3 + n_m), the joints' states (`joints`, none for ideal ones), the energy of added material (`mass_change`, none for a constant
mass), the arms' own poses and rates (`grips`, none for rigid ones), the controller's state (any length), and the law's own
signals as it last gave them (any number). With e1, e2 the axes of the virtual link, v = (ẋ0, ẏ0), v1 = v·e1, v2 = v·e2, ω = θ̇:

    π = η̇ + h v2 + g ω            P = S ẋ + A12 π,   S = M̄1 + M̄2 + A11 - A12 A21   (Schur complement, 3 x 3)
    π̇ = -Ω²η - Dη̇ + ω²η - K_G η - h (ω v1 + gravity cos θ)      (K_G: `axial_load`, none of the paper's beam)
    Ṗ = Σ(u_i - Ḡ_i + C̄_iᵀẋ) + ∂(T - U)/∂x of the payload      (as Ṁ_i = C̄_i + C̄_iᵀ)

Ṗ is Eq. (9) and π̇ Eq. (18) in momenta. The elastic potential depends on η alone, so the stiff part of the beam is linear in
(η, π) and can be propagated exactly. h, g, D stand for their modal forms Vᵀh, Vᵀg, VᵀDV; A22 = 1.
"""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import inlined
from flexlab.physics.arm import ArmTerms
from flexlab.physics.grips import Grips, GripScratch, grip_scratch, grip_states
from flexlab.physics.law_input import make_law_input
from flexlab.physics.mass_change import MassChange, mass_states

X, P, WORK, DISSIPATED, AXIAL_WORK, ETA = 0, 3, 6, 7, 8, 9
"""First indices of the parts of the state y; π follows η."""


class Joints(NamedTuple):
    """Joints that are not ideal (`joints`)."""

    numbers: np.ndarray
    """Constants by joint, rows as `joints` names them, (8, 3)."""
    size: int
    """Number of their states in y."""
    has_friction: bool
    """Whether there is friction."""
    count: np.ndarray
    """Angle of one count of each encoder, rad; 0: exact, (3,)."""
    reading: int
    """Index among the states of the last encoder reading of the pose, (3,); -1: there are no encoders."""
    has_motors: bool
    """Whether motors may give another torque than they are asked for."""
    lag_rate: float
    """1/T_m, 1/s; 0: no lag."""
    torque: int
    """Index among the states of the motors' torques, N·m, (arms · 3,); -1: no lag."""


@inlined
def joint_states(joints):
    """Number of the joints' states in y; 0 for ideal ones, a constant at compile time."""
    if joints is None:
        return 0
    return joints.size


@inlined
def has_axial_load(axial):
    """Whether an axial force acts on the beam. `axial`: `Plant.axial`."""
    if axial is None:
        return False
    return axial.shape[1] > 0


@inlined
def joints_start(plant):
    """Index in y of the joints' states."""
    return ETA + 3 * plant.modal.shape[1] + 3


@inlined
def material_start(plant):
    """Index in y of the energy of added material, J."""
    return joints_start(plant) + joint_states(plant.joints)


@inlined
def grips_start(plant):
    """Index in y of the grips' states."""
    return material_start(plant) + mass_states(plant.mass_change)


@inlined
def memory_start(plant):
    """Index in y of the controller's state."""
    return grips_start(plant) + grip_states(plant.grips)


H, G, DH, DG, OMEGA2, MID, BEND, PULL, AXIAL, FOLLOWED = range(10)
"""Rows of `Plant.modal`: Vᵀh, Vᵀg, DVᵀh, DVᵀg, ω², shape at mid-span N(0)V, shape where the beam bends
most (mid-span or the free end), shape at the pulled point N(s)V, whether the mode is part of `Plant.axial`, and the first four
again, zero for modes that the axial load does not follow (`axial_load`)."""
ON_BEAM = -1.0
"""`Hand.arm` of a hand that holds the beam."""


class Hand(NamedTuple):
    """A hand's spring, in the order of `Plant.pull`."""

    position: float
    """The point that it holds, m: the material coordinate s on the beam, or the distance from a link's inner joint."""
    target_x: float
    """x of the hand, m."""
    target_y: float
    """y of the hand, m."""
    stiffness: float
    """Stiffness of the spring, N/m; 0: no hand pulls."""
    arm: float
    """The arm that it holds, from 0; below 0: it holds the beam."""
    link: float
    """The link that it holds, from 0."""


NO_HAND = Hand(0.0, 0.0, 0.0, 0.0, ON_BEAM, 0.0)


@inlined
def hand_of(pull):
    """The `Hand` that `Plant.pull` holds."""
    return Hand(pull[0], pull[1], pull[2], pull[3], pull[4], pull[5])


class Plant(NamedTuple):
    """Constants of one system; n_m modes, n_q nodal coordinates."""

    arms: np.ndarray
    """`arm.ARM` records, (arms,)."""
    m: float
    """Payload mass, kg."""
    I: float  # noqa: E741
    """Payload inertia about its middle, kg·m²."""
    gravity: float
    """Gravity along -y, m/s²."""
    modal: np.ndarray
    """Constants of the modes, (13, n_m), rows as named above."""
    damping: np.ndarray
    """Modal damping D, dense within its blocks, (n_m, n_m)."""
    block_start: np.ndarray
    """First modes of the blocks, as in `beam.BeamModes`, (blocks + 1,)."""
    kappa: np.ndarray
    """hᵀh, hᵀg, gᵀg over the kept modes: A12 A21 in the frame of the virtual link, (3,)."""
    shapes: np.ndarray
    """Vᵀ: the nodal coordinates of each mode, (n_m, n_q)."""
    compliance: np.ndarray
    """Mid-span deflection per unit of lateral and of angular acceleration, -N(0)K_F⁻¹h and -N(0)K_F⁻¹g, (2,).

    Over all modes of the mesh, however few are kept.
    """
    pull: np.ndarray
    """A `Hand`, which commands change in place, (6,)."""
    length: float
    """L, m."""
    buckling_load: float
    """P_cr, N."""
    axial: np.ndarray | None
    """VᵀGV of `axial_load` in the n_f modes to which it is applied, (4, n_f, n_f): G0, G1, G2, and G_F, which commands change in
    place. None: the paper's plant, without axial load and the parts below; (4, 0, 0): no axial load, but some of those parts."""
    joints: Joints | None
    """None: ideal joints."""
    mass_change: MassChange | None
    """None: constant mass."""
    grips: Grips | None
    """None: rigid grips."""

    @property
    def joint_size(self) -> int:
        """Number of the joints' states in y."""
        return 0 if self.joints is None else self.joints.size

    @property
    def own_size(self) -> int:
        """Number of the joints', the material's and the grips' states in y."""
        return self.joint_size + (self.mass_change is not None) + (0 if self.grips is None else self.grips.size)


class Workspace(NamedTuple):
    """Scratch memory of the kernels, so that no step allocates."""

    truth: np.ndarray
    """`LAW_INPUT` at the true state, (1,)."""
    measured: np.ndarray
    """`LAW_INPUT` at what a sampled controller measures, (1,)."""
    arm: ArmTerms
    """Arm terms at the true state: views of `truth`."""
    measured_arm: ArmTerms
    """Arm terms at the pose that a sampled controller measures: views of `measured`."""
    u: np.ndarray
    """Arm inputs, (arms, 3): a view of `truth`."""
    u_before: np.ndarray
    """Arm inputs at the last stage of an etdrk4 step, before a control instant or a discontinuity changed them, (arms, 3)."""
    hand: np.ndarray
    """What a hand on a link adds to the arm's input, 𝒥-transformed as u is, (arms, 3)."""
    tau: np.ndarray
    """Joint torques of one arm, (3,)."""
    velocity: np.ndarray
    """Pose rate ẋ, (3,)."""
    momentum: np.ndarray
    """Scratch for P - A12 π and other 3-vectors, (3,)."""
    S: np.ndarray
    """Schur complement, (3, 3)."""
    eta_dot: np.ndarray
    """Modal rates η̇, (n_m,)."""
    damping_force: np.ndarray
    """Dη̇, (n_m,)."""
    axial: np.ndarray
    """N_L, a₁, ω² and F₁ of `axial_load`, (4,)."""
    axial_force: np.ndarray
    """K_G η, (5, n_m), rows as `axial_load` names them."""
    axial_inertia: np.ndarray
    """Scratch of `predict_acceleration`, (3, 3)."""
    axial_acceleration: np.ndarray
    """ẍ that `predict_acceleration` found, (3,)."""
    restoring: np.ndarray
    """Restoring force -(η̈ + A21 ẍ), (n_m,)."""
    desired: np.ndarray
    """x_d, ẋ_d, ẍ_d, (3, 3)."""
    desired_time: np.ndarray
    """The instant of `desired`, s, (1,): stages share instants, and a sine costs as much as an arm."""
    w_bar: np.ndarray
    """w̄ = hᵀq, (1,)."""
    beam_rate: np.ndarray
    """hᵀq̇, gᵀq̇, (2,)."""
    joint_torque: np.ndarray
    """Torques τ of the motors, if joints are not ideal, N·m, (arms, 3)."""
    joint_command: np.ndarray
    """Torques that the controller asks of the motors, N·m, (arms, 3)."""
    joint_feasible: np.ndarray
    """Commanded torques, limited to what the motors can give at their speed, N·m, (arms, 3)."""
    joint_friction: np.ndarray
    """Friction τ_f of the joints, N·m, (arms, 3)."""
    joint_rate: np.ndarray
    """Rates of the joints' states, (own_size,)."""
    mass_factor: np.ndarray
    """s and ṡ of `mass_change` at the instant of the last `find_mass`, 1 and 1/s, (2,)."""
    grips: GripScratch
    """Quantities of compliant grips, with which `arm` holds each arm's terms at its own pose, except `trig`."""
    memory_rate: np.ndarray
    """Rates of the controller's state, of the same length."""
    fault: np.ndarray
    """Index of the arm at fault, (1,)."""
    stage: np.ndarray
    """Stage states and derivatives of the integrators, (11, len(y))."""
    interrupt: np.ndarray
    """Set by another thread to make the kernels return early, (1,)."""


def state_size(mode_count: int, memory_size: int = 3, signal_count: int = 0, own_size: int = 0) -> int:
    """Length of y; `own_size`: `Plant.own_size`."""
    return ETA + 3 * mode_count + 3 + own_size + memory_size + signal_count


def noted_rates(y: np.ndarray, mode_count: int) -> np.ndarray:
    """The true η̇ that an integrator noted in y, (n_m,); NaN: none."""
    return y[ETA + 2 * mode_count + 3 : ETA + 3 * mode_count + 3]


def forget_rates(y: np.ndarray, mode_count: int) -> None:
    """Void the rates and accelerations that integrators noted in y: they are wrong after a jump."""
    y[ETA + 2 * mode_count : ETA + 3 * mode_count + 3] = np.nan


def make_workspace(
    arm_count: int, mode_count: int, memory_size: int = 3, signal_count: int = 0, own_size: int = 0
) -> Workspace:
    """Scratch memory for these numbers of arms and modes, and sizes of the law's memory and signals.

    `own_size`: `Plant.own_size`.
    """
    truth, measured = make_law_input(arm_count), make_law_input(arm_count)

    def terms(record: np.ndarray) -> ArmTerms:
        plain = record.view(np.ndarray)  # whose fields are found ten times faster
        per_arm = (plain[name][0, :arm_count] for name in ("M", "C", "G", "J", "direction"))
        return ArmTerms(*per_arm, plain["trig"][0])

    return Workspace(
        truth=truth,
        measured=measured,
        arm=terms(truth),
        measured_arm=terms(measured),
        u=truth.view(np.ndarray)["u"][0, :arm_count],
        u_before=np.zeros((arm_count, 3)),
        hand=np.zeros((arm_count, 3)),
        tau=np.zeros(3),
        velocity=np.zeros(3),
        momentum=np.zeros(3),
        S=np.zeros((3, 3)),
        eta_dot=np.zeros(mode_count),
        damping_force=np.zeros(mode_count),
        axial=np.zeros(4),
        axial_force=np.zeros((5, mode_count)),
        axial_inertia=np.zeros((3, 3)),
        axial_acceleration=np.zeros(3),
        restoring=np.zeros(mode_count),
        desired=np.zeros((3, 3)),
        desired_time=np.full(1, np.nan),
        w_bar=np.zeros(1),
        beam_rate=np.zeros(2),
        joint_torque=np.zeros((arm_count, 3)),
        joint_command=np.zeros((arm_count, 3)),
        joint_feasible=np.zeros((arm_count, 3)),
        joint_friction=np.zeros((arm_count, 3)),
        joint_rate=np.zeros(own_size),
        mass_factor=np.full(2, np.nan),
        grips=grip_scratch(arm_count, measured.view(np.ndarray)["u"][0, :arm_count]),
        memory_rate=np.zeros(memory_size),
        fault=np.zeros(1, np.int64),
        stage=np.zeros((11, state_size(mode_count, memory_size, signal_count, own_size))),
        interrupt=np.zeros(1, np.int64),
    )
