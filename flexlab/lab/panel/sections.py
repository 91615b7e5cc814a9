"""The parameter folders: every scenario field with a slider range becomes a field on the screen."""

import re
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import viser

from flexlab.control.conditions import Condition
from flexlab.lab.lab_state import LabState
from flexlab.lab.panel.choice import Choice
from flexlab.lab.panel.field import Field
from flexlab.lab.panel.number_control import put
from flexlab.lab.panel.text import escaped, number
from flexlab.quantities import Part, Quantity, describe
from flexlab.scenario import Scenario
from flexlab.scenario.scenario import COMMON_FIELDS

SECTIONS = (("Beam", "payload"), ("Controller", "controller"), ("Trajectory", "trajectory"), ("World", ""))
"""Folder title and path of the part of the scenario that it shows."""
CHOSEN = (
    "controller.kind",
    "controller.slow.kind",
    "controller.observer.kind",
    "trajectory.kind",
    "trajectory.shaper",
    "payload.damping.kind",
    "payload.boundary",
    "payload.axial_load",
)
"""Fields that are a word from a menu."""
FIRST = ("bending_stiffness", "damping")
"""Fields that stand before the others: what a student changes first."""
LAST = ("load_share", "wanted_internal_force")
"""Fields that stand after the others: what all laws share."""


class Entry(NamedTuple):
    """A number to show: path, component (None: all at once), label without unit, unit."""

    path: str
    component: int | None
    name: str
    unit: str


def entries(scenario: Scenario, part_path: str) -> list[Entry]:
    """The numbers of one part of the scenario that have a slider, in the order they are shown."""
    part = scenario.get(part_path) if part_path else scenario
    found = list(_walk(part, part_path))
    rank = {name: index - len(FIRST) for index, name in enumerate(FIRST)} | dict.fromkeys(LAST, 1)
    return sorted(found, key=lambda entry: _extreme([rank.get(name, 0) for name in entry.path.split(".")]))


def _extreme(ranks: list[int]) -> int:
    """The rank that a path gets from its names."""
    return min(ranks) or max(ranks)


def _walk(part: Part, path: str) -> Iterator[Entry]:
    common = COMMON_FIELDS.get(f"{path}.kind", ())
    for name in sorted(type(part).model_fields, key=lambda name: name in common):
        value = getattr(part, name)
        inner = f"{path}.{name}" if path else name
        about = describe(type(part), name)
        if path and isinstance(value, Part) and "kind" in type(value).model_fields:
            yield from _walk(value, inner)
        elif about.slider is not None:
            yield from _components(inner, about, value)


def _components(path: str, about: Quantity, value: object) -> Iterator[Entry]:
    """One entry, or one per component when the title lists them, as in "Amplitude (x, y, θ)"."""
    listed = re.fullmatch(r"(.*) \((.+,.+)\)", about.title)
    units = [unit.strip() for unit in about.unit.split(",")]
    if listed and isinstance(value, tuple):
        names = [name.strip() for name in listed[2].split(",")]
        for index, name in enumerate(names):
            unit = units[index] if len(units) == len(names) else units[0]
            yield Entry(path, index, f"{listed[1]} {name}", "" if unit == "1" else unit)
        return
    yield Entry(path, None, f"{about.title} {about.symbol}".strip(), "" if about.unit == "1" else about.unit)


class Section:
    """One folder. Its fields are built anew when the scenario's part changes its kind."""

    def __init__(
        self, gui: viser.GuiApi, lab_state: LabState, title: str, path: str, note: Callable[[], str] | None = None
    ):
        """`note`: HTML to show below the fields, asked for at every update."""
        self._gui, self._lab_state, self._path, self._note = gui, lab_state, path, note
        self._noted: viser.GuiHtmlHandle | None = None
        self._folder = gui.add_folder(title)
        self._built_for: list[Entry] | None = None
        self._followed: Scenario | None = None
        self._fields: list[Field] = []
        self._choices: list[Choice] = []
        self._build(lab_state.intended)

    def settle(self, scenario: Scenario) -> None:
        """Follow the scenario, leaving alone what a person is at."""
        self._follow(scenario)
        for choice in self._choices:
            choice.show(scenario)
        for field in self._fields:
            field.settle(scenario)

    def show(self, scenario: Scenario) -> None:
        """Show the scenario in every field, at once."""
        self._follow(scenario)
        for choice in self._choices:
            choice.show(scenario)
        for field in self._fields:
            field.show(scenario)

    def _follow(self, scenario: Scenario) -> None:
        if scenario is not self._followed and entries(scenario, self._path) != self._built_for:
            self._build(scenario)
        self._followed = scenario

    def _build(self, scenario: Scenario) -> None:
        for widget in (*self._fields, *self._choices):
            widget.remove()
        self._built_for = entries(scenario, self._path)
        chosen = [path for path in CHOSEN if self._path and path.startswith(f"{self._path}.") and scenario.has(path)]
        with self._folder:
            self._choices = [Choice(self._gui, self._lab_state, path) for path in chosen]
            self._fields = [Field(self._gui, self._lab_state, *entry) for entry in self._built_for]
            if self._note is not None:
                if self._noted is not None:
                    self._noted.remove()
                self._noted = self._gui.add_html(self._note())

    def write_note(self) -> None:
        """Bring the note below the fields up to date."""
        if self._note is not None and self._noted is not None:
            put(self._noted, content=self._note())


def conditions_html(conditions: Iterable[Condition]) -> str:
    """The conditions of the control law, each with its numbers, met or not."""
    lines = []
    for condition in conditions:
        kind, word = ("fl-dim", "met") if condition.met else ("fl-bad", "not met")
        lines.append(f'<div class="fl-line {kind}"><b>{word}</b> {escaped(condition.sentence)}</div>')
    return f'<div class="fl">{"".join(lines)}</div>' if lines else ""


def three_valued(scenario: Scenario) -> str:
    """A sentence about numbers that differ for x, y and θ where one slider sets all; empty if there are none."""
    sentences = []
    for entry in (*entries(scenario, "controller"), *entries(scenario, "trajectory")):
        value = scenario.get(entry.path)
        if entry.component is None and isinstance(value, tuple) and len(set(value)) > 1:
            values = ", ".join(number(item) for item in value)
            sentences.append(f"{entry.name} is {values} for x, y, θ: the slider sets all three.")
    return " ".join(sentences)
