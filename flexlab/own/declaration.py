"""What a person's law or path declares: settings with unit and range, memory, signals, duration.

Declarations are read without running the text, so that a menu, a shared scenario or a recording can show a law whose code
nobody has allowed to run.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from flexlab.own.reading import DeclaredClass, is_finite, kind_of
from flexlab.text import range_text

MOST_SETTINGS, MOST_SIGNALS, MOST_MEMORY = 64, 16, 256
"""The most settings, signals and numbers of memory that a text may declare."""
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-5, 0.1
"""Limits of the control period, s, as for every sampled controller."""
NAMES_OF_RUNS = frozenset(
    (
        "_sizes absent arm_input axial_load axial_load_share axial_work beam_coordinates beam_rates bound_estimates "
        "desired_pose dissipated_energy elastic_energy explanations gravity_energy having input_work internal_force "
        "joint_angle joint_torque kinetic_energy metrics midspan_deflection moving_force name own plot pose "
        "pose_acceleration pose_rate quasi_static_deflection result_hash saturated save scenario show signals slice "
        "sliding_variable spin_share status take time to_arrow to_pandas to_xarray total_energy tracking_error vibration"
    ).split()
)
"""Names that a law's signals may not have, as every run has them (`sim.samples.TAKEN`, which is not known here)."""
DEFAULT_PERIOD = 1e-3
"""Control period of a law that declares none, s."""
ON_SAVE = ("go on", "restart")
SHORTEST, LONGEST = 0.01, 1000.0
"""Limits of a path's duration or period, s."""
LASTING = ("duration", "period")
"""Attributes for the time until a path ends, or until it repeats."""


class OwnLaw:
    """Base class of a control law written in Python; it runs at control instants, `period` s apart.

    Class attributes declare it: `gain(...)`, `memory(...)`, `readout(...)`, `period` and `on_save`, with numbers written out
    in the file. `act(self, at)` returns the inputs of the arms, (arms, 3): forces in N and torques in N·m at the grips, or what
    `at.from_torques(joint_torques)` makes of joint torques. `at`: a `Measurement`. Within it `self.<gain>` is the gain's
    present value, `self.<memory>` an array to read and change, `self.<readout>` a number to set.

    `act` must follow from gains, measurement and memory alone: the engine asks twice for some instants, to check its own
    accuracy and the law, and a replay asks again. What a law needs to remember belongs in a memory, which recordings keep.
    """

    period: float = DEFAULT_PERIOD
    on_save: str = "go on"
    """What a lab does when the file is saved: "go on" with the memory as it is, or "restart" the run."""

    def act(self, at: Any) -> Any:
        """The inputs of the arms, (arms, 3), N, N, N·m."""
        raise NotImplementedError("define act(self, at)")


class OwnPath:
    """Base class of a desired motion written in Python; it is a function of time and of its options alone.

    Class attributes declare it: `option(...)`s, and either `duration` (it ends, and its last pose is held) or `period` (it
    repeats), in s, as a number, an option, or a method.
    `position(self, t)` returns x and y, m, and θ, rad, of the beam's middle `t` s after the path's start. Within it
    `self.<option>` is the option's present value.

    Its poses are computed when the path is chosen, when an option changes and when its file is saved. The payload follows a
    spline of degree five through them, which recordings keep.
    """

    def position(self, t: float) -> Any:
        """The pose x, y, θ at `t` s, m, m, rad."""
        raise NotImplementedError("define position(self, t)")


@dataclass(frozen=True)
class Setting:
    """A gain or an option: one number, or three for x, y and θ, which may also be given as one."""

    default: float | tuple[float, float, float]
    unit: str
    low: float
    high: float
    title: str = ""
    symbol: str = ""
    slider: tuple[float, float] | None = None
    logarithmic: bool = False

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return 3 if isinstance(self.default, tuple) else 1


@dataclass(frozen=True)
class Memory:
    """Numbers that a law keeps from one instant to the next, all `start` at first."""

    size: int
    start: float = 0.0


@dataclass(frozen=True)
class OwnSignal:
    """A number that a law sets at each instant, to be plotted and recorded."""

    unit: str
    title: str = ""
    symbol: str = ""


def signal_name(readout: str) -> str:
    """The name of a readout's signal in runs: its own, with an underscore if it is one of `NAMES_OF_RUNS`."""
    return f"{readout}_" if readout in NAMES_OF_RUNS else readout


def gain(
    default: float | tuple[float, float, float],
    unit: str,
    *,
    low: float,
    high: float,
    title: str = "",
    symbol: str = "",
    slider: tuple[float, float] | None = None,
    logarithmic: bool = False,
) -> Any:
    """Declare a gain of a law, or an option of a path: its default, unit and allowed range.

    A default of three numbers has one each for x, y and θ. `title`: the name on the screen, by default that of the attribute.
    `slider`: the part of the range that the slider covers, by default from `low` up to three times the default, or to `high`.
    `logarithmic`: whether the slider's scale is logarithmic.
    """
    return Setting(default, unit, low, high, title, symbol, slider, logarithmic)


def memory(size: int, start: float = 0.0) -> Any:
    """Declare `size` numbers that the law keeps from one instant to the next, all `start` at first."""
    return Memory(size, start)


def readout(unit: str, title: str = "", symbol: str = "") -> Any:
    """Declare a number that the law sets at each instant, to be plotted and recorded."""
    return OwnSignal(unit, title, symbol)


option = gain
"""Declares an option of a path, with the arguments of `gain`."""


@dataclass(frozen=True)
class Declared:
    """What is known of a law or path without running it. A run can go on with another text whose declaration is equal."""

    name: str = field(compare=False)
    """Name of the class."""
    line: int = field(compare=False)
    """Where the class begins in its file."""
    meaning: str = field(compare=False)
    """First paragraph of its docstring."""
    mistake: str = field(compare=False)
    """As for `DeclaredClass`."""
    settings: tuple[tuple[str, Setting], ...]
    """Gains or options."""

    @property
    def kind(self) -> str:
        """Its name in scenarios, such as "soft-pd"."""
        return kind_of(self.name)


@dataclass(frozen=True)
class Declaration(Declared):
    """What a law declares."""

    period: float = field(compare=False)
    """Control period, s, unless the scenario says otherwise."""
    goes_on: bool = field(compare=False)
    """Whether a run goes on, with the memory as it is, when the file is saved."""
    memory: tuple[tuple[str, Memory], ...]
    signals: tuple[tuple[str, OwnSignal], ...]


@dataclass(frozen=True)
class PathDeclaration(Declared):
    """What a path declares."""

    repeats: bool
    """Whether it has a period."""


def read_declaration(source: str, file: str) -> Declaration:
    """What the law in `source` declares. Raises `ScenarioError` with file and line where it cannot be read."""
    law = DeclaredClass(source, file, "OwnLaw", "controller.source")
    found: dict[type, list[tuple[str, Any]]] = {Setting: [], Memory: [], OwnSignal: []}
    period, on_save = DEFAULT_PERIOD, OwnLaw.on_save
    for name, value in law.attributes.items():
        if made := law.made(name, value, _MAKERS):
            found[type(made)].append((name, _checked(law, name, made, value.lineno)))
        elif name == "period":
            period = law.number(value, "period", SHORTEST_PERIOD, LONGEST_PERIOD, "s")
        elif name == "on_save":
            on_save = law.value(value)
            if on_save not in ON_SAVE:
                raise law.problem(value.lineno, f"on_save = {on_save!r} is not one of " + ", ".join(map(repr, ON_SAVE)))
    for name, example in (("period", DEFAULT_PERIOD), ("on_save", ON_SAVE[1])):
        if law.has_method(name) or any(name == declared for kind in found.values() for declared, _ in kind):
            law.note(
                law.line, f"{name} of a law is no method, property or gain: write it out, as in {name} = {example!r}"
            )
    if not law.has_method("act"):
        raise law.problem(law.line, f"{law.node.name} has no method act(self, at), which computes the inputs")
    gains, memories, signals = map(tuple, found.values())
    law.keeps(dict(gains), "use a memory for what changes, and another name for what is computed")
    law.few("gains", sum(one.size for _, one in gains), MOST_SETTINGS)
    law.few("numbers of memory", sum(one.size for _, one in memories), MOST_MEMORY)
    law.few("signals", len(signals), MOST_SIGNALS)
    return Declaration(*law.about, law.mistake, gains, period, on_save == ON_SAVE[0], memories, signals)


def read_path_declaration(source: str, file: str) -> PathDeclaration:
    """What the path in `source` declares. Raises `ScenarioError` with file and line where it cannot be read."""
    path = DeclaredClass(source, file, "OwnPath", "trajectory.source")
    options: dict[str, Setting] = {}
    lasting = [name for name in LASTING if path.has_method(name)]
    for name, value in path.attributes.items():
        if made := path.made(name, value, {"option": option}):
            options[name] = _checked_setting(path, name, made, value.lineno)
        if name in LASTING:
            lasting.append(name)
            if not made:
                path.number(value, name, SHORTEST, LONGEST, "s")
    if len(set(lasting)) != 1:
        text = f"{path.node.name} says {' and '.join(dict.fromkeys(lasting)) or 'neither duration nor period'}"
        raise path.problem(path.line, f"{text}: give duration = ... or period = ... in s, one of the two")
    if not path.has_method("position"):
        raise path.problem(path.line, f"{path.node.name} has no method position(self, t), which gives x, y and θ")
    path.keeps(options, "use another name for what is computed")
    path.few("options", sum(one.size for one in options.values()), MOST_SETTINGS)
    return PathDeclaration(*path.about, path.mistake, tuple(options.items()), lasting[0] == "period")


_MAKERS: dict[str, Callable[..., Any]] = {"gain": gain, "memory": memory, "readout": readout}


def _checked(law: DeclaredClass, name: str, made: Any, line: int) -> Any:
    """What an attribute declares. Raises `ScenarioError` if it cannot be used."""
    if isinstance(made, Setting):
        return _checked_setting(law, name, made, line)
    if isinstance(made, Memory):
        if type(made.size) is not int or not 1 <= made.size <= MOST_MEMORY or not is_finite(made.start):
            text = f"{name} = memory({made.size!r}, {made.start!r}) needs a whole number from 1 to {MOST_MEMORY}"
            raise law.problem(line, f"{text} and a finite start")
        return made
    if not all(isinstance(text, str) for text in (made.unit, made.title, made.symbol)):
        raise law.problem(line, f"{name}: unit, title and symbol of a signal are texts")
    if name in NAMES_OF_RUNS:
        what = f"the law has a signal {name}, which every run has"
        law.note(line, f"{what}: give its readout, or the unit's output, another name")
    return made


def _checked_setting(declared: DeclaredClass, name: str, gain: Setting, line: int) -> Setting:
    """A gain or an option, mended where that is a mistake only in a person's file.

    Raises `ScenarioError` for an empty range or a default outside it.
    """
    if not is_finite(gain.low) or not is_finite(gain.high) or not gain.low < gain.high:
        raise declared.problem(line, f"{name}: low = {gain.low!r} and high = {gain.high!r} are not a range")
    numbers = gain.default if isinstance(gain.default, tuple) else (gain.default,)
    if len(numbers) not in (1, 3) or not all(is_finite(one) and gain.low <= one <= gain.high for one in numbers):
        text = f"{name}: the default {gain.default!r} is outside {range_text(gain.low, gain.high)} {gain.unit}"
        raise declared.problem(line, f"{text}, or not one or three numbers")
    texts = {what: getattr(gain, what) for what in ("unit", "title", "symbol")}
    if not all(isinstance(text, str) for text in texts.values()):
        declared.note(line, f"{name}: unit, title and symbol are texts")
        gain = replace(gain, **{what: "" if text is None else str(text) for what, text in texts.items()})
    if wrong := _slider_problem(gain):
        declared.note(line, f"{name}: {wrong}")
        gain = replace(gain, slider=None, logarithmic=False)
    return gain


def _slider_problem(one: Setting) -> str:
    """What is wrong with a setting's slider; empty if nothing is."""
    about = f"slider = {one.slider!r:.60}"
    if one.slider is not None:
        ends = one.slider if isinstance(one.slider, tuple) else ()
        if len(ends) != 2 or not all(map(is_finite, ends)) or not one.low <= ends[0] < ends[1] <= one.high:
            return f"{about} is not a part of its range: give two numbers within {range_text(one.low, one.high)}"
    if not isinstance(one.logarithmic, bool):
        return f"logarithmic = {one.logarithmic!r:.60} is not usable: give True or False"
    if one.logarithmic and (one.slider or (one.low,))[0] <= 0:
        begins = about if one.slider else f"low = {one.low!r}"
        return f"a logarithmic slider begins above 0, and {begins}: give slider=(LOW, HIGH) with LOW above 0"
    return ""
