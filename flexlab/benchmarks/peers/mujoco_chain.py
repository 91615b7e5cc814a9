"""The paper's system in MuJoCo with the beam as a chain of rigid segments, as one builds it there.

N rods of length l = L/N, hinged to each other, with a spring EI/l and a damper β EI/l in each of the N - 1 inner hinges. The
first one's end is hinged to the left gripper, the last one's is held to the right gripper by a `connect` equality. Rods do
not stretch, while the model's beam keeps its length along the chord to first order: so the first pin slides along the
chord, by some micrometres. Both grippers keep the angle of the chord, so they are one body, as in `bodies`.
The controller is a digital one: its torques are held for a tick.
"""

import time
from functools import cache
from typing import Any

import numpy as np

from flexlab.benchmarks.peers.bodies import Body, bare_carrier, make_bodies
from flexlab.benchmarks.peers.motion import Motion
from flexlab.benchmarks.peers.mujoco_loops import held_loop
from flexlab.benchmarks.peers.mujoco_model import c_function, connected, document, hinged
from flexlab.physics.plant import make_workspace
from flexlab.scenario import Scenario
from flexlab.scenario.damping import NodalDamping, StiffnessDamping
from flexlab.sim.world import World

SOLVER = "Newton"
"""Of the constraint forces: a fifth faster here than PGS, with the same motion."""


def simulate_chain(world: World, segments: int, integrator: str, steps_per_tick: int, ticks: int) -> Motion:
    """Simulate a world's scenario in MuJoCo from the world's present state, which must be at rest with a straight beam.

    segments: an even number, so that mid-span is a hinge. integrator: one of MuJoCo's ("RK4", "implicitfast", …). The
    scenario's control period is one tick, its damping proportional to the stiffness.
    """
    import mujoco  # type: ignore[import-not-found]  # An extra.

    scenario, start = world.scenario, world.observe()
    step = world.tick_period / steps_per_tick
    model = mujoco.MjModel.from_xml_string(chain_text(scenario, segments, integrator, step))
    data = mujoco.MjData(model)
    # Between both arms' joints: the first pin's slide, then the hinges.
    data.qpos[:3], data.qpos[-2:] = start.joint_angle[0, 0], start.joint_angle[0, 1, :2]
    rows = np.zeros((ticks, 3 + 1 + segments))
    arm = scenario.left_arm
    middle = arm.link_length[2] + scenario.payload.length / 2
    geometry = np.array([*arm.link_length[:2], middle, *scenario.arms[0].base])
    workspace = make_workspace(len(scenario.arms), len(world.beam.modes.omega))
    constants = (world.system, workspace, geometry, step, steps_per_tick)
    memory = (model._address, data._address, data.qpos, data.qvel, data.qacc, data.qfrc_applied)
    run = _loop()
    run(*memory, *constants, rows[:0])  # compiles
    began = time.thread_time()
    run(*memory, *constants, rows)
    cpu = time.thread_time() - began
    angle = np.cumsum(rows[:, 4:], axis=1)[:, : segments // 2]
    return Motion(rows[:, :3], scenario.payload.length / segments * np.sum(np.sin(angle), axis=1), cpu)


def chain_text(scenario: Scenario, segments: int, integrator: str, step: float) -> str:
    """The model in MuJoCo's XML."""
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
    # Arms and carrier do not depend on the beam's damping, which is nodal in the other model.
    bodies = make_bodies(scenario.replace({"payload.damping": NodalDamping()}))
    closure = f"<equality>{connected('end', 'pin', step)}</equality>"
    return document(bodies, bare_carrier(scenario), chain + pin, closure, integrator, step, SOLVER)


@cache
def _loop() -> Any:
    return held_loop(c_function("mj_step"))
