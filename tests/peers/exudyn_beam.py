"""The beam of a run as a geometrically exact one in Exudyn, with any rotation and with exact curvature and stretch.

The left grip moves as in the run, and the right one is guided and pressed as in the run. So arms and law are the same by
construction, and only the beams differ. Exudyn's cable element bends without shear, like the lab's beam (Gerstmayr and
Irschik, J. Sound Vib. 318 (2008) 461-487).
"""

import sys
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, CubicSpline

from flexlab.physics.beam import shape_row
from flexlab.sim.samples import Run

STRETCH = 1e6
"""Axial stiffness EA, N: the forces here stretch the beam by less than 1e-4 of its length."""

RELATIVE, ABSOLUTE = 1e-8, 1e-7
"""Tolerances of Newton's method."""

SPECTRAL_RADIUS = 0.9
"""Spectral radius of generalized-alpha, Exudyn's default."""

POINTS = 2001
"""Number of points at which the beam's initial shape is computed."""


def exact_deflection(run: Run, elements: int, step: float) -> np.ndarray:
    """Deflection of mid-span, or of a free end, at the run's instants, m, (N,).

    `elements` must be even, and `step`, s, divide the time between two instants.

    The run's beam must begin at rest and have damping proportional to its stiffness. With two arms, the virtual link must move
    only across itself, so that the axial force is the same everywhere.
    """
    sys.exudynFast = True  # type: ignore[attr-defined]  # Exudyn's own switch for the build without range checks
    import exudyn  # type: ignore[import-not-found]  # An extra.
    from exudyn import itemInterface  # type: ignore[import-not-found]  # An extra.

    container = exudyn.SystemContainer()  # Must outlive the system.
    mbs, free = container.AddSystem(), _is_free(run)
    nodes = _add_beam(mbs, itemInterface, run, elements)
    ground = mbs.AddNode(itemInterface.NodePointGround())
    origin = mbs.AddMarker(itemInterface.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    for (node, coordinate), way in _guided(run).items():
        _guide(mbs, itemInterface, origin, nodes[node], coordinate, BPoly.from_derivatives(run.time, way))
    if not free:
        force = CubicSpline(run.time, run.axial_load[:, -1])
        marker = mbs.AddMarker(itemInterface.MarkerNodePosition(nodeNumber=nodes[-1]))
        mbs.AddLoad(
            itemInterface.LoadForceVector(
                markerNumber=marker, loadVectorUserFunction=lambda mbs, t, load: [float(force(t)), 0.0, 0.0]
            )
        )
    sensor = mbs.AddSensor(
        itemInterface.SensorNode(
            nodeNumber=nodes[-1 if free else elements // 2],
            storeInternal=True,
            outputVariableType=exudyn.OutputVariableType.Position,
        )
    )
    mbs.Assemble()
    mbs.SolveDynamic(_settings(exudyn, run, step))
    place = np.array(mbs.GetSensorStoredData(sensor))[:, 1:3]
    left = _left_grip(run)[0]
    across = np.stack([-np.sin(run.pose[:, 2]), np.cos(run.pose[:, 2])], axis=1)
    return np.sum((place - left) * across, axis=1)


def _is_free(run: Run) -> bool:
    return run.scenario.payload.boundary == "clamped-free"


def _direction(run: Run) -> np.ndarray:
    """Unit vector e₁ along the link with its rate and acceleration, (3, N, 2)."""
    angle, rate, acceleration = run.pose[:, 2], run.pose_rate[:, 2, None], run.pose_acceleration[:, 2, None]
    e1, e2 = np.stack([np.cos(angle), np.sin(angle)], axis=1), np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return np.stack([e1, rate * e2, acceleration * e2 - rate * rate * e1])


def _left_grip(run: Run) -> np.ndarray:
    """Position, rate and acceleration of the left grip, (3, N, 2)."""
    middle = np.stack([run.pose[:, :2], run.pose_rate[:, :2], run.pose_acceleration[:, :2]])
    return middle - run.scenario.payload.length / 2 * _direction(run)


def _guided(run: Run) -> dict[tuple[int, int], np.ndarray]:
    """Map node and coordinate to the value, rate and acceleration that the arms prescribe, (N, 3)."""
    left, along = _left_grip(run), _direction(run)
    found = {(0, 0): left[:, :, 0], (0, 1): left[:, :, 1]}
    if _is_free(run):
        found |= {(0, 2): along[:, :, 0], (0, 3): along[:, :, 1]}
    else:
        found[-1, 1] = (left + run.scenario.payload.length * along)[:, :, 1]
    return {place: way.T for place, way in found.items()}


def _add_beam(mbs: Any, items: Any, run: Run, elements: int) -> list[Any]:
    """Add a beam as long as the run's and bent like it at the start; return its nodes (x, y, slope r′) from left to right."""
    payload, left, along = run.scenario.payload, _left_grip(run)[0, 0], _direction(run)[0, 0]
    across = np.array([-along[1], along[0]])
    s = np.linspace(-payload.length / 2, payload.length / 2, POINTS)
    bend = np.array([
        shape_row(at, payload.length, payload.element_count, payload.boundary) for at in s
    ]) @ run.beam_coordinates[0]  # fmt: skip
    rise = np.gradient(bend, s)
    level = np.sqrt(1 - rise * rise)
    way = np.concatenate([[0.0], np.cumsum((level[1:] + level[:-1]) / 2 * np.diff(s))])
    nodes = []
    for k in np.linspace(0, POINTS - 1, elements + 1).round().astype(int):
        straight = np.concatenate([left + (s[k] - s[0]) * along, along])
        bent = np.concatenate([left + way[k] * along + bend[k] * across, level[k] * along + rise[k] * across])
        nodes.append(
            mbs.AddNode(
                items.NodePoint2DSlope1(
                    referenceCoordinates=straight.tolist(), initialCoordinates=(bent - straight).tolist()
                )
            )
        )
    for pair in zip(nodes[:-1], nodes[1:], strict=True):
        mbs.AddObject(
            items.ObjectANCFCable2D(
                length=payload.length / elements,
                massPerLength=payload.linear_density,
                bendingStiffness=payload.bending_stiffness,
                axialStiffness=STRETCH,
                bendingDamping=payload.damping.coefficient * payload.bending_stiffness,
                nodeNumbers=list(pair),
            )
        )
    return nodes


def _guide(mbs: Any, items: Any, origin: Any, node: Any, coordinate: int, way: BPoly) -> None:
    """Prescribe a coordinate of a node."""
    rate, reference = way.derivative(), mbs.GetNode(node)["referenceCoordinates"][coordinate]
    marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
    mbs.AddObject(
        items.CoordinateConstraint(
            markerNumbers=[origin, marker],
            offsetUserFunction=lambda mbs, t, item, offset: float(way(t)) - reference,
            offsetUserFunction_t=lambda mbs, t, item, offset: float(rate(t)),
        )
    )


def _settings(exudyn: Any, run: Run, step: float) -> Any:
    """Solver settings: full Newton, because the beam turns; nothing is written to disk."""
    settings, duration = exudyn.SimulationSettings(), float(run.time[-1])
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = round(duration / step), duration
    integration.verboseMode = 0
    integration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
    integration.newton.relativeTolerance, integration.newton.absoluteTolerance = RELATIVE, ABSOLUTE
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = float(run.time[1] - run.time[0])
    return settings
