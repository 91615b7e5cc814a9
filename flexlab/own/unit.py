"""A functional mock-up unit (FMI 2.0 or 3.0, co-simulation) as a control law: its description becomes a text in Python.

So a unit is declared, allowed, recorded and run as other laws are. The text names the file and its SHA-256; the file itself
stays where it is. Its variables' units of measure are recognised under any name.
"""

import hashlib
import itertools
import keyword
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from flexlab.errors import ScenarioError
from flexlab.files import check_ordinary
from flexlab.own.declaration import DEFAULT_PERIOD, LONGEST_PERIOD, MOST_SETTINGS, MOST_SIGNALS, SHORTEST_PERIOD
from flexlab.own.link import ASKS
from flexlab.own.reading import is_unit
from flexlab.physics.law_input import MOST_GAUGES
from flexlab.text import visible

_FMI_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")
"""Base units of FMI, without rad, which tools may leave out."""
_SPELT = (("**", "^"), ("^2", "²"), ("2", "²"), ("*", "·"), (".", "·"), (" ", "·"), ("(", ""), (")", ""), ("Nm", "N·m"))
SIDES, AXES, JOINTS = ("left", "right"), ("x", "y", "theta"), ("1", "2", "3")
_NAMED = {
    "pose": ("pose", AXES),
    "pose_rate": ("pose_rate", AXES),
    "beam_rate": ("beam_moment_rate", ("h", "g")),
    "strains": ("strain", tuple(map(str, range(MOST_GAUGES)))),
    "desired_pose": ("desired_pose", AXES),
    "desired_rate": ("desired_rate", AXES),
    "desired_acceleration": ("desired_acceleration", AXES),
    "joint_angles": ("joint_angle", JOINTS),
    "joint_rates": ("joint_rate", JOINTS),
    "weights": ("weight", AXES),
}
"""Number of `Measurement` → its name in a unit, and how the names of its parts end."""


def problem_with_unit(variable: Any, definitions: Iterable[Any], wanted: str) -> str:
    """A variable's unit of measure if it is not `wanted`; empty if it is, or if none is given."""
    from flexlab.quantities import base_exponents  # The process of a unit does not need it.

    name = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    if not name:
        return ""
    base = next((each.baseUnit for each in definitions if each.name == name), None)
    if base is None:
        return "" if _spelt(name) == wanted else name
    found = {each: getattr(base, each) for each in _FMI_BASES if getattr(base, each)}
    due = {each: power for each, power in (base_exponents(wanted) or {}).items() if each != "rad"}
    same = found == due and base.factor == 1 and base.offset == 0
    return "" if same else name


def _spelt(name: str) -> str:
    for other, ours in _SPELT:
        name = name.replace(other, ours)
    return name


def _units_of_parts(asked: str) -> dict[str, str]:
    """The names of all parts of a number of `Measurement`, in their order, with units of measure."""
    (name, ends), (shape, units) = _NAMED[asked], ASKS[asked]
    names = [f"{name}_{side}_{end}" for side in SIDES for end in ends]
    if "arms" not in shape:
        names = [f"{name}_{end}" for end in ends]
    return dict(zip(names, itertools.cycle(units.split(", ")), strict=False))


PARTS = {asked: _units_of_parts(asked) for asked in _NAMED}
INPUTS = {name: unit for parts in PARTS.values() for name, unit in parts.items()}
"""Inputs that a unit may have, with units of measure: the numbers of `Measurement`."""
GRIPS = {f"input_{side}_{axis}": unit for side in SIDES for axis, unit in zip(AXES, ("N", "N", "N·m"), strict=True)}
MOTORS: dict[str, str] = {f"motor_torque_{side}_{joint}": "N·m" for side in SIDES for joint in JOINTS}
"""Outputs that a unit has: inputs of the arms at the grips, before limits and delay, or motor torques."""

_TEXT = '''"""A control law that a functional mock-up unit computes; the file itself is not part of this text."""

from flexlab import OwnLaw, gain, memory, readout
from flexlab.own.unit_at_work import Unit


class {name}(OwnLaw):
    {meaning}

    period = {period!r}
    answered = memory(1)
{declared}
    def __init__(self):
        self.unit = Unit("{file}", "{sha256}", __file__, {gains!r}, {signals!r})

    def act(self, at):
        return self.unit.act(self, at)
'''


def text_of_unit(file: Path) -> str:
    """The text of the law that a unit computes. Raises `ScenarioError` if it cannot drive the arms."""
    try:
        check_ordinary(file)
        data = file.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: no file has such a name
        why = "there is no such file" if isinstance(error, (FileNotFoundError, ValueError)) else error.strerror
        raise _problem(file, f"cannot be read: {why}") from None
    about = _description(file)
    inputs = [each for each in about.modelVariables if each.causality == "input"]
    outputs = {each.name: each for each in about.modelVariables if each.causality == "output"}
    for each in inputs:
        if each.name not in INPUTS:
            given = "that flexlab does not have: it gives pose_x, pose_rate_x, desired_pose_x and so on"
            where = "see A unit from Simulink or Modelica in the documentation"
            raise _problem(file, f"has an input {each.name} {given} ({where})")
        _check(file, about, each, INPUTS[each.name])
    answers = GRIPS if next(iter(GRIPS)) in outputs else MOTORS
    of_one_arm = list(answers)[: len(answers) // len(SIDES)]
    missing = [name for name in of_one_arm if name not in outputs]
    if missing:
        needed = "motor_torque_left_1 to 3 and motor_torque_right_1 to 3 in N·m, or input_left_x, _y, _theta and so on"
        raise _problem(file, f"has no output {missing[0]}: a law needs {needed}")
    for name in answers:
        if name in outputs:
            _check(file, about, outputs[name], answers[name])
    others = [each for name, each in outputs.items() if name not in GRIPS | MOTORS and _is_number(each)]
    tuned = [each for each in about.modelVariables if each.causality == "parameter" and _is_number(each)]
    gains = _named((each.name for each in tuned if each.start is not None), MOST_SETTINGS)
    signals = _named((each.name for each in others), MOST_SIGNALS, gains)
    known = {each.name: each for each in about.modelVariables}
    try:
        period, declared = _period(about), [f"    {name} = {_gain(known[its])}\n" for name, its in gains.items()]
    except (ValueError, IndexError):
        what = "has a step size, or a start or limit of a parameter, that is not a finite number"
        raise _problem(file, f"{what}: export it again") from None
    declared += [
        f"    {name} = readout({_unit(known[its])!r}, {_title(known[its])!r})\n" for name, its in signals.items()
    ]
    meaning = visible(" ".join((about.description or about.modelName).split()))[:200]
    return _TEXT.format(
        name=re.sub(r"\W", "_", f"Fmu_{file.stem}", flags=re.ASCII),
        meaning=repr(f"{meaning.rstrip('.')}: computed by the unit {_file_name(file)}, FMI {about.fmiVersion}."),
        period=period,
        declared="".join(declared),
        file=_file_name(file),
        sha256=hashlib.sha256(data).hexdigest(),
        gains=gains,
        signals=signals,
    )


def unit_in(source: str, folders: Iterable[Path]) -> tuple[str, str]:
    """(name, path) of the unit that a text runs: the path is empty if no folder has the unit, both if the text runs none."""
    found = re.search(r'Unit\("([^"\\/]{1,200}\.fmu)", "([0-9a-f]{64})", __file__,', source)
    if found is None:
        return "", ""
    for folder in folders:
        file = folder / found[1]
        try:
            if file.is_file() and text_of_unit(file) == source:
                return found[1], str(file.resolve())
        except ScenarioError:
            continue
    return found[1], ""


def _file_name(file: Path) -> str:
    if not is_unit(file.name) or re.search(r'["\\\n]', file.name):
        raise _problem(file, "has a name that cannot be used: give it one of letters and digits that ends in .fmu")
    return file.name


def _description(file: Path) -> Any:
    try:
        import fmpy
    except ImportError:
        raise _problem(file, 'needs FMPy, which is not installed: pip install "flexlab[fmu]"') from None
    try:
        about = fmpy.read_model_description(str(file), validate=False)
        platforms = fmpy.supported_platforms(str(file))
    except Exception as error:
        why = visible(" ".join(str(error).split()))[:200] or type(error).__name__
        raise _problem(file, f"is not a unit that can be read ({why})") from None
    if about.fmiVersion not in ("2.0", "3.0"):
        raise _problem(file, f"is made for FMI {about.fmiVersion}: export it for 2.0 or 3.0")
    if about.coSimulation is None:
        raise _problem(file, "is not made for co-simulation: export it for that")
    if fmpy.platform not in platforms:
        there = ", ".join(platforms) or "none"
        raise _problem(file, f"has no machine code for {fmpy.platform}, only for {there}: export it for this machine")
    return about


def _is_number(variable: Any) -> bool:
    return variable.type in ("Real", "Float64") and not variable.dimensions


def _check(file: Path, about: Any, variable: Any, wanted: str) -> None:
    """Raises `ScenarioError` for a variable of another type than a number or another unit of measure than `wanted`."""
    what = f"has an {variable.causality} {variable.name}"
    if not _is_number(variable):
        raise _problem(file, f"{what} that is not a single number of double precision")
    if other := problem_with_unit(variable, about.unitDefinitions, wanted):
        raise _problem(file, f"{what} in {other}: it has to be in {wanted}")


def _named(names: Iterable[str], most: int, taken: Iterable[str] = ()) -> dict[str, str]:
    """Attribute of the class → variable of the unit, for at most `most` variables."""
    found: dict[str, str] = {}
    for its in names:
        name = re.sub(r"\W", "_", its, flags=re.ASCII).strip("_") or "number"
        if keyword.iskeyword(name) or not name[0].isalpha() or name in _RESERVED or name in found or name in taken:
            name = f"unit_{name}"
        if len(found) < most and name not in found and name not in taken:
            found[name] = its
    return found


_RESERVED = {"period", "answered", "unit", "act", "on_save", "kind", "source", "model", "control_period", "input_delay"}
_RESERVED |= {"torque_limit", "load_share", "wanted_internal_force", "sensor_noise", "memory", "gain", "readout"}
WIDE = 1e9
"""Bound of a parameter that has none."""


def _gain(variable: Any) -> str:
    """The declaration of a gain. Raises ValueError or IndexError for a start or limit that is not a finite number."""
    start = float(str(variable.start).split()[0])
    if not math.isfinite(start):
        raise ValueError
    low, high = (_bound(bound, other) for bound, other in ((variable.min, -WIDE), (variable.max, WIDE)))
    low, high = min(low, start), max(high, start)
    shown = sorted((0.0, 3 * start)) if start else (-1.0, 1.0)
    ends = max(low, shown[0]), min(high, shown[1])
    bounded = variable.min is not None and variable.max is not None
    slider = "" if bounded or not ends[0] < ends[1] else f", slider={ends}"
    return f"gain({start!r}, {_unit(variable)!r}, low={low!r}, high={high!r}, title={_title(variable)!r}{slider})"


def _bound(given: Any, otherwise: float) -> float:
    number = otherwise if given is None else float(given)
    return number if math.isfinite(number) else otherwise


def _unit(variable: Any) -> str:
    return visible(variable.unit or (variable.declaredType.unit if variable.declaredType else None) or "1")[:40]


def _title(variable: Any) -> str:
    return visible(" ".join((variable.description or variable.name).split()))[:80]


def _period(about: Any) -> float:
    """Control period, s: the unit's own step, if it names one."""
    told = [
        getattr(about.defaultExperiment, "stepSize", None),
        getattr(about.coSimulation, "fixedInternalStepSize", None),
    ]
    for each in told:
        if each is not None and SHORTEST_PERIOD <= float(each) <= LONGEST_PERIOD:
            return float(each)
    return DEFAULT_PERIOD


def _problem(file: Path, text: str) -> ScenarioError:
    return ScenarioError([("controller.source", f"{file.name} {text}.")])
