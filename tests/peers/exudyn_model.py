"""The paper's system in Exudyn: planar rigid bodies, revolute and prismatic joints, generalized-alpha.

The control law is a generic object on all coordinates of the arms: a user force in compiled code, evaluated at every Newton
iteration. The controller's memory b̂ is modelled as the velocity of three unit masses, so that the same integrator advances
it.
"""

import sys
import time
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.typed import List as TypedList

from flexlab.physics.plant import make_workspace
from flexlab.sim.samples import Samples
from flexlab.sim.world import World
from peers.bodies import Bodies, Body, Motion, joint_torque_law, make_bodies

SPECTRAL_RADIUS = 0.9
"""Spectral radius of generalized-alpha, Exudyn's default."""

TINY = 1e-9
"""Mass of a rotor, kg, or inertia of a slider, kg·m², because Exudyn demands one."""

DEFLECTION, TURN = 1, 5
"""Rows of a connector's stiffness matrix: displacement along the carrier's second axis, rotation about the third."""

MEMORY = 15
"""Index of the memory's first coordinate, after x, y and angle of the carrier and of four links."""


class _Coordinates(NamedTuple):
    """Arrays that the user force needs."""

    start: np.ndarray
    """Reference coordinates of the carrier, (3,)."""
    tau: np.ndarray
    """(2, 3)."""
    scratch: np.ndarray
    """x, v, b̂, (3, 3)."""


@numba.njit(error_model="numpy")
def controller_force(system_list, workspace_list, coordinates, t, q, q_t, force):
    """Fill `force` (18,), the generalized force on carrier, left links, right links and memory."""
    # Both come in lists: passing a whole system costs Python more time than the law itself.
    system, ws = system_list[0], workspace_list[0]
    x, v, memory = coordinates.scratch[0], coordinates.scratch[1], coordinates.scratch[2]
    for a in range(3):
        x[a], v[a], memory[a] = q[a] + coordinates.start[a], q_t[a], q_t[MEMORY + a]
    tau = coordinates.tau
    joint_torque_law(system, t, x, v, memory, ws, tau)
    force[:] = 0.0
    force[2] = tau[0, 2] + tau[1, 2]
    for arm in range(2):
        force[5 + 6 * arm] = tau[arm, 0] - tau[arm, 1]
        force[8 + 6 * arm] = tau[arm, 1] - tau[arm, 2]
    for a in range(3):
        force[MEMORY + a] = ws.memory_rate[a]


def simulate_exudyn(world: World, steps_per_tick: int, ticks: int, tolerance: float) -> Motion:
    """Simulate a world's scenario in Exudyn from the world's present state, which must be at rest with a straight beam.

    tolerance: relative tolerance of Newton's method; the absolute one is a hundredth of it.
    """
    sys.exudynFast = True  # type: ignore[attr-defined]  # Exudyn's own switch for the build without range checks
    import exudyn  # type: ignore[import-not-found]  # An extra.

    bodies, start = make_bodies(world.scenario), world.observe()
    builder = _Builder(exudyn, bodies, start)
    builder.add_controller(world)
    carrier, sliders = builder.sensors()
    builder.mbs.Assemble()
    settings = _settings(exudyn, steps_per_tick * ticks, ticks * world.tick_period, world.tick_period, tolerance)
    began = time.thread_time()
    builder.mbs.SolveDynamic(settings)
    cpu = time.thread_time() - began
    pose = builder.mbs.GetSensorStoredData(carrier)[1:, 1:4] + start.pose[0]
    # The body of a sliding mode differs from the payload's origin by its displacement across the carrier.
    across = np.zeros((len(pose), len(bodies.modes)))
    for number, sensor in enumerate(sliders):
        place = builder.mbs.GetSensorStoredData(sensor)[1:, 1:3] + start.pose[0, :2]
        way = place - pose[:, :2]
        across[:, number] = np.cos(pose[:, 2]) * way[:, 1] - np.sin(pose[:, 2]) * way[:, 0]
    return Motion(pose, across @ bodies.midspan, cpu)


class _Builder:
    """Builds the multibody system: first the carrier, then the links of each arm, then the modes."""

    def __init__(self, exudyn: Any, bodies: Bodies, start: Samples):
        from exudyn import itemInterface  # type: ignore[import-not-found]  # An extra.

        self.exudyn, self.items, self.bodies = exudyn, itemInterface, bodies
        # The container must outlive the system.
        self.container = exudyn.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.start = start.pose[0]
        self.nodes: list[Any] = []
        self.carrier = self._body(bodies.carrier, self.start)
        for side, (base, angle) in enumerate(zip(bodies.bases, start.joint_angle[0], strict=True)):
            self._add_arm(-1 if side == 0 else 1, np.array(base), angle[0], angle[0] + angle[1])
        self.arm_nodes = list(self.nodes)
        self._add_modes()

    def _body(self, body: Body, place: np.ndarray) -> Any:
        """Add a body; `place`: x and y of its centre of mass, and its angle, (3,)."""
        node = self.mbs.AddNode(
            self.items.NodeRigidBody2D(referenceCoordinates=[float(p) for p in place], initialVelocities=[0.0] * 3)
        )
        self.nodes.append(node)
        return self.mbs.AddObject(self.items.ObjectRigidBody2D(mass=body.mass, inertia=body.inertia, nodeNumber=node))

    def _marker(self, body: Any, along: float) -> Any:
        return self.mbs.AddMarker(self.items.MarkerBodyRigid(bodyNumber=body, localPosition=[float(along), 0.0, 0.0]))

    def _hinge(self, one: Any, other: Any) -> None:
        self.mbs.AddObject(self.items.RevoluteJoint2D(markerNumbers=[one, other]))

    def _add_arm(self, side: int, base: np.ndarray, first: float, second: float) -> None:
        (upper, lower), (l1, l2) = self.bodies.links, self.bodies.link_length
        along = np.array([np.cos(first), np.sin(first)])
        onward = np.array([np.cos(second), np.sin(second)])
        one = self._body(upper, np.array([*(base + upper.center * along), first]))
        two = self._body(lower, np.array([*(base + l1 * along + lower.center * onward), second]))
        ground = self.mbs.AddObject(self.items.ObjectGround(referencePosition=[*base.tolist(), 0.0]))
        self._hinge(self._marker(ground, 0.0), self._marker(one, -upper.center))
        self._hinge(self._marker(one, l1 - upper.center), self._marker(two, -lower.center))
        self._hinge(self._marker(two, l2 - lower.center), self._marker(self.carrier, side * self.bodies.middle))

    def _add_modes(self) -> None:
        """Add a body per mode, held by a spring; dampers couple the modes of the same kind."""
        middle, markers = self._marker(self.carrier, 0.0), []
        for mode in self.bodies.modes:
            body = Body(mode.inertia, TINY, 0.0) if mode.slides else Body(TINY, mode.inertia, 0.0)
            markers.append(self._marker(self._body(body, self.start), 0.0))
            if mode.slides:
                joint = self.items.PrismaticJoint2D(
                    markerNumbers=[middle, markers[-1]], axisMarker0=[0.0, 1.0, 0.0], normalMarker1=[1.0, 0.0, 0.0]
                )
                self.mbs.AddObject(joint)
            else:
                self._hinge(middle, markers[-1])
        damping = self.bodies.damping
        for i, mode in enumerate(self.bodies.modes):
            alike = [j for j, other in enumerate(self.bodies.modes) if other.slides == mode.slides]
            # The damping matrix as dampers: the sum of a row to the carrier, its other entries between two bodies.
            self._connect(middle, markers[i], mode.slides, mode.stiffness, float(damping[i, alike].sum()))
            for j in alike:
                if j > i:
                    self._connect(markers[i], markers[j], mode.slides, 0.0, -float(damping[i, j]))

    def _connect(self, one: Any, other: Any, slides: bool, stiffness: float, damping: float) -> None:
        row = DEFLECTION if slides else TURN
        spring, damper = np.zeros((6, 6)), np.zeros((6, 6))
        spring[row, row], damper[row, row] = stiffness, damping
        self.mbs.AddObject(
            self.items.ObjectConnectorRigidBodySpringDamper(
                markerNumbers=[one, other], stiffness=spring, damping=damper
            )
        )

    def add_controller(self, world: World) -> None:
        """Add the control law, which acts on the arms' coordinates."""
        memory = self.mbs.AddNode(
            self.items.NodeGenericODE2(
                numberOfODE2Coordinates=3,
                referenceCoordinates=[0.0] * 3,
                initialCoordinates=[0.0] * 3,
                initialCoordinates_t=[0.0] * 3,
            )
        )
        size = MEMORY + 3
        mass, force = np.zeros((size, size)), np.zeros(size)
        mass[MEMORY:, MEMORY:] = np.eye(3)
        systems, workspaces = TypedList(), TypedList()
        systems.append(world.system)
        workspaces.append(make_workspace(len(self.bodies.bases), len(self.bodies.modes)))
        coordinates = _Coordinates(self.start.copy(), np.zeros((2, 3)), np.zeros((3, 3)))
        controller_force(systems, workspaces, coordinates, 0.0, np.zeros(size), np.zeros(size), force)  # compiles

        def user_force(mbs: Any, t: float, item: int, q: Any, q_t: Any) -> np.ndarray:
            controller_force(systems, workspaces, coordinates, t, np.asarray(q), np.asarray(q_t), force)
            return force

        self.mbs.AddObject(
            self.items.ObjectGenericODE2(
                nodeNumbers=[*self.arm_nodes, memory], massMatrix=mass, forceUserFunction=user_force
            )
        )

    def sensors(self) -> tuple[Any, list[Any]]:
        """Add sensors of the coordinates of the carrier and of each sliding mode's body."""
        kind = self.exudyn.OutputVariableType.Coordinates
        nodes = [self.nodes[0], *self.nodes[len(self.arm_nodes) :]]
        sensors = [
            self.mbs.AddSensor(self.items.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=kind))
            for node in nodes
        ]
        sliding = [sensor for sensor, mode in zip(sensors[1:], self.bodies.modes, strict=True) if mode.slides]
        return sensors[0], sliding


def _settings(exudyn: Any, steps: int, duration: float, period: float, tolerance: float) -> Any:
    """Solver settings: modified Newton, dense matrices, nothing written to disk."""
    settings = exudyn.SimulationSettings()
    time_integration = settings.timeIntegration
    time_integration.numberOfSteps, time_integration.endTime = steps, duration
    time_integration.verboseMode = 0
    time_integration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
    time_integration.newton.useModifiedNewton = True
    time_integration.newton.relativeTolerance = tolerance
    time_integration.newton.absoluteTolerance = tolerance / 100
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = period
    settings.linearSolver.solverType = exudyn.LinearSolverType.EXUdense
    return settings
