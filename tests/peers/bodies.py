"""The paper's system as rigid bodies, springs and dampers, which any multibody engine can simulate.

Both last links keep the angle of the virtual link, so the three are one body, here called the carrier; each arm then has
two links of its own, hinged to ground, to each other and to the carrier. Mode k of the pinned beam acts on the carrier
only through Vᵀh and Vᵀg: a symmetric mode (g_k = 0) is exactly a mass h_k² that slides across the carrier by η/h_k, an
antisymmetric one (h_k = 0) a rotor of inertia g_k² that turns by η/g_k. The rest of the payload's m and I belongs to
the carrier. Only the antisymmetric modes' part of ηᵀη in A_θθ is missing, 1e-9 of the payload's inertia here. This is
the smallest model with this motion: a chain of segments (`simulate_chain`) needs more unknowns and smaller steps.
"""

from dataclasses import dataclass

import numpy as np

from flexlab.compiled import compiled
from flexlab.control.law_kernels import control_law
from flexlab.control.motion import desired_motion
from flexlab.physics.arm import arm_velocity_terms, joint_torques
from flexlab.physics.dynamics import configure_arms
from flexlab.scenario import Scenario
from flexlab.scenario.payload import NodalDamping
from flexlab.sim.build import build_beam

COUPLED = 1e-9
"""Where h_k is below this share of the largest, it is a rounding error, and mode k is antisymmetric."""


@dataclass(frozen=True)
class Body:
    """A rigid body."""

    mass: float
    """kg."""
    inertia: float
    """Moment of inertia about the centre of mass, kg·m²."""
    center: float
    """Distance of the centre of mass from the first joint, along the body, m."""


@dataclass(frozen=True)
class ModeBody:
    """A beam mode as a body that slides across the carrier's middle (symmetric mode) or turns about it (antisymmetric)."""

    slides: bool
    inertia: float
    """kg if it slides, kg·m² if it turns."""
    stiffness: float
    """N/m or N·m/rad."""
    scale: float
    """h_k or g_k: η per unit of the body's coordinate (m or rad)."""


@dataclass(frozen=True)
class Bodies:
    """All bodies of a pinned-pinned scenario with two equal arms."""

    links: tuple[Body, Body]
    """First and second link of each arm."""
    link_length: tuple[float, float]
    """m."""
    carrier: Body
    """The carrier, from the left wrist to the right one."""
    middle: float
    """Distance of either wrist from the payload's origin, m."""
    modes: tuple[ModeBody, ...]
    """The modes, sliding ones first."""
    shape: np.ndarray
    """Nodal beam coordinates per unit of each mode body's coordinate, (n_q, modes)."""
    midspan: np.ndarray
    """Mid-span deflection per unit of each mode body's coordinate, m, (modes,)."""
    nodal_damping: float
    """Viscous damping on every nodal rate, N·s/m and N·m·s/rad."""
    bases: tuple[tuple[float, float], ...]
    """m."""

    @property
    def damping(self) -> np.ndarray:
        """Damping matrix over the mode bodies' coordinates, (modes, modes)."""
        return self.nodal_damping * self.shape.T @ self.shape


def make_bodies(scenario: Scenario) -> Bodies:
    """The bodies of a scenario like the paper's: pinned-pinned, nodal damping, two arms with the same links."""
    arm, beam, damping = scenario.left_arm, build_beam(scenario.payload), scenario.payload.damping
    assert isinstance(damping, NodalDamping)
    V, omega = beam.modes.V, beam.modes.omega
    h, g = V.T @ beam.matrices.h, V.T @ beam.matrices.g
    slides = np.abs(h) > COUPLED * np.max(np.abs(h))
    order = [*np.flatnonzero(slides), *np.flatnonzero(~slides)]
    scale = np.where(slides, h, g)[order]
    middle = arm.link_length[2] + scenario.payload.length / 2
    shape = V[:, order] * scale
    return Bodies(
        links=(_link(scenario, 0), _link(scenario, 1)),
        link_length=arm.link_length[:2],
        carrier=_carrier(scenario, middle, h[slides], g[~slides]),
        middle=middle,
        modes=tuple(
            ModeBody(bool(slides[k]), float(s * s), float((s * omega[k]) ** 2), float(s))
            for k, s in zip(order, scale, strict=True)
        ),
        shape=shape,
        # An even number of elements has a node at mid-span, whose deflection is the first row after the left half.
        midspan=shape[2 * (scenario.payload.element_count // 2) - 1],
        nodal_damping=damping.coefficient,
        bases=tuple(each.base for each in scenario.arms),
    )


def _link(scenario: Scenario, number: int) -> Body:
    arm = scenario.left_arm
    return Body(arm.link_mass[number], arm.inertia[number], arm.link_center[number])


def _carrier(scenario: Scenario, middle: float, h: np.ndarray, g: np.ndarray) -> Body:
    """Both last links with the part of the payload that no mode moves."""
    payload, links = scenario.payload, bare_carrier(scenario)
    m, inertia = payload.linear_density * payload.length, payload.linear_density * payload.length**3 / 12
    return Body(m - float(h @ h) + links.mass, inertia - float(g @ g) + links.inertia, middle)


def bare_carrier(scenario: Scenario) -> Body:
    """Both last links as one body, without the payload."""
    wrist, middle = _link(scenario, 2), scenario.left_arm.link_length[2] + scenario.payload.length / 2
    return Body(2 * wrist.mass, 2 * (wrist.inertia + wrist.mass * (middle - wrist.center) ** 2), middle)


@dataclass(frozen=True)
class Motion:
    """A simulated motion at the ticks after t = 0, and its cost."""

    pose: np.ndarray
    """x0, y0, θ, m, m, rad, (N, 3)."""
    deflection: np.ndarray
    """w(0, t), m, (N,)."""
    cpu: float
    """Processor time of the simulation without set-up and compiling, s."""


@compiled
def joint_torque_law(system, t, x, v, memory, ws, tau):
    """Fill joint torques tau (arms, 3), N·m, and memory rates ws.memory_rate at pose x (3,) and pose rate v (3,).

    Returns a fault code of `physics.arm`.
    """
    plant = system.plant
    code = configure_arms(plant, x, ws.arm, ws.fault)
    if code != 0:
        return code
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    for i in range(len(plant.arms)):
        arm_velocity_terms(plant.arms[i], c, s, v[0], v[1], v[2], ws.arm.J[i], ws.arm.direction[i], ws.arm.C[i])
    desired_motion(system.trajectory, t, ws.desired)
    # The other engines keep the law's memory but not its signals, for which they pass an empty vector.
    control_law(
        system.control,
        plant.gravity,
        (1.0, 0.0),
        x,
        v,
        ws.beam_rate,
        ws.desired,
        ws.truth[0],
        memory,
        ws.memory_rate,
        memory[:0],
    )
    for i in range(len(plant.arms)):
        joint_torques(plant.arms[i], c, s, ws.arm.direction[i], ws.u[i], tau[i])
    return code
