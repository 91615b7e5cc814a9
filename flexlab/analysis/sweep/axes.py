"""The fields that a study varies over a range or a list of values, and the fields that forms offer."""

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flexlab.errors import ScenarioError, StudyError
from flexlab.own.files import LAW_FILES, PATH_FILES
from flexlab.quantities import Quantity
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import TITLES, options, titled
from flexlab.scenario.settings import parse_value
from flexlab.scenario.validation_errors import LONGEST, field_paths, unknown_field, value_paths
from flexlab.text import number_text, visible

LINEAR, LOGARITHMIC = "lin", "log"
ONE = "payload.bending_stiffness=1:1000:log:25"
EXAMPLE = f"{ONE}, or controller.kind=pd,computed-torque"
KINDS = {"controller.kind": LAW_FILES, "trajectory.kind": PATH_FILES}
"""Fields whose values may also be files, classes or addresses."""
DEFAULT_COUNT = 10
"""Number of values in a range without a count."""
MOST_VALUES = 1_000_000
"""Most values in a range: all are in memory before anything is computed."""


@dataclass(frozen=True)
class Axis:
    """One varied field. `values` are for a grid; a sampling design takes any value between the limits."""

    path: str
    values: tuple[Any, ...]
    low: float | None = None
    """Limits of a range; None: the axis is a list of values."""
    high: float | None = None
    logarithmic: bool = False
    whole: bool = False
    """Whether the field takes whole numbers only."""

    @property
    def numeric(self) -> bool:
        """Whether all its values are numbers."""
        return all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in self.values)

    def at(self, share: float) -> Any:
        """The value at a share, 0 <= share < 1, of the range; on a logarithmic one, equal shares are equal ratios."""
        if self.low is None or self.high is None:
            return self.values[int(share * len(self.values))]
        if self.logarithmic:
            return self._fit(self.low * (self.high / self.low) ** share)
        return self._fit(self.low + (self.high - self.low) * share)

    def _fit(self, value: float) -> float:
        return float(round(value)) if self.whole else value

    def as_data(self) -> dict[str, Any]:
        """The axis as plain data, for a key and for a file."""
        names = ("path", "low", "high", "logarithmic")
        return {name: getattr(self, name) for name in names} | {"values": list(self.values)}


def parse_axes(vary: Mapping[str, Any] | Sequence[str], scenario: Scenario, argument: str = "vary") -> tuple[Axis, ...]:
    """The axes from `path=range` texts, or from a mapping of paths to ranges (as text) or lists of values.

    A range is `low:high`, optionally `lin` or `log`, and optionally a count: "1:1000:log:25"; a law or path may be given by
    its file, class or address. `argument`: the name of `vary` in errors. Raises `StudyError` or `ScenarioError`.
    """
    if isinstance(vary, Mapping):
        items = [(str(path), given) for path, given in vary.items()]
    elif isinstance(vary, Sequence) and not isinstance(vary, str) and all(isinstance(text, str) for text in vary):
        items = [_split(text) for text in vary]
    else:
        raise StudyError(f"{argument} = {_shown(vary)} is not usable: give a dictionary or a list, as in [{ONE!r}].")
    if not items:
        raise StudyError(f"Nothing is varied: say what, as in {EXAMPLE}.")
    paths = [path for path, _ in items]
    for path in paths:
        if paths.count(path) > 1:
            raise StudyError(f"{_shown(path)} is varied twice: give it one range.")
    return tuple(_axis(path, given, scenario) for path, given in items)


def _split(text: str) -> tuple[str, str]:
    path, equals, given = (part.strip() for part in text.partition("="))
    if not (equals and path and given):
        raise StudyError(f"{_shown(text)} does not say what to vary: write {EXAMPLE}.")
    return path, given


def _axis(path: str, given: Any, scenario: Scenario) -> Axis:
    whole, about = False, None
    try:
        whole, about = isinstance(scenario.get(path), int), scenario.about(path)
    except ScenarioError:
        known = set(field_paths(Scenario))
        if path not in known:
            raise ScenarioError([(path, unknown_field(visible(path, LONGEST), known))]) from None
    words = not isinstance(given, str) or path in KINDS or given.lstrip().startswith(("{", "[", '"'))
    is_range = not words and ":" in given
    axis = _range(path, given, whole) if is_range else Axis(path, _list(path, given))
    if about is not None and axis.numeric:
        for value in axis.values:
            if not about.low <= value <= about.high:
                text = f"{path} = {number_text(value, 6)}{about.unit_text()} is outside the allowed range {about.range_text()}"
                raise StudyError(f"{text}: choose a range within it.")
    return axis


def _range(path: str, text: str, whole: bool) -> Axis:
    words = [word.strip() for word in text.split(":")]
    wrong = StudyError(f"{path}={_shown(text)} is not a range: write LOW:HIGH, LOW:HIGH:COUNT or LOW:HIGH:log:COUNT.")
    logarithmic = words[2:3] == [LOGARITHMIC]
    if words[2:3] in ([LINEAR], [LOGARITHMIC]):
        del words[2]
    if len(words) not in (2, 3):
        raise wrong
    try:
        low, high = float(words[0]), float(words[1])
        count = int(words[2]) if len(words) == 3 else DEFAULT_COUNT
    except ValueError:
        raise wrong from None
    if not (math.isfinite(low) and math.isfinite(high)):
        raise wrong
    if not math.isfinite(high - low):
        raise StudyError(f"{path}={_shown(text)} is too wide: choose limits that are nearer to each other.")
    if low >= high:
        raise StudyError(f"{path}={text} is empty or reversed: write the smaller limit first.")
    if not 2 <= count <= MOST_VALUES:
        asked = f"{path}={_shown(text)} asks for {visible(words[2], 20)} values"
        raise StudyError(f"{asked}: a range has 2 to {MOST_VALUES}.")
    if logarithmic and low <= 0:
        raise StudyError(f"{path}={text} is logarithmic and begins at {low:g}: begin above 0, or leave log out.")
    points = np.geomspace(low, high, count) if logarithmic else np.linspace(low, high, count)
    values = [float(round(point)) if whole else float(point) for point in points]
    return Axis(path, tuple(dict.fromkeys(values)), low, high, logarithmic, whole)


def _list(path: str, given: Any) -> tuple[Any, ...]:
    values = given
    if isinstance(given, str):
        values = parse_value(f"[{given}]", path)
        values = values if isinstance(values, list) else [parse_value(word.strip(), path) for word in given.split(",")]
    if hasattr(values, "tolist"):  # An array, or a column of a table.
        values = values.tolist()
    if not isinstance(values, Sequence) or isinstance(values, (str, bytes, bytearray)):
        values = [values]
    if path in KINDS:
        values = KINDS[path].kinds_of(values)
    try:
        plain = json.loads(json.dumps(list(values), allow_nan=False, default=lambda one: one.tolist()))
        _ = [float(value) for value in plain if isinstance(value, int)]  # Fails for one that no float can hold.
    except (AttributeError, TypeError, ValueError, OverflowError):
        unusable = f"{path} = {_shown(given)} is not usable"
        raise StudyError(f"{unusable}: give a range as text, or a list of values.") from None
    if not plain:
        raise StudyError(f"{path} has no values: zero cells cannot be computed; give one value at least.")
    return tuple(tuple(value) if isinstance(value, list) else value for value in plain)


def _shown(value: Any) -> str:
    return visible(" ".join(repr(value).split()), LONGEST)


NOT_VARIED = ("simulation", "transition", "elbow", "seed")
"""Parts of paths that forms do not offer: integration, the transition after a change in motion, numbers that are labels."""
CHOSEN = ("controller.kind", "trajectory.kind", "trajectory.shaper", "payload.damping.kind", "payload.boundary")
"""Fields with a few options, which a sweep may compare."""
AROUND = 4.0
"""The range of a field without a slider extends from its value divided by this to its value times this."""


class VariedField(NamedTuple):
    """A numeric field that a form offers."""

    path: str
    value: float
    """The scenario's value."""
    about: Quantity
    whole: bool
    """Whether the field takes whole numbers only."""

    @property
    def words(self) -> str:
        """Title, symbol and unit of the field."""
        return titled(self.about) + (f" ({self.about.unit})" if self.about.unit_text() else "")

    @property
    def part(self) -> str:
        """The title of the scenario's part that has the field."""
        first, _, rest = self.path.partition(".")
        return first.replace("_", " ").capitalize() if rest else "Scenario"

    @property
    def range(self) -> tuple[float, float]:
        """The proposed range: the slider's, or one around the value, within the allowed limits."""
        if self.about.slider is not None:
            return self.about.slider
        if self.value == 0:
            return max(self.about.low, 0.0), min(self.about.high, 1.0)
        low, high = sorted((self.value / AROUND, self.value * AROUND))
        return max(self.about.low, low), min(self.about.high, high)

    @property
    def logarithmic(self) -> bool:
        """Whether the proposed range is logarithmic."""
        return self.about.logarithmic and self.range[0] > 0


class VariedChoice(NamedTuple):
    """A field with a few options."""

    path: str
    value: str
    """The scenario's value."""
    options: tuple[str, ...]
    """The options with which the scenario is valid."""

    @property
    def words(self) -> str:
        """The title of the field."""
        return TITLES[self.path]


def varied_choices(scenario: Scenario) -> tuple[VariedChoice, ...]:
    """The fields of a scenario whose options a sweep may compare."""
    found = []
    for path in CHOSEN:
        if not scenario.has(path):
            continue
        value = scenario.get(path)
        usable = []
        for word in options(path):
            with suppress(ScenarioError):
                scenario.replace({path: word})
                usable.append(word)
        if len(usable) > 1:
            found.append(VariedChoice(path, value, tuple(usable)))
    return tuple(found)


def varied_fields(scenario: Scenario) -> tuple[VariedField, ...]:
    """Every numeric field of a scenario that a form offers, in the scenario's order."""
    found = []
    for path in value_paths(scenario):
        value = scenario.get(path)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or set(NOT_VARIED) & set(path.split(".")):
            continue
        about = scenario.about(path)
        if about.low < about.high:
            found.append(VariedField(path, float(value), about, isinstance(value, int)))
    return tuple(found)
