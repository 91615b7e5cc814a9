"""Arms and beam as a tree of rigid bodies on joints, with the constraints that close its loops.

The arms are exact. The beam is a finite-segment model: `ELEMENTS` equal elements, each of two rigid halves on a hinge with a
spring EI/l, where adjacent halves of neighbours form one piece; a pinned end is a hinge without a spring, a clamped end has no
hinge. Pieces keep their length, and the beam keeps its length along the chord to first order: so its left end slides along the
chord, by micrometres. The chord, the paper's virtual link, is part of the left arm's last link, which holds the right end.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, sin
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from flexlab.errors import ScenarioError
from flexlab.scenario import Arm, Payload, Scenario
from flexlab.signal import ARM
from flexlab.sim.build import build_beam
from flexlab.sim.geometry import deflection_at
from flexlab.sim.world import World
from flexlab.text import number_text

ELEMENTS = 10
"""Number of the beam's elements: its first frequency is 1e-5 off the continuous beam's with pinned ends, 1.6 % with clamped."""
BEAM_END = "beam_end"
"""The frame at the beam's right end."""
STEPS_PER_RADIAN = 2
"""Steps of a simulator per radian of the phase of the pieces' fastest bending."""
LONGEST_STEP = 1e-3
"""Longest step of a simulator, s."""


@dataclass(frozen=True)
class Joint:
    """A joint about z, or along x."""

    name: str
    slides: bool = False
    stiffness: float = 0.0
    """N·m/rad."""
    damping: float = 0.0
    """N·m·s/rad."""
    angle: float = 0.0
    """Angle or place at the start, rad or m."""
    rate: float = 0.0
    """Rate at the start, rad/s or m/s."""
    torque_limit: float | None = None
    """Torque limit of the motor, N·m; None for none."""
    driven: bool = False
    """Whether it has a motor."""
    friction: float = 0.0
    """Coulomb friction, N·m."""


class Frame(NamedTuple):
    """A place on a body."""

    name: str
    x: float
    """Along the body, m."""
    angle: float = 0.0
    """rad."""


@dataclass(frozen=True)
class Body:
    """A rigid body along its x axis, from its joints outwards."""

    name: str
    at: tuple[float, float]
    """Where it begins on the body that holds it, m."""
    joints: tuple[Joint, ...]
    """Empty for a fixed body."""
    mass: float
    """kg."""
    center: float
    """Centre of mass along it, m."""
    inertia: float
    """About the centre of mass, kg·m²."""
    length: float
    """m."""
    held: tuple["Body", ...] = ()
    """Bodies that begin on it."""
    frames: tuple[Frame, ...] = ()


@dataclass(frozen=True)
class Bodies:
    """A scenario as a tree, with the loops to close."""

    scenario: Scenario
    arms: tuple[Body, ...]
    """First links, with all that they carry."""
    welded: tuple[tuple[str, str], ...]
    """Pairs of frames that coincide."""
    connected: tuple[tuple[str, str], ...]
    """Pairs of frames at the same place, with any angle."""
    step: float
    """A simulator's step, s, that suits the fastest bending."""
    frequency: float
    """First bending frequency of the pieces with the grips held, Hz."""
    beam_frequency: float
    """First bending frequency of the scenario's finite elements, Hz."""

    @property
    def upright(self) -> bool:
        """Whether the plane stands upright, with y upwards."""
        return self.scenario.gravity != 0

    def walk(self) -> Iterator[tuple[Body, Body | None]]:
        """All bodies, depth first, each with the body that holds it."""
        for arm in self.arms:
            yield from _walk(arm, None)

    def about(self) -> str:
        """A note for readers of the file."""
        error = self.frequency / self.beam_frequency - 1
        return (
            "Lengths in m, angles in rad. The arms are exact. The beam is made of "
            f"{ELEMENTS} elements of two rigid halves with a spring between them: its first bending frequency with the "
            f"grips held is {self.frequency:.5g} Hz, that of the scenario's finite elements {self.beam_frequency:.5g} Hz "
            f"({error:+.2%}). "
            "Dampers give that mode its damping; they are proportional to the springs. The plane of motion is "
            + ("upright, its y along z" if self.upright else "level: weight does nothing")
            + f"; the scenario's gravity is {self.scenario.gravity:g} m/s^2. Control law, path, motors, sensors and the force "
            "along the beam are left out."
            + (" So is the change of the payload's mass." if self.scenario.payload.mass_change.active else "")
            + (" The grips are rigid here." if self.scenario.grips.active else "")
        )


def _walk(body: Body, holder: Body | None) -> Iterator[tuple[Body, Body | None]]:
    yield body, holder
    for inner in body.held:
        yield from _walk(inner, body)


def make_bodies(scenario: Scenario) -> Bodies:
    """The bodies of a scenario at its start. Raises `ScenarioError` for one that cannot start."""
    world, payload = World(scenario.anew()), scenario.payload
    if world.status.failed:
        raise ScenarioError([("initial", world.status.text)])
    start = world.observe()
    right_end = payload.boundary.split("-")[1]
    pieces = _beam(payload, start.beam_coordinates[0], scenario.left_arm.link_length[2])
    omega, fastest = _frequencies(payload)
    arms = []
    for number, (name, arm) in enumerate(zip(ARM.labels, scenario.arms, strict=False)):
        side = (-1, 1)[number]
        grip = arm.link_length[2]
        frames = [Frame(f"{name}_grip", grip)]
        if number == 0:
            frames.append(Frame("chord_end", grip + payload.length, pi))
        angle = start.joint_angle[0, number]
        rate = _joint_rates(arm, angle, start.pose[0, 2], start.pose_rate[0], side * payload.length / 2)
        limits, lost = scenario.controller.torque_limit, scenario.joints.friction
        joints = [
            Joint(f"{name}_joint_{k + 1}", angle=float(angle[k]), rate=float(rate[k]), driven=True,
                  damping=lost.viscous[k], friction=lost.coulomb[k], torque_limit=limits[k] if limits else None)
            for k in range(3)
        ]  # fmt: skip
        inner: tuple[Body, ...] = pieces if number == 0 else ()
        for k in (2, 1, 0):
            at = arm.base if k == 0 else (arm.link_length[k - 1], 0.0)
            inner = (
                Body(
                    f"{name}_link_{k + 1}", at, (joints[k],), arm.link_mass[k], arm.link_center[k], arm.inertia[k],
                    arm.link_length[k], inner, tuple(frames) if k == 2 else (),
                ),
            )  # fmt: skip
        arms.append(inner[0])
    return Bodies(
        scenario,
        tuple(arms),
        welded=(("chord_end", "right_grip"),) * (len(arms) == 2)
        + (("chord_end", BEAM_END),) * (right_end == "clamped"),
        connected=(("chord_end", BEAM_END),) * (right_end == "pinned"),
        step=min(LONGEST_STEP, float(f"{1 / (STEPS_PER_RADIAN * fastest):.1g}")),
        frequency=omega / (2 * pi),
        beam_frequency=float(build_beam(payload).modes.omega.min()) / (2 * pi),
    )


def _joint_rates(arm: Arm, angle: np.ndarray, theta: float, pose_rate: np.ndarray, s: float) -> np.ndarray:
    """Rates of an arm's joints, rad/s (3,), that move its grip with the payload at s, m from the pose."""
    absolute = np.cumsum(angle)
    links = np.array(arm.link_length) * np.stack([np.cos(absolute), np.sin(absolute)])
    to_grip = np.cumsum(links[:, ::-1], axis=1)[:, ::-1]
    jacobian = np.stack([-to_grip[1], to_grip[0], np.ones(3)])
    turn = s * pose_rate[2] * np.array([-sin(theta), cos(theta), 0.0])
    return np.linalg.solve(jacobian, pose_rate + turn)


def _ends(payload: Payload) -> np.ndarray:
    """Where the beam's rigid pieces end, s in m, (ELEMENTS + 2,)."""
    half, width = payload.length / 2, payload.length / ELEMENTS
    return np.array([-half, *(-half + width * (np.arange(ELEMENTS) + 0.5)), half])


def _angles(payload: Payload, beam_coordinates: np.ndarray) -> np.ndarray:
    """Angles of the pieces to the chord, rad, (ELEMENTS + 1,), for a bent beam. Raises `ScenarioError` for a steep one."""
    left_end, right_end = payload.boundary.split("-")
    ends = _ends(payload)
    height = deflection_at(payload, beam_coordinates[None], ends)[0]
    if left_end == "clamped":
        height[1] = 0.0
    if right_end == "clamped":
        height[-2] = 0.0
    slope = np.diff(height) / np.diff(ends)
    if (steepest := float(np.abs(slope).max())) >= 1.0:
        field = "initial.beam_coordinates"
        text = f"{field}: a slope of {number_text(steepest)} to the chord is too steep for rigid pieces: choose less than 1."
        raise ScenarioError([(field, text)])
    return np.arcsin(slope)


def _beam(payload: Payload, coordinates: np.ndarray, at: float) -> tuple[Body, ...]:
    """The pieces of the beam as a chain, which begins at the left grip at `at`, m."""
    left_end, right_end = payload.boundary.split("-")
    length, modes = np.diff(_ends(payload)), build_beam(payload).modes
    first = int(np.argmin(modes.omega))
    spring = payload.bending_stiffness * ELEMENTS / payload.length
    damping = float(modes.D[first, first] / modes.omega[first] ** 2) * spring
    angle = _angles(payload, coordinates)
    turn = np.diff(angle, prepend=0.0)
    inner: tuple[Body, ...] = ()
    for k in reversed(range(len(length))):
        if k == 0:
            slide = float(payload.length - np.sum(length * np.cos(angle)))
            joints = (Joint("beam_slide", slides=True, angle=slide),) * (right_end != "free")
            joints += (Joint("beam_pin", angle=float(turn[0])),) * (left_end == "pinned")
        else:
            joints = (Joint(f"beam_hinge_{k}", False, spring, damping, float(turn[k])),)
        mass = payload.linear_density * float(length[k])
        inner = (
            Body(
                f"beam_{k}", (at if k == 0 else float(length[k - 1]), 0.0), joints, mass, float(length[k]) / 2,
                mass * float(length[k]) ** 2 / 12, float(length[k]), inner,
                (Frame(BEAM_END, float(length[k]), pi),) if k == len(length) - 1 else (),
            ),
        )  # fmt: skip
    return inner


def _frequencies(payload: Payload) -> tuple[float, float]:
    """Lowest and highest angular frequency of the pieces' motion across the chord with the grips held, rad/s."""
    left_end, right_end = payload.boundary.split("-")
    length, count = np.diff(_ends(payload)), ELEMENTS + 2
    mass, stiffness = np.zeros((count, count)), np.zeros((count, count))
    for k, piece in enumerate(length):
        mass[k : k + 2, k : k + 2] += payload.linear_density * piece / 6 * np.array([[2, 1], [1, 2]])
    for k in range(1, ELEMENTS + 1):
        bend = np.array([1 / length[k - 1], -1 / length[k - 1] - 1 / length[k], 1 / length[k]])
        stiffness[k - 1 : k + 2, k - 1 : k + 2] += (
            payload.bending_stiffness * ELEMENTS / payload.length * np.outer(bend, bend)
        )
    held = {"pinned": 1, "clamped": 2, "free": 0}
    free = slice(held[left_end], count - held[right_end])
    squares = eigh(stiffness[free, free], mass[free, free], eigvals_only=True)
    return float(np.sqrt(squares[0])), float(np.sqrt(squares[-1]))
