"""A scenario in MuJoCo's XML, with the loops closed, and in the unified robot description format, a tree whose loops stay open.

MJCF: https://mujoco.readthedocs.io/en/stable/XMLreference.html; URDF: http://wiki.ros.org/urdf/XML.
"""

from math import pi
from typing import Any
from xml.etree import ElementTree

from flexlab.errors import StudyError
from flexlab.multibody.bodies import BEAM_END, Bodies, Body, Joint

LEAST_INERTIA = 1e-12
"""Smallest mass, kg, and inertia, kg·m²: MuJoCo refuses bodies with next to none."""
HOLDING_STEPS = 5
"""Time constant of the constraints that close loops, in steps: shorter ones come near the limit of stability."""
RADIUS = {"left": 0.02, "right": 0.02, "beam": 0.008}
"""Radii of the drawn capsules, m."""


def mjcf_text(bodies: Bodies, name: str) -> str:
    """The file's text. Raises `StudyError` for bodies without mass or inertia."""
    for body, _ in bodies.walk():
        if min(body.mass, body.inertia) < LEAST_INERTIA:
            raise StudyError(
                f"{body.name.replace('_', ' ')} has the mass {body.mass:g} kg and the inertia {body.inertia:g} kg·m²: MuJoCo "
                "requires both above 0: give it some, or write .urdf."
            )
    root = ElementTree.Element("mujoco", model=name)
    root.append(ElementTree.Comment(f" {bodies.about()} "))
    _add(root, "compiler", angle="radian")
    gravity = f"0 0 {-bodies.scenario.gravity!r}"
    option = _add(root, "option", timestep=repr(bodies.step), integrator="implicitfast", gravity=gravity)
    _add(option, "flag", contact="disable")
    plane = _add(_add(root, "worldbody"), "body", name="plane", euler=f"{pi / 2 if bodies.upright else 0.0!r} 0 0")
    _add(plane, "light", pos="0 0 3")
    for arm in bodies.arms:
        _add_body(plane, arm)
    closures = _add(root, "equality")
    firm = {"solref": f"{HOLDING_STEPS * bodies.step!r} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
    for tag, pairs in (("weld", bodies.welded), ("connect", bodies.connected)):
        for first, second in pairs:
            _add(closures, tag, name=f"{first}_{second}", site1=first, site2=second, **firm)
    joints = [joint for body, _ in bodies.walk() for joint in body.joints]
    motors = _add(root, "actuator")
    for joint in joints:
        if joint.driven:
            motor, limit = _add(motors, "motor", name=motor_name(joint), joint=joint.name), joint.torque_limit
            if limit is not None:
                motor.attrib |= {"ctrllimited": "true", "ctrlrange": f"{-limit!r} {limit!r}"}
    state = {"qpos": (joint.angle for joint in joints), "qvel": (joint.rate for joint in joints)}
    numbers = {name: " ".join(repr(each) for each in values) for name, values in state.items()}
    _add(_add(root, "keyframe"), "key", name="start", **numbers)
    ElementTree.indent(root)
    return ElementTree.tostring(root, "unicode") + "\n"


def motor_name(joint: Joint) -> str:
    """The name of a joint's motor, as in functional mock-up units: "motor_torque_left_1"."""
    side, _, number = joint.name.split("_")
    return f"motor_torque_{side}_{number}"


def _add(parent: Any, tag: str, **attributes: str) -> Any:
    return ElementTree.SubElement(parent, tag, attributes)


def _add_body(parent: Any, body: Body) -> None:
    element = _add(parent, "body", name=body.name, pos=f"{body.at[0]!r} {body.at[1]!r} 0")
    for joint in body.joints:
        about = {"type": "slide", "axis": "1 0 0"} if joint.slides else {"type": "hinge", "axis": "0 0 1"}
        if joint.stiffness:
            about |= {"stiffness": repr(joint.stiffness)}
        if joint.stiffness or joint.damping:
            about |= {"damping": repr(joint.damping)}
        if joint.friction:
            about |= {"frictionloss": repr(joint.friction)}
        _add(element, "joint", name=joint.name, **about)
    # In the plane only the inertia about z counts: the others are equal to it.
    inertia = " ".join([repr(body.inertia)] * 3)
    _add(element, "inertial", mass=repr(body.mass), pos=f"{body.center!r} 0 0", diaginertia=inertia)
    radius = RADIUS[body.name.partition("_")[0]]
    _add(element, "geom", type="capsule", fromto=f"0 0 0 {body.length!r} 0 0", size=repr(radius), mass="0")
    for frame in body.frames:
        _add(element, "site", name=frame.name, pos=f"{frame.x!r} 0 0", euler=f"0 0 {frame.angle!r}")
    for inner in body.held:
        _add_body(element, inner)


NO_LIMIT = 1e6
"""Limit, N·m and rad/s, of joints without one: URDF requires limits."""


def urdf_text(bodies: Bodies, name: str) -> str:
    """The file's text."""
    root = ElementTree.Element("robot", name=name)
    root.append(ElementTree.Comment(f" {bodies.about()} {_open_loops(bodies)} "))
    _add(root, "link", name="world")
    _add(root, "link", name="plane")
    _add_joint(root, "plane_joint", "fixed", "world", "plane", turn=(pi / 2 if bodies.upright else 0.0, 0.0, 0.0))
    for body, holder in bodies.walk():
        link = _add(root, "link", name=body.name)
        inertial = _add(link, "inertial")
        _add(inertial, "origin", xyz=f"{body.center!r} 0 0", rpy="0 0 0")
        _add(inertial, "mass", value=repr(body.mass))
        # In the plane only the inertia about z counts: the others are equal to it.
        own = repr(body.inertia)
        _add(inertial, "inertia", ixx=own, iyy=own, izz=own, ixy="0", ixz="0", iyz="0")
        visual = _add(link, "visual")
        _add(visual, "origin", xyz=f"{body.length / 2!r} 0 0", rpy=f"0 {pi / 2!r} 0")
        radius = RADIUS[body.name.partition("_")[0]]
        _add(_add(visual, "geometry"), "cylinder", radius=repr(radius), length=repr(body.length))
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


def _connect(root: Any, body: Body, holder: str) -> None:
    """Add a body's joint. The slide along the chord is part of the open loop: readers have trouble with massless links."""
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
        motor = _add(root, "transmission", name=f"{joint.name}_transmission")
        _add(motor, "type").text = "SimpleTransmission"
        _add(_add(motor, "joint", name=joint.name), "hardwareInterface").text = "EffortJointInterface"
        _add(_add(motor, "actuator", name=motor_name(joint)), "mechanicalReduction").text = "1"
