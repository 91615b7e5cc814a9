"""The rest of the scenario: every field that has no slider, in folders that are closed until somebody needs them."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import viser

from flexlab.control.path import Trajectory
from flexlab.lab.lab_state import LabState
from flexlab.lab.panel.choice import Choice
from flexlab.lab.panel.numeric_field import NumericField
from flexlab.quantities import Part, describe, own_numbers
from flexlab.scenario import Scenario
from flexlab.sim.target import build_trajectory, desired_at

FIRST_PERIOD, FIRST_TORQUE_LIMIT, FIRST_STEP, FIRST_SHAPED = 1e-3, 400.0, 1e-4, 45.5
"""What a switch begins with: an ordinary controller's 1 ms, two thirds of the paper's largest torque in N·m, 0.1 ms, and the
paper's ring in Hz."""


class Group(NamedTuple):
    """One folder: `paths` of its fields; those that end in ".*" stand for what a law or a path has of its own."""

    title: str
    paths: tuple[str, ...]


def _arm(side: str) -> tuple[str, ...]:
    fields = ("base", "link_mass", "link_length", "link_center", "link_inertia", "elbow")
    return tuple(f"{side}_arm.{field}" for field in fields)


GAINS, PATH_NUMBERS = "controller.*", "trajectory.*"
GROUPS = (
    Group("Gains for x, y and θ apart", (GAINS,)),
    Group("Motors, sampling and sensors", (
        "controller.torque_limit",
        "controller.control_period",
        "controller.input_delay",
        "controller.sensor_noise.pose",
        "controller.sensor_noise.pose_rate",
        "controller.sensor_noise.strain",
        "payload.thickness",
        "controller.sensor_noise.moment_rate",
        "controller.sensor_noise.seed",
    )),
    Group("Observer", (
        "controller.observer.unknown_force",
        "controller.observer.unknown_modal_force",
        "controller.observer.horizon",
    )),
    Group("What the controller believes", (
        "controller.model.linear_density_factor",
        "controller.model.length_factor",
        "controller.model.stiffness_factor",
        "controller.model.axial_load",
    )),
    Group("Path, part by part", (PATH_NUMBERS,)),
    Group("Start of a run", ("initial.pose", "initial.pose_rate")),
    Group("Left arm", _arm("left")),
    Group("Right arm", _arm("right")),
    Group("Numerics", (
        "simulation.integrator",
        "simulation.step",
        "simulation.accuracy",
        "payload.mode_count",
    )),
)  # fmt: skip


def _start(order: int) -> Callable[[Scenario], Any]:
    return lambda scenario: tuple(map(float, desired_at(build_trajectory(scenario), 0.0)[order]))


SWITCHES: dict[str, tuple[str, Callable[[Scenario], Any]]] = {
    "controller.torque_limit": ("Limited torques", lambda _: (FIRST_TORQUE_LIMIT,) * 3),
    "controller.control_period": ("Sampled control", lambda _: FIRST_PERIOD),
    "initial.pose": ("Start elsewhere than on the path", _start(0)),
    "initial.pose_rate": ("Start with another velocity than the path's", _start(1)),
    "left_arm.link_inertia": ("Inertias other than m l²/12", lambda scenario: scenario.arms[0].inertia),
    "right_arm.link_inertia": ("Inertias other than m l²/12", lambda scenario: scenario.arms[-1].inertia),
    "trajectory.shaper_frequency": ("Shaper made for a frequency given here", lambda _: FIRST_SHAPED),
    "trajectory.shaper_damping": ("Shaper made for a damping given here", lambda _: 0.0),
    "controller.observer.horizon": (
        "Prediction ahead by another time",
        lambda scenario: scenario.controller.input_delay + 0.5,
    ),
    "simulation.step": ("Longest step chosen by hand", lambda _: FIRST_STEP),
    "payload.mode_count": ("Keep fewer modes", lambda scenario: scenario.payload.coordinate_count),
}
"""Fields that may be left out: the words of their switch, and the value that it begins with."""
CHOSEN = ("simulation.integrator", "left_arm.elbow", "right_arm.elbow", "controller.model.axial_load")


def present(scenario: Scenario, group: Group) -> tuple[str, ...]:
    """The paths of a group that this scenario has: a law has gains of its own, and not every machine a right arm."""
    return tuple(path for path in _expanded(scenario, group) if scenario.has(path))


def _expanded(scenario: Scenario, group: Group) -> Iterator[str]:
    for path in group.paths:
        if path == GAINS:
            law = type(scenario.controller)
            numbers = (name for name in law.model_fields if describe(law, name).slider and _one_or_three(law, name))
            yield from (f"controller.{name}" for name in numbers)
        elif path == PATH_NUMBERS:
            kind = type(scenario.trajectory)
            for name in (*own_numbers(kind, Trajectory), *own_numbers(Trajectory, Part)):
                if describe(kind, name).slider is None or _one_or_three(kind, name):
                    yield f"trajectory.{name}"
        else:
            yield path


def _one_or_three(part: type[Part], name: str) -> bool:
    """Whether a field may be one number or three: its slider sets all three, and its parts have boxes here."""
    return part.model_fields[name].annotation == float | tuple[float, float, float]


class Details:
    """One folder. Its fields are built anew when the scenario's parts change their kind."""

    def __init__(self, gui: viser.GuiApi, lab_state: LabState, group: Group):
        self._gui, self._lab_state, self._group = gui, lab_state, group
        self._folder = gui.add_folder(group.title, expand_by_default=False)
        self._fields: list[NumericField | Choice] = []
        self._built_for: tuple[str, ...] | None = None
        self._followed: Scenario | None = None
        self._follow(lab_state.intended)

    def settle(self, scenario: Scenario) -> None:
        """Follow the scenario, leaving alone what a person is at."""
        self._follow(scenario)
        for field in self._fields:
            field.show(scenario) if isinstance(field, Choice) else field.settle(scenario)

    def show(self, scenario: Scenario) -> None:
        """Show the scenario in every field, at once."""
        self._follow(scenario)
        for field in self._fields:
            field.show(scenario)

    def _follow(self, scenario: Scenario) -> None:
        if scenario is self._followed:
            return
        self._followed = scenario
        paths = present(scenario, self._group)
        if paths == self._built_for:
            return
        for field in self._fields:
            field.remove()
        self._built_for, self._folder.visible = paths, bool(paths)
        with self._folder:
            self._fields = [self._field(path) for path in paths]

    def _field(self, path: str) -> NumericField | Choice:
        if path in CHOSEN:
            return Choice(self._gui, self._lab_state, path)
        parent, name = path.rsplit(".", 1)
        parts = 3 if _one_or_three(type(self._lab_state.intended.get(parent)), name) else 1
        return NumericField(self._gui, self._lab_state, path, SWITCHES.get(path), parts)
