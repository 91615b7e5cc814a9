"""A scenario in MuJoCo's XML (MJCF, https://mujoco.readthedocs.io/en/stable/XMLreference.html), with the loops closed."""

from math import pi
from typing import Any
from xml.etree import ElementTree

from flexlab.errors import StudyError
from flexlab.multibody.bodies import Bodies, Body, Joint

LEAST_INERTIA = 1e-12
"""kg and kg·m²: MuJoCo refuses bodies that have next to none."""
HOLDING_STEPS = 5
"""Time constant of what closes a loop, in steps: shorter ones come near the limit of stability."""
RADIUS = {"left": 0.02, "right": 0.02, "beam": 0.008}
"""Of the capsules that are drawn, m."""


def mjcf_text(bodies: Bodies, name: str) -> str:
    """The file's text. Raises `StudyError` for bodies without mass or inertia."""
    for body, _ in bodies.walk():
        if min(body.mass, body.inertia) < LEAST_INERTIA:
            raise StudyError(
                f"{body.name.replace('_', ' ')} has the mass {body.mass:g} kg and the inertia {body.inertia:g} kg·m²: MuJoCo "
                "wants both above 0; give it some, or write .urdf."
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
    _add_closures(_add(root, "equality"), bodies)
    joints = [joint for body, _ in bodies.walk() for joint in body.joints]
    motors = _add(root, "actuator")
    for joint in joints:
        if joint.driven:
            _add(motors, "motor", name=motor_name(joint), joint=joint.name, **_torque_range(joint))
    state = {"qpos": (joint.angle for joint in joints), "qvel": (joint.rate for joint in joints)}
    numbers = {name: " ".join(repr(each) for each in values) for name, values in state.items()}
    _add(_add(root, "keyframe"), "key", name="start", **numbers)
    ElementTree.indent(root)
    return ElementTree.tostring(root, "unicode") + "\n"


def motor_name(joint: Joint) -> str:
    """Of a joint's motor, as in functional mock-up units: "motor_torque_left_1"."""
    side, _, number = joint.name.split("_")
    return f"motor_torque_{side}_{number}"


def _add(parent: Any, tag: str, **attributes: str) -> Any:
    return ElementTree.SubElement(parent, tag, attributes)


def _torque_range(joint: Joint) -> dict[str, str]:
    limit = joint.torque_limit
    return {} if limit is None else {"ctrllimited": "true", "ctrlrange": f"{-limit!r} {limit!r}"}


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
    # In the plane only the inertia about z counts: the others suit it.
    inertia = " ".join([repr(body.inertia)] * 3)
    _add(element, "inertial", mass=repr(body.mass), pos=f"{body.center!r} 0 0", diaginertia=inertia)
    radius = RADIUS[body.name.partition("_")[0]]
    _add(element, "geom", type="capsule", fromto=f"0 0 0 {body.length!r} 0 0", size=repr(radius), mass="0")
    for frame in body.frames:
        _add(element, "site", name=frame.name, pos=f"{frame.x!r} 0 0", euler=f"0 0 {frame.angle!r}")
    for inner in body.held:
        _add_body(element, inner)


def _add_closures(parent: Any, bodies: Bodies) -> None:
    firm = {"solref": f"{HOLDING_STEPS * bodies.step!r} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
    for tag, pairs in (("weld", bodies.welded), ("connect", bodies.connected)):
        for first, second in pairs:
            _add(parent, tag, name=f"{first}_{second}", site1=first, site2=second, **firm)
