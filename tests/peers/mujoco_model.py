"""The paper's system in MuJoCo, with the beam's modes (`simulate_mujoco`) or with a chain of rods (`simulate_chain`).

In joint coordinates: the left arm holds the carrier with the beam's modes, the right arm has two links, and a `connect`
equality joins its wrist to the carrier's. MuJoCo's equalities give way a little; here they are as stiff as it allows.
The loop around its C functions is compiled, so that no time is lost in Python. Its own Runge-Kutta method cannot
integrate the controller's memory, so the same formulas are applied from outside, with `mj_forward` four times per step.

The chain has N rods of length l = L/N, hinged to each other, with a spring EI/l and a damper β EI/l in each of the N - 1
inner hinges. Its first end is hinged to the left gripper, its last is held to the right one by a `connect` equality. Rods
do not stretch, while the model's beam keeps its length along the chord to first order, so the first pin slides along the
chord, by some micrometres. Both grippers keep the angle of the chord, so they are one body, as in `bodies`.
The controller of the chain is digital: its torques are held for a tick.
"""

import ctypes
import time
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np

from flexlab.errors import StudyError
from flexlab.physics.plant import make_workspace
from flexlab.scenario import Scenario
from flexlab.scenario.payload import NodalDamping, StiffnessDamping
from flexlab.sim.world import World
from peers.bodies import Bodies, Body, Motion, bare_carrier, joint_torque_law, make_bodies


@numba.njit(error_model="numpy")
def set_torques(system, ws, geometry, t, position, velocity, memory, force, tau, motion):
    """Fill `force`, the generalized forces of all joints, by the law; motion: scratch (2, 3), row 0 becomes the pose.

    geometry: both link lengths, distance from wrist to payload's origin, x and y of the left arm's base, m, (5,).
    """
    first = position[0]
    second = first + position[1]
    theta = second + position[2]
    first_rate, second_rate = velocity[0], velocity[0] + velocity[1]
    l1, l2, middle = geometry[0], geometry[1], geometry[2]
    x, v = motion[0], motion[1]
    v[2] = second_rate + velocity[2]
    x[0] = geometry[3] + l1 * np.cos(first) + l2 * np.cos(second) + middle * np.cos(theta)
    x[1] = geometry[4] + l1 * np.sin(first) + l2 * np.sin(second) + middle * np.sin(theta)
    x[2] = theta
    v[0] = -l1 * np.sin(first) * first_rate - l2 * np.sin(second) * second_rate - middle * np.sin(theta) * v[2]
    v[1] = l1 * np.cos(first) * first_rate + l2 * np.cos(second) * second_rate + middle * np.cos(theta) * v[2]
    code = joint_torque_law(system, t, x, v, memory, ws, tau)
    # The right arm's third joint acts between its second link and the carrier, which is the end of the left arm.
    wrist, right = tau[1, 2], len(force) - 2
    for joint in range(3):
        force[joint] = tau[0, joint] + wrist
    force[right], force[right + 1] = tau[1, 0] - wrist, tau[1, 1] - wrist
    return code


def step_loop(mj_step: Any) -> Any:
    """The loop for MuJoCo's own integrators: torques are held during a step, and the memory takes explicit Euler steps."""

    @numba.njit(error_model="numpy")
    def run(model, data, position, velocity, acceleration, force, system, ws, geometry, dt, steps, rows):
        memory, tau, motion = np.zeros(3), np.zeros((2, 3)), np.zeros((2, 3))
        for i in range(len(rows)):
            for j in range(steps):
                t = (i * steps + j) * dt
                set_torques(system, ws, geometry, t, position, velocity, memory, force, tau, motion)
                mj_step(model, data)
                for a in range(3):
                    memory[a] += dt * ws.memory_rate[a]
            set_torques(system, ws, geometry, (i + 1) * steps * dt, position, velocity, memory, force, tau, motion)
            rows[i, :3] = motion[0]
            rows[i, 3:] = position[3:-2]

    return run


def rk4_loop(mj_forward: Any) -> Any:
    """The loop of the classical Runge-Kutta method over MuJoCo's accelerations."""

    @numba.njit(error_model="numpy")
    def run(model, data, position, velocity, acceleration, force, system, ws, geometry, dt, steps, rows):
        n, tau, motion, memory = len(position), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(3)
        y, k, total = np.zeros(2 * n + 3), np.zeros(2 * n + 3), np.zeros(2 * n + 3)
        for i in range(len(rows)):
            for j in range(steps):
                y[:n], y[n : 2 * n], y[2 * n :] = position, velocity, memory
                total[:] = 0.0
                for stage in range(4):
                    reach = 0.0 if stage == 0 else (dt if stage == 3 else dt / 2)
                    for a in range(n):
                        position[a], velocity[a] = y[a] + reach * k[a], y[n + a] + reach * k[n + a]
                    for a in range(3):
                        memory[a] = y[2 * n + a] + reach * k[2 * n + a]
                    t = (i * steps + j) * dt + reach
                    set_torques(system, ws, geometry, t, position, velocity, memory, force, tau, motion)
                    mj_forward(model, data)
                    k[:n], k[n : 2 * n], k[2 * n :] = velocity, acceleration, ws.memory_rate
                    total += (2.0 if stage == 1 or stage == 2 else 1.0) * k
                y += dt / 6 * total
                position[:], velocity[:], memory[:] = y[:n], y[n : 2 * n], y[2 * n :]
            set_torques(system, ws, geometry, (i + 1) * steps * dt, position, velocity, memory, force, tau, motion)
            rows[i, :3] = motion[0]
            rows[i, 3:] = position[3:-2]

    return run


def held_loop(mj_step: Any) -> Any:
    """The loop of a digital controller: for a whole tick, torques are held, and the memory takes one explicit Euler step."""

    @numba.njit(error_model="numpy")
    def run(model, data, position, velocity, acceleration, force, system, ws, geometry, dt, steps, rows):
        memory, tau, motion = np.zeros(3), np.zeros((2, 3)), np.zeros((2, 3))
        for i in range(len(rows) + 1):
            set_torques(system, ws, geometry, i * steps * dt, position, velocity, memory, force, tau, motion)
            if i > 0:
                rows[i - 1, :3] = motion[0]
                rows[i - 1, 3:] = position[3:-2]
            if i < len(rows):
                for a in range(3):
                    memory[a] += steps * dt * ws.memory_rate[a]
                for _ in range(steps):
                    mj_step(model, data)

    return run


EQUALITY_STEPS = 5
"""Time constant of the equality's error, in steps: shorter ones are close to the limit of stability."""

TINY = 1e-9
"""Mass, kg, or inertia, kg·m², of a body that has none in the model, because MuJoCo demands one."""

LIBRARY_NAMES = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
"""File names of MuJoCo's library on Linux, macOS and Windows."""


def simulate_mujoco(world: World, integrator: str, steps_per_tick: int, ticks: int) -> Motion:
    """Simulate a world's scenario in MuJoCo from the world's present state, which must be at rest with a straight beam.

    integrator: "rk4", or one of MuJoCo's ("Euler", "implicitfast", "discrete"), which then holds the torques for a step.
    """
    import mujoco  # type: ignore[import-not-found]  # An extra.

    bodies, start = make_bodies(world.scenario), world.observe()
    step = world.tick_period / steps_per_tick
    model = mujoco.MjModel.from_xml_string(model_text(bodies, "Euler" if integrator == "rk4" else integrator, step))
    data = mujoco.MjData(model)
    right = 3 + len(bodies.modes)
    data.qpos[:3], data.qpos[right:] = start.joint_angle[0, 0], start.joint_angle[0, 1, :2]
    rows = np.zeros((ticks, 3 + len(bodies.modes)))
    geometry = np.array([*bodies.link_length, bodies.middle, *bodies.bases[0]])
    constants = (world.system, make_workspace(len(bodies.bases), len(bodies.modes)), geometry, step, steps_per_tick)
    memory = (model._address, data._address, data.qpos, data.qvel, data.qacc, data.qfrc_applied)
    run = _loop(integrator == "rk4")
    run(*memory, *constants, rows[:0])  # compiles
    began = time.thread_time()
    run(*memory, *constants, rows)
    cpu = time.thread_time() - began
    return Motion(rows[:, :3], rows[:, 3:] @ bodies.midspan, cpu)


def model_text(bodies: Bodies, integrator: str, step: float) -> str:
    """The model with the beam's modes in MuJoCo's XML."""
    on_carrier = "".join(_mode_text(bodies, number) for number in range(len(bodies.modes)))
    return document(bodies, bodies.carrier, on_carrier, f"<tendon>{_dampers(bodies)}</tendon>", integrator, step)


def document(
    bodies: Bodies, carrier: Body, on_carrier: str, sections: str, integrator: str, step: float, solver: str = "PGS"
) -> str:
    """Arms and carrier in MuJoCo's XML; on_carrier: bodies on the carrier; sections: tendons or equalities of the beam."""
    first, second = bodies.link_length
    wrist = f'<site name="wrist" pos="{second!r} 0 0"/>'
    other_wrist = f'<site name="other_wrist" pos="{2 * bodies.middle!r} 0 0"/>'
    whole = hinged(carrier, second, other_wrist + on_carrier)
    arms = [
        hinged(bodies.links[0], base, hinged(bodies.links[1], first, inner))
        for base, inner in zip(bodies.bases, (whole, wrist), strict=True)
    ]
    return f"""<mujoco>
<compiler angle="radian"/>
<option timestep="{step!r}" integrator="{integrator}" gravity="0 0 0" solver="{solver}" jacobian="dense"
  tolerance="1e-14">
  <flag contact="disable" refsafe="disable" island="disable" warmstart="disable" sensor="disable" limit="disable"
    frictionloss="disable" actuation="disable"/>
</option>
<worldbody>{"".join(arms)}</worldbody>
{sections}
<equality>{connected("wrist", "other_wrist", step)}</equality>
</mujoco>"""


def connected(site: str, other: str, step: float) -> str:
    """An equality that holds two sites together as stiffly as MuJoCo allows."""
    rate = 1 / (EQUALITY_STEPS * step)
    hold = f'solref="{-(rate**2)!r} {-2 * rate!r}" solimp="0.9999 0.9999 0.001 0.5 2"'
    return f'<connect site1="{site}" site2="{other}" {hold}/>'


def hinged(body: Body, at: float | tuple[float, float], inner: str, joint: str = "<joint/>") -> str:
    """A body on a joint at `at`, m, along its parent or as (x, y); inner: the bodies and sites on it."""
    x, y = at if isinstance(at, tuple) else (at, 0.0)
    return f'<body pos="{x!r} {y!r} 0">{joint}{_inertial(body.mass, body.inertia, body.center)}{inner}</body>'


def _inertial(mass: float, inertia: float, center: float) -> str:
    # MuJoCo needs all three inertias; in the plane only the last one matters, and the others must be consistent with it.
    return f'<inertial mass="{mass!r}" pos="{center!r} 0 0" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'


def _mode_text(bodies: Bodies, number: int) -> str:
    mode = bodies.modes[number]
    kind = 'type="slide" axis="0 1 0"' if mode.slides else 'type="hinge"'
    inertial = _inertial(mode.inertia, TINY, 0.0) if mode.slides else _inertial(TINY, mode.inertia, 0.0)
    joint = f'<joint name="mode{number}" {kind} stiffness="{mode.stiffness!r}"/>'
    return f'<body pos="{bodies.middle!r} 0 0">{joint}{inertial}</body>'


def _dampers(bodies: Bodies) -> str:
    """One damped tendon per nodal coordinate, whose length is that coordinate."""
    return "".join(
        f'<fixed damping="{bodies.nodal_damping!r}">'
        + "".join(f'<joint joint="mode{k}" coef="{float(part)!r}"/>' for k, part in enumerate(row))
        + "</fixed>"
        for row in bodies.shape
    )


@cache
def _loop(rk4: bool) -> Any:
    """The compiled loop around a C function of (model, data)."""
    return rk4_loop(c_function("mj_forward")) if rk4 else step_loop(c_function("mj_step"))


def c_function(name: str) -> Any:
    """A function of (model, data) in MuJoCo's library. Raises `StudyError` if the library is not found."""
    import mujoco  # type: ignore[import-not-found]  # An extra.

    folder = Path(mujoco.__file__).parent
    files = [file for pattern in LIBRARY_NAMES for file in folder.glob(pattern)]
    if not files:
        raise StudyError(f"MuJoCo's library was not found in {folder}: reinstall mujoco.")
    function = getattr(ctypes.CDLL(str(files[0])), name)
    function.argtypes, function.restype = [ctypes.c_void_p, ctypes.c_void_p], None
    return function


SOLVER = "Newton"
"""Solver of the constraint forces: a fifth faster here than PGS, with the same motion."""


def simulate_chain(world: World, segments: int, integrator: str, steps_per_tick: int, ticks: int) -> Motion:
    """Simulate a world's scenario in MuJoCo from the world's present state, which must be at rest with a straight beam.

    segments: an even number, so that mid-span is a hinge. integrator: one of MuJoCo's ("RK4", "implicitfast", …). The
    scenario's control period must be one tick, and its damping proportional to the stiffness.
    """
    import mujoco  # type: ignore[import-not-found]  # An extra.

    scenario, start = world.scenario, world.observe()
    step = world.tick_period / steps_per_tick
    model = mujoco.MjModel.from_xml_string(chain_text(scenario, segments, integrator, step))
    data = mujoco.MjData(model)
    # Between the joints of both arms come the first pin's slide and the hinges.
    data.qpos[:3], data.qpos[-2:] = start.joint_angle[0, 0], start.joint_angle[0, 1, :2]
    rows = np.zeros((ticks, 3 + 1 + segments))
    arm = scenario.left_arm
    middle = arm.link_length[2] + scenario.payload.length / 2
    geometry = np.array([*arm.link_length[:2], middle, *scenario.arms[0].base])
    workspace = make_workspace(len(scenario.arms), len(world.beam.modes.omega))
    constants = (world.system, workspace, geometry, step, steps_per_tick)
    memory = (model._address, data._address, data.qpos, data.qvel, data.qacc, data.qfrc_applied)
    run = _chain_loop()
    run(*memory, *constants, rows[:0])  # compiles
    began = time.thread_time()
    run(*memory, *constants, rows)
    cpu = time.thread_time() - began
    angle = np.cumsum(rows[:, 4:], axis=1)[:, : segments // 2]
    return Motion(rows[:, :3], scenario.payload.length / segments * np.sum(np.sin(angle), axis=1), cpu)


def chain_text(scenario: Scenario, segments: int, integrator: str, step: float) -> str:
    """The model with the chain in MuJoCo's XML."""
    payload, first_pin = scenario.payload, scenario.left_arm.link_length[2]
    damping = payload.damping
    assert isinstance(damping, StiffnessDamping)
    length = payload.length / segments
    mass, stiffness = payload.linear_density * length, payload.bending_stiffness / length
    rod = Body(mass, mass * length**2 / 12, length / 2)
    bending = f'<joint stiffness="{stiffness!r}" damping="{damping.coefficient * stiffness!r}"/>'
    chain = f'<site name="end" pos="{length!r} 0 0"/>'
    for _ in range(segments - 1):
        chain = hinged(rod, length, chain, bending)
    chain = hinged(rod, first_pin, chain, '<joint type="slide" axis="1 0 0"/><joint/>')
    pin = f'<site name="pin" pos="{first_pin + payload.length!r} 0 0"/>'
    # Arms and carrier do not depend on the beam's damping, but `make_bodies` accepts only nodal damping.
    bodies = make_bodies(scenario.replace({"payload.damping": NodalDamping()}))
    closure = f"<equality>{connected('end', 'pin', step)}</equality>"
    return document(bodies, bare_carrier(scenario), chain + pin, closure, integrator, step, SOLVER)


@cache
def _chain_loop() -> Any:
    return held_loop(c_function("mj_step"))
