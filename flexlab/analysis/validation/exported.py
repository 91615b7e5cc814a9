"""What flexlab hands to other programs and prints: rigid bodies and the paper's figures."""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.linalg import eigh, null_space

from flexlab.analysis.figures import FIGURES
from flexlab.analysis.validation.beam import EI, LENGTH, RHO
from flexlab.analysis.validation.check import UNEQUAL, Check, Runs, alike, below, close, subject
from flexlab.analysis.validation.handed_out import SCALES
from flexlab.analysis.validation.mass_points import MassPoints
from flexlab.multibody.bodies import make_bodies
from flexlab.multibody.formats import mjcf_text, urdf_text
from flexlab.presets import load_preset

POSE, RATE = np.array([0.06, 0.83, 0.21]), np.array([0.9, -0.7, 1.6])
"""Pose and its rate, with which exported bodies start."""
RATIO, VISCOUS, COULOMB, LIMIT = 0.03, (5.0, 4.0, 2.0), (8.0, 6.0, 3.0), (300.0, 200.0, 100.0)
"""Damping ratio of their beam; friction of their joints, N·m·s/rad and N·m, and torque limits, N·m."""


@subject("Exported bodies and figures", 22)
def exported(runs: Runs) -> Iterator[Check]:
    """Energies and bending of bodies as their files tell them, and curves of the paper's figures."""
    scenario = load_preset("paper").replace(
        {
            **UNEQUAL,
            "gravity": 9.81,
            "initial.pose": tuple(POSE),
            "initial.pose_rate": tuple(RATE),
            "payload.element_count": 8,
            "payload.damping": {"kind": "modal", "ratio": RATIO},
            "joints.friction.viscous": VISCOUS,
            "joints.friction.coulomb": COULOMB,
            "controller.torque_limit": LIMIT,
        }
    )
    bodies, points = make_bodies(scenario), MassPoints(scenario)
    root = ElementTree.fromstring(mjcf_text(bodies, "paper"))
    state = _state(root)
    for words, parts in (
        ("MuJoCo", _parts_of_mjcf(root)),
        ("URDF", _parts_of_urdf(ElementTree.fromstring(urdf_text(bodies, "paper")))),
    ):
        yield from _in_motion(words, parts, state, points)
        yield from _bending(words, parts, bodies.about())
        told = [parts[f"right_link_{k + 1}"].joint[1:4] for k in range(3)]
        exact = list(zip(VISCOUS, COULOMB, LIMIT, strict=True))
        yield alike(f"{words}: friction and torque limits of the joints: relative error", 1e-12, told, exact)
    arm, links = scenario.left_arm, _parts_of_mjcf(root)
    told = [links[f"left_link_{k + 1}"].inertial[2] for k in range(3)]
    exact = np.array(arm.link_mass) * np.square(arm.link_length) / 12
    yield alike("links whose inertia is left open are rods, m l²/12: relative error", 1e-12, told, exact)
    down, roll = (-float(_words(root.find(path), name)[k]) for path, name, k in (
        ("option", "gravity", 2), ("worldbody/body", "euler", 0),
    ))  # fmt: skip
    yield close("MuJoCo: weight along -y of the plane", 9.81, -down * np.sin(roll), "m/s²", relative=1e-12)
    yield from _figures(runs)


class _Part(NamedTuple):
    """A body, or a frame without mass."""

    holder: str
    at: tuple[float, float]
    """Where it begins on its holder, m."""
    turn: float
    """rad."""
    joint: tuple[str, float, float, float, float] = ("", 0.0, 0.0, 0.0, 0.0)
    """Name of its hinge, damping, friction, torque limit and stiffness."""
    inertial: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Mass, kg, its centre along x, m, and inertia about it, kg·m²."""


Parts = dict[str, _Part]
"""By name, each after its holder."""


def _words(element: Any, name: str) -> list[float]:
    return [float(each) for each in ("0" if element is None else element.get(name, "0")).split()]


def _number(element: Any, name: str) -> float:
    return _words(element, name)[0]


def _state(root: Any) -> dict[str, tuple[float, float]]:
    """Joint → its angle and rate."""
    names, key = [joint.get("name") for joint in root.iter("joint")], root.find("keyframe/key")
    return dict(zip(names, zip(_words(key, "qpos"), _words(key, "qvel"), strict=True), strict=True))


def _parts_of_mjcf(root: Any) -> Parts:
    limit = {motor.get("joint"): float(motor.get("ctrlrange").split()[1]) for motor in root.iter("motor")}
    parts: Parts = {}

    def add(element: Any, holder: str) -> None:
        x, y, _ = _words(element, "pos")
        joint = ("", 0.0, 0.0, 0.0, 0.0)
        for hinge in element.findall("joint[@type='hinge']"):
            name = hinge.get("name")
            numbers = (_number(hinge, each) for each in ("damping", "frictionloss"))
            joint = (name, *numbers, limit.get(name, 0.0), _number(hinge, "stiffness"))
        mass = element.find("inertial")
        inertial = _number(mass, "mass"), _number(mass, "pos"), _words(mass, "diaginertia")[-1]
        parts[element.get("name")] = _Part(holder, (x, y), 0.0, joint, inertial)
        for site in element.findall("site"):
            parts[site.get("name")] = _Part(element.get("name"), (_number(site, "pos"), 0.0), _words(site, "euler")[-1])
        for inner in element.findall("body"):
            add(inner, element.get("name"))

    for body in root.findall("worldbody/body/body"):
        add(body, "plane")
    return parts


def _parts_of_urdf(root: Any) -> Parts:
    links, parts = {link.get("name"): link.find("inertial") for link in root.findall("link")}, {}
    stiffness = {spring.get("reference"): float(spring.findtext("springStiffness")) for spring in root.iter("gazebo")}
    for joint in root.findall("joint"):
        holder, name = joint.find("parent").get("link"), joint.find("child").get("link")
        if holder == "world":
            continue
        (x, y, _), turn = _words(joint.find("origin"), "xyz"), _words(joint.find("origin"), "rpy")[-1]
        numbers = (_number(joint.find("dynamics"), each) for each in ("damping", "friction"))
        limit, spring = _number(joint.find("limit"), "effort"), stiffness.get(joint.get("name"), 0.0)
        hinge = (joint.get("name"), *numbers, limit, spring)
        inertial = (0.0, 0.0, 0.0)
        if (mass := links[name]) is not None:
            center = _number(mass.find("origin"), "xyz")
            inertial = _number(mass.find("mass"), "value"), center, _number(mass.find("inertia"), "izz")
        parts[name] = _Part(holder, (x, y), turn, hinge, inertial)
    return parts


def _in_motion(words: str, parts: Parts, state: dict[str, tuple[float, float]], points: MassPoints) -> Iterator[Check]:
    """Energies at the start, and the frames of the loop."""
    # x, y, angle, and their rates.
    place = {"plane": np.zeros((2, 3))}
    kinetic = potential = 0.0
    for name, part in parts.items():
        at, (angle, rate) = place[part.holder], state.get(part.joint[0], (0.0, 0.0))
        begin = _moved(at, np.array(part.at)) + [[0.0, 0.0, part.turn + angle], [0.0, 0.0, rate]]
        place[name] = begin
        mass, center, inertia = part.inertial
        (_, height, _), (u, v, spin) = _moved(begin, np.array([center, 0.0]))
        kinetic += (mass * (u * u + v * v) + inertia * spin * spin) / 2
        potential += 9.81 * mass * height
    n = points.shapes(0.0).size
    p, p_dot = np.concatenate([POSE, np.zeros(n)]), np.concatenate([RATE, np.zeros(n)])
    exact = [p_dot @ points.inertia(p) @ p_dot / 2, points.potential(p)]
    statement = "energies of motion and of weight at the start are those of mass points: relative error"
    yield alike(f"{words}: {statement}", 1e-9, [kinetic, potential], exact)
    first, *others = (place[name] for name in ("chord_end", "right_grip", "beam_end"))
    apart = np.array(others) - first
    apart[:, 0, 2] = np.abs(np.exp(1j * apart[:, 0, 2]) - 1)
    yield below(f"{words}: its loops are closed, in rates too: largest difference, m, rad and 1/s", 1e-9, apart)


def _moved(at: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Place and rates of a point at `by` on a body whose origin is `at`, (2, 3)."""
    c, s, spin = np.cos(at[0, 2]), np.sin(at[0, 2]), at[1, 2]
    x, y = c * by[0] - s * by[1], s * by[0] + c * by[1]
    return at + [[x, y, 0.0], [-spin * y, spin * x, 0.0]]


def _bending(words: str, parts: Parts, note: str) -> Iterator[Check]:
    """Frequency and damping of the beam's pieces on two pins, which the file's `note` tells."""
    beam = [part for name, part in parts.items() if re.fullmatch(r"beam_\d+", name)]
    mass, center, inertia = np.array([part.inertial for part in beam]).T
    length = 2 * center
    # Angles of the pieces to the chord, whose ends stay on it.
    held = null_space(length[None])
    height = np.tril(np.tile(length, (len(beam), 1)), -1) + np.diag(center)
    M = height.T @ (mass[:, None] * height) + np.diag(inertia)
    turns = np.diff(np.eye(len(beam)), axis=0)
    D, K = (turns.T @ (np.array([part.joint[k] for part in beam[1:]])[:, None] * turns) for k in (1, 4))
    square, V = eigh(held.T @ K @ held, held.T @ M @ held)
    omega, v = np.sqrt(square[0]), held @ V[:, 0]
    exact = (np.pi / LENGTH) ** 2 * np.sqrt(EI / RHO)
    yield close(f"{words}: first frequency of the beam's pieces on two pins", exact, omega, "rad/s", relative=1e-3)
    told = [float(each) for each in re.findall(r"([\d.]+) Hz", note)]
    hertz = np.array([omega, exact]) / (2 * np.pi)
    yield alike(f"{words}: frequencies of pieces and beam as its note tells them: relative error", 1e-3, told, hertz)
    yield close(f"{words}: its damping ratio", RATIO, v @ D @ v / (2 * omega), relative=1e-3)


def _figures(runs: Runs) -> Iterator[Check]:
    """Curves in the order of plots."""
    run = runs.paper
    wanted = {
        2: [each[:, k] for k in range(3) for each in (run.desired_pose, run.pose)],
        3: [run.midspan_deflection, run.quasi_static_deflection],
        4: list((run.pose - run.desired_pose).T),
        5: [run.internal_force[:, arm, k] for k in range(3) for arm in range(2)],
    }
    for number, exact in wanted.items():
        told = [
            curve.values / SCALES.get(plot.label.rpartition("(")[2].rstrip(")"), 1.0)
            for plot in FIGURES[number](run)
            for curve in plot.curves
        ]
        yield alike(f"curves of Figure {number}, in the units of their axes: relative error", 1e-9, told, exact)
