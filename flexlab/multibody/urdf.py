"""A scenario in the unified robot description format (URDF, http://wiki.ros.org/urdf/XML): a tree, whose loops stay open."""

from math import pi
from typing import Any
from xml.etree import ElementTree

from flexlab.multibody.bodies import BEAM_END, Bodies, Body, Joint
from flexlab.multibody.mjcf import RADIUS, motor_name

NO_LIMIT = 1e6
"""N·m and rad/s: URDF wants limits of joints that have none here."""


def urdf_text(bodies: Bodies, name: str) -> str:
    """The file's text."""
    root = ElementTree.Element("robot", name=name)
    root.append(ElementTree.Comment(f" {bodies.about()} {_open_loops(bodies)} "))
    _add(root, "link", name="world")
    _add(root, "link", name="plane")
    _add_joint(root, "plane_joint", "fixed", "world", "plane", turn=(pi / 2 if bodies.upright else 0.0, 0.0, 0.0))
    for body, holder in bodies.walk():
        _add_link(root, body)
        _connect(root, body, "plane" if holder is None else holder.name)
        for frame in body.frames:
            _add(root, "link", name=frame.name)
            _add_joint(
                root, f"{frame.name}_joint", "fixed", body.name, frame.name, (frame.x, 0.0), (0.0, 0.0, frame.angle)
            )
    ElementTree.indent(root)
    return ElementTree.tostring(root, "unicode", xml_declaration=True) + "\n"


def _open_loops(bodies: Bodies) -> str:
    springs = "URDF has no springs: they stand in the elements 'gazebo', in N m/rad."
    loops = [f"{other} stays on the x axis of {frame}" for frame, other in bodies.connected]
    loops += [
        f"{other} is one frame with {frame}"
        if other != BEAM_END
        else f"{other} stays on the x axis of {frame} and turns with it"
        for frame, other in bodies.welded
    ]
    if not loops:
        return springs
    return f"URDF has no loops: these stay open, for your simulator to close: {'; '.join(loops)}. {springs}"


def _add(parent: Any, tag: str, **attributes: str) -> Any:
    return ElementTree.SubElement(parent, tag, attributes)


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(map(repr, values))


def _add_joint(
    root: Any, name: str, kind: str, parent: str, child: str, at: tuple[float, float] = (0.0, 0.0),
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Any:  # fmt: skip
    element = _add(root, "joint", name=name, type=kind)
    _add(element, "parent", link=parent)
    _add(element, "child", link=child)
    _add(element, "origin", xyz=_numbers((*at, 0.0)), rpy=_numbers(turn))
    return element


def _add_link(root: Any, body: Body) -> None:
    link = _add(root, "link", name=body.name)
    inertial = _add(link, "inertial")
    _add(inertial, "origin", xyz=f"{body.center!r} 0 0", rpy="0 0 0")
    _add(inertial, "mass", value=repr(body.mass))
    # In the plane only the inertia about z counts: the others suit it.
    own = repr(body.inertia)
    _add(inertial, "inertia", ixx=own, iyy=own, izz=own, ixy="0", ixz="0", iyz="0")
    visual = _add(link, "visual")
    _add(visual, "origin", xyz=f"{body.length / 2!r} 0 0", rpy=f"0 {pi / 2!r} 0")
    radius = RADIUS[body.name.partition("_")[0]]
    _add(_add(visual, "geometry"), "cylinder", radius=repr(radius), length=repr(body.length))


def _connect(root: Any, body: Body, holder: str) -> None:
    """The joint of a body. What slides along the chord is left to who closes the loop: links without mass trouble readers."""
    joint = next((each for each in body.joints if not each.slides), None)
    if joint is None:
        _add_joint(root, f"{body.name}_joint", "fixed", holder, body.name, body.at)
        return
    element = _add_joint(root, joint.name, "revolute", holder, body.name, body.at)
    _add(element, "axis", xyz="0 0 1")
    torque = NO_LIMIT if joint.torque_limit is None else joint.torque_limit
    effort = repr(torque if joint.driven else 0.0)
    _add(element, "limit", lower=repr(-2 * pi), upper=repr(2 * pi), effort=effort, velocity=repr(NO_LIMIT))
    if joint.stiffness or joint.damping or joint.friction:
        _add(element, "dynamics", damping=repr(joint.damping), friction=repr(joint.friction) if joint.friction else "0")
    if joint.stiffness:
        spring = _add(root, "gazebo", reference=joint.name)
        _add(spring, "springStiffness").text = repr(joint.stiffness)
        _add(spring, "springReference").text = "0"
    if joint.driven:
        _add_motor(root, joint)


def _add_motor(root: Any, joint: Joint) -> None:
    motor = _add(root, "transmission", name=f"{joint.name}_transmission")
    _add(motor, "type").text = "SimpleTransmission"
    _add(_add(motor, "joint", name=joint.name), "hardwareInterface").text = "EffortJointInterface"
    _add(_add(motor, "actuator", name=motor_name(joint)), "mechanicalReduction").text = "1"
