"""The paper's system in MuJoCo.

Joint coordinates: the left arm with the carrier and the beam's modes on it, the right arm with two links, and a `connect`
equality between its wrist and the carrier's. MuJoCo's equalities give way a little; here they are as stiff as it allows.
The loop around its C functions is compiled, so that no time is lost in Python. Its own Runge-Kutta method cannot
carry the controller's memory, so the same formulas are applied from outside, with `mj_forward` four times per step.
"""

import ctypes
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from flexlab.benchmarks.peers.bodies import Bodies, Body, make_bodies
from flexlab.benchmarks.peers.motion import Motion
from flexlab.benchmarks.peers.mujoco_loops import rk4_loop, step_loop
from flexlab.errors import StudyError
from flexlab.physics.plant import make_workspace
from flexlab.sim.world import World

EQUALITY_STEPS = 5
"""Time constant of the equality's error, in steps: shorter ones come near the limit of stability."""

TINY = 1e-9
"""kg or kg·m²: what MuJoCo demands of a body where the model has nothing."""

LIBRARY_NAMES = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
"""MuJoCo's library on Linux, macOS and Windows."""


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
    """The model in MuJoCo's XML."""
    on_carrier = "".join(_mode_text(bodies, number) for number in range(len(bodies.modes)))
    return document(bodies, bodies.carrier, on_carrier, f"<tendon>{_dampers(bodies)}</tendon>", integrator, step)


def document(
    bodies: Bodies, carrier: Body, on_carrier: str, sections: str, integrator: str, step: float, solver: str = "PGS"
) -> str:
    """Arms and carrier in MuJoCo's XML with what moves on the carrier; sections: tendons or equalities of the beam."""
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
    """Two sites held together, as stiffly as MuJoCo allows."""
    rate = 1 / (EQUALITY_STEPS * step)
    hold = f'solref="{-(rate**2)!r} {-2 * rate!r}" solimp="0.9999 0.9999 0.001 0.5 2"'
    return f'<connect site1="{site}" site2="{other}" {hold}/>'


def hinged(body: Body, at: float | tuple[float, float], inner: str, joint: str = "<joint/>") -> str:
    """A body on a joint at `at`, m along the one that holds it, with what it holds itself."""
    x, y = at if isinstance(at, tuple) else (at, 0.0)
    return f'<body pos="{x!r} {y!r} 0">{joint}{_inertial(body.mass, body.inertia, body.center)}{inner}</body>'


def _inertial(mass: float, inertia: float, center: float) -> str:
    # The engine wants a full inertia; in the plane only the last value counts, and the others must suit it.
    return f'<inertial mass="{mass!r}" pos="{center!r} 0 0" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'


def _mode_text(bodies: Bodies, number: int) -> str:
    mode = bodies.modes[number]
    kind = 'type="slide" axis="0 1 0"' if mode.slides else 'type="hinge"'
    inertial = _inertial(mode.inertia, TINY, 0.0) if mode.slides else _inertial(TINY, mode.inertia, 0.0)
    joint = f'<joint name="mode{number}" {kind} stiffness="{mode.stiffness!r}"/>'
    return f'<body pos="{bodies.middle!r} 0 0">{joint}{inertial}</body>'


def _dampers(bodies: Bodies) -> str:
    """One damped tendon per nodal coordinate: its length is that coordinate."""
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
    """A function of (model, data) in MuJoCo's library. Raises `StudyError` where that is not found."""
    import mujoco  # type: ignore[import-not-found]  # An extra.

    folder = Path(mujoco.__file__).parent
    files = [file for pattern in LIBRARY_NAMES for file in folder.glob(pattern)]
    if not files:
        raise StudyError(f"MuJoCo's library was not found in {folder}: reinstall mujoco.")
    function = getattr(ctypes.CDLL(str(files[0])), name)
    function.argtypes, function.restype = [ctypes.c_void_p, ctypes.c_void_p], None
    return function
