"""The parameter folders: every field with a slider range, and the other fields in closed folders.

Controls are built from the fields' metadata: a slider, boxes, or a menu for one of a few words.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from flexlab.control.law import laws
from flexlab.control.path import Trajectory
from flexlab.errors import FlexlabError, LabError
from flexlab.lab.panel.number_control import LIVE_HINTS, Marks, NumberControl, Numbers
from flexlab.lab.widgets import Menu, Widgets
from flexlab.physics.axial_load import buckling_load
from flexlab.quantities import Part, Quantity, describe, own_numbers
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import TITLES, in_words, options, titled, word_of
from flexlab.scenario.scenario import COMMON_FIELDS
from flexlab.scenario.settings import PERIOD, USUAL_PERIOD, with_period_if_needed
from flexlab.sim.target import build_trajectory, desired_at
from flexlab.text import number_text

Switch = tuple[str, Callable[[Scenario], Any]]
"""Label of the switch of an optional field, and the value with which it begins."""
HINTS = {
    "controller.kind": "Keeps the motion; fields that the new law lacks are dropped.",
    "trajectory.kind": "Goes on from where the target is; fields that the new path lacks are dropped.",
    "controller.slow.kind": "Any law. Keeps the motion.",
    "controller.observer.kind": "Rates of the beam: measured, or estimated from strain gauges by a sampled law.",
    "payload.axial_load": "Whether the beam feels the force along it. Acts at once.",
    "controller.model.axial_load": "Whether the observer accounts for the steady force along the beam.",
    "grips.model": "Whether the grips give way. Starts a new run.",
    "grips.measured_at": "By the arms' joint angles, or at the payload. Acts at once.",
    "left_arm.elbow": "Sign of joint 2. Starts a new run.",
    "right_arm.elbow": "Sign of joint 2. Starts a new run.",
}
"""Path → what a change does, for fields that need another hint than `LIVE_HINTS`."""
SECTIONS = (("Beam", "payload"), ("Controller", "controller"), ("Trajectory", "trajectory"), ("World", ""))
"""Title of each folder, and path of the part of the scenario that it shows."""
FIRST = ("bending_stiffness", "damping")
"""Fields shown before the others: a student changes them first."""
LAST = ("load_share", "wanted_internal_force", "mass_change")
"""Fields shown after the others: those that all laws share, and one that few payloads have."""
SHOWN_PARTS = ("payload.mass_change",)
"""Parts without a kind whose numbers are shown with those of their parent."""
FIRST_PERIOD, FIRST_TORQUE_LIMIT, FIRST_STEP, FIRST_SHAPED = 1e-3, 400.0, 1e-4, 45.5
"""First values of switches: the usual control period, s; two thirds of the paper's largest torque, N·m; a step, s; and the
frequency of the paper's ring, Hz."""


def special_values(path: str, scenario: Scenario) -> Marks:
    """Values of the field at `path` that have a meaning in this scenario, with their labels."""
    if path != "controller.wanted_internal_force" or len(scenario.arms) < 2:
        return ()
    beam = scenario.payload
    return ((buckling_load(beam.length, beam.bending_stiffness, beam.boundary), "P_cr"),)


class Entry(NamedTuple):
    """One control of the panel: a menu, a number with a slider, or boxes for all numbers of a field."""

    path: str
    component: int | None = None
    """Index in a list; None for all numbers at once."""
    name: str = ""
    """The label without unit."""
    unit: str = ""
    boxes: int = 0
    """Number of boxes; 0 for one box with a slider. A field of one number or three has three."""
    is_menu: bool = False

    def read(self, scenario: Scenario) -> Numbers:
        """The numbers of this control in a scenario."""
        value = scenario.get(self.path)
        if self.boxes:
            return (value,) * self.boxes if self.boxes > 1 and not isinstance(value, tuple) else value
        return float(value[self.component or 0] if isinstance(value, tuple) else value)

    def whole(self, scenario: Scenario, value: Numbers) -> Any:
        """The field's whole value with these numbers in it, as commands carry whole values."""
        if self.boxes:
            # Store three equal numbers as one, which keeps its slider simple.
            same = self.boxes > 1 and isinstance(value, tuple) and len(set(value)) == 1
            return value[0] if same and isinstance(value, tuple) else value
        present = scenario.get(self.path)
        if not isinstance(present, tuple):
            return value
        return tuple(value if self.component in (None, index) else item for index, item in enumerate(present))


def field(widgets: Widgets, entry: Entry, switch: Switch | None = None) -> NumberControl:
    """The control of an entry's numbers, made in the open GUI container."""
    path, lab_state = entry.path, widgets.lab_state
    intended = lab_state.intended
    about = replace(intended.about(path), title=entry.name, unit=entry.unit)

    def ask(value: Numbers) -> None:
        try:
            lab_state.change({path: entry.whole(lab_state.intended, value)})
        except FlexlabError as error:
            # A person knows the field by its label.
            raise LabError(str(error).replace(f"{path} = ", f"{entry.name} = ", 1)) from error

    def usual() -> Numbers:
        # The present value if the preset has no such field, or one of another unit or shape: it has another law or path.
        baseline, present = lab_state.baseline, lab_state.intended
        same = baseline.has(path) and baseline.about(path).unit_text() == present.about(path).unit_text()
        same = same and isinstance(baseline.get(path), tuple) == isinstance(present.get(path), tuple)
        return entry.read(baseline if same else present)

    return NumberControl(
        widgets,
        about,
        lambda: entry.read(lab_state.intended),
        ask,
        usual,
        hint=f"Allowed: {about.range_text()}. {LIVE_HINTS[about.live]}",
        slider=not entry.boxes,
        whole=isinstance(intended.get(path), int),
        switch=None if switch is None else (switch[0], lambda: switch[1](lab_state.intended)),
        marks=lambda: special_values(path, lab_state.intended),
    )


def changes_for(path: str, value: Any) -> dict[str, Any]:
    """The changes that choose `value` for the field at `path`."""
    return laws()[value].chosen() if path == "controller.kind" else {path: value}


def choice(widgets: Widgets, path: str) -> Menu:
    """The menu of the field at `path`, made in the open GUI container."""
    lab_state = widgets.lab_state

    def offered() -> dict[str, Any]:
        return {in_words(word): value for word, value in options(path, lab_state.intended).items()}

    def choose(word: str) -> None:
        value = offered()[word]
        wanted = changes_for(path, value)
        clocked = with_period_if_needed(lab_state.intended, wanted)
        lab_state.change(clocked)
        if clocked != wanted:
            lab_state.say(f"{value} acts at control instants: {PERIOD} was set to {USUAL_PERIOD:g} s.")

    def shown() -> str:
        return in_words(word_of(lab_state.intended.get(path)))

    hint = HINTS.get(path, LIVE_HINTS[lab_state.intended.about(path).live])
    return Menu(widgets, TITLES[path], offered, shown, choose, hint=hint)


def entries(scenario: Scenario, part_path: str) -> list[Entry]:
    """The numbers of one part of the scenario that have a slider, in the order on the screen."""
    part = scenario.get(part_path) if part_path else scenario
    rank = {name: index - len(FIRST) for index, name in enumerate(FIRST)} | dict.fromkeys(LAST, 1)

    def place(entry: Entry) -> int:
        ranks = [rank.get(name, 0) for name in entry.path.split(".")]
        return min(ranks) or max(ranks)

    return sorted(_walk(part, part_path), key=place)


def _walk(part: Part, path: str) -> Iterator[Entry]:
    common = COMMON_FIELDS.get(f"{path}.kind", ())
    for name in sorted(type(part).model_fields, key=lambda name: name in common):
        value = getattr(part, name)
        inner = f"{path}.{name}" if path else name
        about = describe(type(part), name)
        if path and isinstance(value, Part) and ("kind" in type(value).model_fields or inner in SHOWN_PARTS):
            yield from _walk(value, inner)
        elif about.slider is not None:
            yield from _components(inner, about, value)


def _components(path: str, about: Quantity, value: object) -> Iterator[Entry]:
    """One entry, or one per component if the title lists them, as in "Amplitude (x, y, θ)"."""
    listed = re.fullmatch(r"(.*) \((.+,.+)\)", about.title)
    units = [unit.strip() for unit in about.unit.split(",")]
    if listed and isinstance(value, tuple):
        names = [name.strip() for name in listed[2].split(",")]
        for index, name in enumerate(names):
            unit = units[index] if len(units) == len(names) else units[0]
            yield Entry(path, index, f"{listed[1]} {name}", "" if unit == "1" else unit)
        return
    yield Entry(path, None, f"{about.title} {about.symbol}".strip(), "" if about.unit == "1" else about.unit)


def three_valued(scenario: Scenario) -> str:
    """A sentence about numbers that differ for x, y and θ although one slider sets all three; empty if there are none."""
    sentences = []
    for entry in (*entries(scenario, "controller"), *entries(scenario, "trajectory")):
        value = scenario.get(entry.path)
        if entry.component is None and isinstance(value, tuple) and len(set(value)) > 1:
            values = ", ".join(number_text(item) for item in value)
            unit = f" ({entry.unit})" if entry.unit else ""
            sentences.append(f"{entry.name}{unit} is {values} for x, y, θ: the slider sets all three.")
    return " ".join(sentences)


class Group(NamedTuple):
    """One folder with the `paths` of its fields; those that end in ".*" stand for the fields of the law or path itself."""

    title: str
    paths: tuple[str, ...]


def _of(part: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{part}.{name}" for name in names)


GAINS, PATH_NUMBERS = "controller.*", "trajectory.*"
ARM = "base", "link_mass", "link_length", "link_center", "link_inertia", "elbow"
GROUPS = (
    Group("Separate gains for x, y and θ", (GAINS,)),
    Group("Motors, sampling and sensors", (
        *_of("controller", "torque_limit", "control_period", "input_delay"),
        "joints.encoders.counts",
        *_of("controller.sensor_noise", "pose", "pose_rate", "strain"),
        "payload.thickness",
        *_of("controller.sensor_noise", "moment_rate", "seed"),
    )),
    Group("Observer", _of("controller.observer", "unknown_force", "unknown_modal_force", "horizon")),
    Group("What the controller believes", (
        *_of("controller.model", "linear_density_factor", "length_factor", "stiffness_factor", "axial_load"),
        *_of("controller.model", "friction_factor", "mass_change_factor"),
    )),
    Group("Friction and motors of the joints", (
        *_of("joints.friction", "viscous", "coulomb", "static_factor", "stribeck_speed", "smoothing_speed"),
        *_of("joints.motor", "time_constant", "stall_torque", "no_load_speed"),
    )),
    Group("Grips", _of("grips", "model", "stiffness", "damping", "measured_at")),
    Group("Path, part by part", (PATH_NUMBERS,)),
    Group("Start of a run", _of("initial", "pose", "pose_rate")),
    Group("Left arm", _of("left_arm", *ARM)),
    Group("Right arm", _of("right_arm", *ARM)),
    Group("Numerics", (*_of("simulation", "integrator", "step", "accuracy"), "payload.mode_count")),
)  # fmt: skip


def _start(order: int) -> Callable[[Scenario], Any]:
    return lambda scenario: tuple(map(float, desired_at(build_trajectory(scenario), 0.0)[order]))


SWITCHES: dict[str, Switch] = {
    "controller.torque_limit": ("Limited torques", lambda _: (FIRST_TORQUE_LIMIT,) * 3),
    "controller.control_period": ("Sampled control", lambda _: FIRST_PERIOD),
    "initial.pose": ("Start off the path", _start(0)),
    "initial.pose_rate": ("Start with a velocity other than the path's", _start(1)),
    "left_arm.link_inertia": ("Inertias other than m l²/12", lambda scenario: scenario.arms[0].inertia),
    "right_arm.link_inertia": ("Inertias other than m l²/12", lambda scenario: scenario.arms[-1].inertia),
    "trajectory.shaper_frequency": ("Shaper for a given frequency", lambda _: FIRST_SHAPED),
    "trajectory.shaper_damping": ("Shaper for a given damping", lambda _: 0.0),
    "controller.observer.horizon": ("Another prediction horizon", lambda s: s.controller.input_delay + 0.5),
    "simulation.step": ("Longest step set by hand", lambda _: FIRST_STEP),
    "payload.mode_count": ("Keep fewer modes", lambda scenario: scenario.payload.coordinate_count),
}
"""Optional fields: the label of their switch, and the value with which it begins."""
CHOSEN = tuple(path for path in TITLES if not any(path in group.paths for group in GROUPS))
"""Fields that are chosen from a menu and belong to no group."""


def present(scenario: Scenario, group: Group) -> tuple[str, ...]:
    """The paths of a group that this scenario has: laws differ in their gains, and not every scenario has a right arm."""
    found: list[str] = []
    for path in group.paths:
        if path == GAINS:
            law = type(scenario.controller)
            numbers = (name for name in law.model_fields if describe(law, name).slider and _one_or_three(law, name))
            found += (f"controller.{name}" for name in numbers)
        elif path == PATH_NUMBERS:
            kind = type(scenario.trajectory)
            for name in (*own_numbers(kind, Trajectory), *own_numbers(Trajectory, Part)):
                if describe(kind, name).slider is None or _one_or_three(kind, name):
                    found.append(f"trajectory.{name}")
        else:
            found.append(path)
    return tuple(path for path in found if scenario.has(path))


def _one_or_three(part: type[Part], name: str) -> bool:
    """Whether a field may be one number or three: its slider sets all three, and boxes set each."""
    return part.model_fields[name].annotation == float | tuple[float, float, float]


def section_rows(scenario: Scenario, part_path: str) -> list[Entry]:
    """The controls of one part of the scenario: its menus, then its numbers with a slider."""
    menus = [path for path in CHOSEN if part_path and path.startswith(f"{part_path}.") and scenario.has(path)]
    return [*(Entry(path, is_menu=True) for path in menus), *entries(scenario, part_path)]


def group_rows(scenario: Scenario, group: Group) -> list[Entry]:
    """The controls of a group: menus, and boxes for all numbers of a field."""
    return [_row(scenario, path) for path in present(scenario, group)]


def _row(scenario: Scenario, path: str) -> Entry:
    if path in TITLES:
        return Entry(path, is_menu=True)
    parent, name = path.rsplit(".", 1)
    about = scenario.about(path)
    boxes = 3 if _one_or_three(type(scenario.get(parent)), name) else 1
    return Entry(path, None, titled(about), about.unit, boxes)


class Folder:
    """A folder of fields, which are rebuilt when the scenario's parts change their kind."""

    def __init__(self, widgets: Widgets, title: str | None, rows: Callable[[Scenario], list[Entry]], *, is_open: bool):
        """`title`: None for no head and border. `rows` returns the entries that it shows of a scenario."""
        self._widgets, self._rows = widgets, rows
        self.folder = widgets.gui.add_folder(title, expand_by_default=is_open)
        self._fields: list[NumberControl | Menu] = []
        self._built_for: list[Entry] | None = None
        self._followed: Scenario | None = None
        self._follow(widgets.lab_state.intended)

    def settle(self, at_once: bool = False) -> None:
        """Follow the scenario; leave alone a control that a person is using, unless `at_once`."""
        self._follow(self._widgets.lab_state.intended)
        for control in self._fields:
            control.settle(at_once)

    def _follow(self, scenario: Scenario) -> None:
        if scenario is self._followed:
            return
        self._followed, rows = scenario, self._rows(scenario)
        if rows == self._built_for:
            return
        for control in self._fields:
            control.remove()
        self._built_for, self.folder.visible = rows, bool(rows)
        with self.folder:
            self._fields = [self._field(row) for row in rows]

    def _field(self, row: Entry) -> NumberControl | Menu:
        if row.is_menu:
            return choice(self._widgets, row.path)
        return field(self._widgets, row, SWITCHES.get(row.path) if row.boxes else None)
