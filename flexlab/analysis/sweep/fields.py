"""Which fields of a scenario a study may vary: numbers with the ranges that are worth looking at, and choices."""

from dataclasses import dataclass

from flexlab.errors import ScenarioError
from flexlab.quantities import Quantity
from flexlab.scenario import Scenario
from flexlab.scenario.choices import TITLES, options
from flexlab.scenario.field_names import value_paths

NOT_VARIED = ("simulation", "transition", "elbow", "seed")
"""Names on a path: how the equations are integrated, what is left of a change in motion, and numbers without a size."""
CHOSEN = ("controller.kind", "trajectory.kind", "trajectory.shaper", "payload.damping.kind", "payload.boundary")
"""Fields that are a choice, and of which a sweep may take several."""
AROUND = 4.0
"""Where a field has no slider, a range goes from its value over this to its value times this."""


@dataclass(frozen=True)
class VariedField:
    """A field that is one number."""

    path: str
    value: float
    """As the scenario has it."""
    about: Quantity
    whole: bool
    """Whether it takes whole numbers only."""

    @property
    def words(self) -> str:
        """Title, symbol and unit."""
        unit = f" ({self.about.unit})" if self.about.unit not in ("", "1") else ""
        return " ".join(filter(None, (self.about.title, self.about.symbol))) + unit

    @property
    def part(self) -> str:
        """The part of the scenario that it belongs to, in words."""
        first, _, rest = self.path.partition(".")
        return first.replace("_", " ").capitalize() if rest else "Scenario"

    @property
    def range(self) -> tuple[float, float]:
        """A range worth looking at: the slider's, or one around the value, within what is allowed."""
        if self.about.slider is not None:
            return self.about.slider
        if self.value == 0:
            return max(self.about.low, 0.0), min(self.about.high, 1.0)
        low, high = sorted((self.value / AROUND, self.value * AROUND))
        return max(self.about.low, low), min(self.about.high, high)

    @property
    def logarithmic(self) -> bool:
        """Whether equal ratios are equally far apart on that range."""
        return self.about.logarithmic and self.range[0] > 0


@dataclass(frozen=True)
class VariedChoice:
    """A field that is one of a few words."""

    path: str
    value: str
    """As the scenario has it."""
    options: tuple[str, ...]
    """What a sweep may take: those with which the scenario is valid."""

    @property
    def words(self) -> str:
        """What it is called."""
        return TITLES[self.path]


def varied_choices(scenario: Scenario) -> tuple[VariedChoice, ...]:
    """The fields of a scenario of which a sweep may compare several words."""
    found = []
    for path in CHOSEN:
        try:
            value = scenario.get(path)
        except ScenarioError:
            continue
        usable = tuple(word for word in options(path) if word == value or _is_valid(scenario, path, word))
        if len(usable) > 1:
            found.append(VariedChoice(path, value, usable))
    return tuple(found)


def _is_valid(scenario: Scenario, path: str, word: str) -> bool:
    try:
        scenario.replace({path: word})
    except ScenarioError:
        return False
    return True


def varied_fields(scenario: Scenario) -> tuple[VariedField, ...]:
    """Every field of a scenario that is one number, in the scenario's order."""
    found = []
    for path in value_paths(scenario):
        value = scenario.get(path)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or set(NOT_VARIED) & set(path.split(".")):
            continue
        about = scenario.about(path)
        if about.low < about.high:
            found.append(VariedField(path, float(value), about, isinstance(value, int)))
    return tuple(found)
