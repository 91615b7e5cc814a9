"""The stiffness and damping with which a scenario's beam rings as measured, and measurements in CSV files."""

import csv
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlab.analysis.identification.estimates import Estimate, RingFit
from flexlab.analysis.modes import modes
from flexlab.errors import FlexlabError, StudyError
from flexlab.files import cells, check_ordinary, separator, table_lines
from flexlab.scenario import Scenario
from flexlab.text import counted, visible

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "min": 60.0}
"""Unit → s."""
SIGNAL_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "cm": 1e-2}
"""Unit → m. Other units are kept, as frequency and damping do not depend on them."""
LONGEST_NAME = 60
GAP = 1.5
"""Step between two samples, in median steps, above which there is a gap."""
LARGEST_FILE = 500_000_000
"""Largest file that is read, bytes; all of it is in memory."""


class Measured(NamedTuple):
    """Samples of a measurement."""

    time: np.ndarray
    """s, rising, (N,)."""
    signal: np.ndarray
    """In `unit`, (N,)."""
    unit: str
    notes: tuple[str, ...]
    """Sentences on missing samples."""


SHORTEST_STEP, LONGEST_STEP, LATEST = 1e-9, 1e6, 1e12
"""Shortest and longest time between samples, and largest time, s; beyond these, squares of times lose digits."""
LARGEST_SIGNAL = 1e100
"""Largest value of a signal in any unit: its square must be finite."""


def read_measured(path: Path, time: str | None = None, signal: str | None = None) -> Measured:
    """Two columns of a CSV file, named by `time` and `signal`, with a unit in brackets if the file does not give it.

    "t [ms]" is the column `t` or `t [ms]`; None: the first and the second column. Rows without a number are left out
    and counted. Raises `StudyError`.
    """
    names, rows, comma = _read(path)
    if names and all(math.isfinite(_number(names, place, comma)) for place in range(len(names))):
        raise StudyError(
            f"{path} begins with numbers: write the columns' names and units above them, as in t [s],w [mm]."
        )
    wide = next((row for row in rows if not comma and any(row[len(names) :])), None)
    if wide is not None:  # As 0,001,0,5 is: its numbers would be 0 and 1.
        raise StudyError(
            f"{path} has {counted(len(names), 'name')} above a row of {counted(len(wide), 'value')}, "
            f"{visible(','.join(wide), LONGEST_NAME)}: name every column, and separate numbers with decimal commas by ;."
        )
    t_place, t_unit = _column(path, names, time, 0)
    y_place, y_unit = _column(path, names, signal, 1)
    if t_place == y_place:
        both = visible(names[t_place], LONGEST_NAME)
        raise StudyError(f"{path}: {both} cannot be both time and signal: name two columns.")
    if t_unit and t_unit not in TIME_UNITS:
        known = ", ".join(dict.fromkeys(TIME_UNITS))
        raise StudyError(f"{path}: {visible(t_unit, LONGEST_NAME)} is not a unit of time: choose one of {known}.")
    if not t_unit:
        raise StudyError(
            f"{path}: the unit of time is not known: say it, as in --time '{visible(names[t_place], LONGEST_NAME)} [ms]'."
        )
    pairs = np.array([(_number(row, t_place, comma), _number(row, y_place, comma)) for row in rows]).reshape(-1, 2)
    good = np.isfinite(pairs).all(axis=1)
    t, y = pairs[good].T * np.array([[TIME_UNITS[t_unit]], [SIGNAL_UNITS.get(y_unit, 1.0)]])
    if len(t) < 2:
        raise StudyError(f"{path} has no two rows with numbers in both columns{_first(rows)}: check names and numbers.")
    back = np.flatnonzero(np.diff(t) <= 0) + 1
    if len(back):
        row = np.flatnonzero(good)[back[0]] + 1
        raise StudyError(
            f"{path}: time does not rise at row {row} of the data, t = {t[back[0]]:.9g} s: sort or clean it."
        )
    notes = []
    if not good.all():
        first = visible(", ".join(rows[int(np.argmin(good))]), LONGEST_NAME)
        notes.append(f"{np.sum(~good)} of {len(good)} rows have no number and are left out, the first being {first}.")
    steps = np.diff(t)
    if not SHORTEST_STEP <= np.median(steps) <= LONGEST_STEP or np.abs(t).max() > LATEST:
        usual = f"{np.median(steps):.3g} s apart, up to t = {t[np.abs(t).argmax()]:.3g} s"
        raise StudyError(f"{path}: samples are {usual}, which is not a vibration of a beam: check the unit of time.")
    if np.abs(y).max() > LARGEST_SIGNAL:
        raise StudyError(f"{path}: the signal reaches {np.abs(y).max():.3g}, over {LARGEST_SIGNAL:g}: check its unit.")
    gaps = steps > GAP * np.median(steps)
    if gaps.any():
        usual = f"where samples are {np.median(steps):.3g} s apart"
        notes.append(f"{counted(int(gaps.sum()), 'gap')}, the longest {steps.max():.3g} s {usual}.")
    unit = "m" if y_unit in SIGNAL_UNITS else visible(y_unit, LONGEST_NAME)
    return Measured(t, y, unit, tuple(notes))


def _read(path: Path) -> tuple[list[str], list[list[str]], bool]:
    """The columns' names, the rows, and whether numbers may have a decimal comma because commas do not separate columns."""
    try:
        check_ordinary(path)
        if path.stat().st_size > LARGEST_FILE:
            raise StudyError(f"{path} is larger than {LARGEST_FILE // 1_000_000} MB: cut out what is to be fitted.")
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = (line for _, line in table_lines(file))
            first = next(lines, "")
            between = separator(first)
            names = next(cells([first], between), [])
            return [name.strip() for name in names], list(cells(lines, between)), between != ","
    except FileNotFoundError:
        raise StudyError(f"There is no file {path}: check the name.") from None
    except UnicodeDecodeError:
        raise StudyError(f"{path} is not text in UTF-8: save it as CSV in UTF-8.") from None
    except (OSError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise StudyError(f"{path} cannot be read as a CSV file ({visible(reason, 120)}).") from None


def _first(rows: list[list[str]]) -> str:
    return f", the first row being {visible(', '.join(rows[0]), LONGEST_NAME)}" if rows else ""


def _parts(name: str) -> tuple[str, str]:
    """Name and unit of "name [unit]" or "name (unit)"."""
    found = re.fullmatch(r"(.*?)\s*[\[(]([^\])]*)[\])]", name.strip())
    return (found[1].strip(), found[2].strip()) if found else (name.strip(), "")


def _column(path: Path, names: list[str], wanted: str | None, place: int) -> tuple[int, str]:
    if wanted is None:
        if place >= len(names):
            raise StudyError(f"{path} has {counted(len(names), 'column')}: time and a signal are needed.")
        return place, _parts(names[place])[1]
    base, unit = _parts(wanted)
    for number, name in enumerate(names):
        if name == wanted or _parts(name)[0] == base:
            return number, unit or _parts(name)[1]
    shown = ", ".join(visible(name, LONGEST_NAME) for name in names[:10])
    raise StudyError(f"{path} has no column {visible(wanted, LONGEST_NAME)!r}: it has {shown or 'none'}.")


def _number(row: list[str], place: int, comma: bool) -> float:
    try:
        text = row[place].replace("−", "-")  # As typesetting programs write it.
        return float(text.replace(",", ".") if comma else text)
    except (ValueError, IndexError):
        return math.nan


ROUNDS, CLOSE = 30, 1e-9
"""Most rounds of the search, and the relative change at which it ends."""
NUDGE, FARTHEST = 0.01, 0.7
"""First and longest step in ln EI."""
SEEN_AS = "beam mode 1"
"""Origin of the pole to which a ring belongs."""
OUT_OF_RANGE = "the value that gives this ring lies outside the range of the field"
NO_RING = "the first mode of this scenario's loop does not ring"


class BeamParameters(NamedTuple):
    """The parameters of a scenario's beam that follow from a ring."""

    bending_stiffness: Estimate
    linear_density: Estimate
    damping: Estimate
    """The value of the field `damping_field`."""
    damping_field: str
    frequency: Estimate
    """Frequency of the loudest mode at the middle pose; its interval covers the ring's other poses."""
    damping_ratio: Estimate
    scenario: Scenario
    """The scenario with the parameters that are identifiable."""


Pose = tuple[float, float, float]
"""x, y, θ; m, m, rad."""


def beam_parameters(
    fit: RingFit, scenario: Scenario, in_loop: bool, poses: Sequence[Pose] = (), other: str = ""
) -> BeamParameters:
    """EI and damping with which the first mode of `scenario` rings like `fit`; length, density and boundary are given.

    `in_loop`: whether the scenario's arms and law hold the grips, and give way a little; otherwise a vice holds them. How much
    the arms give way depends on the pose: `poses` are the ring's, the middle one first, and intervals cover the result of each;
    empty: the path's centre. `other`: why the ring is not the first mode's; empty if it is.
    """
    path = "payload.damping.ratio" if scenario.payload.damping.kind == "modal" else "payload.damping.coefficient"
    frequency, ratio = fit.first.frequency, fit.first.damping_ratio
    density = Estimate(np.nan, np.nan, np.nan, "kg/m", "a ring tells EI/ρ alone; weigh the beam for ρ")
    reason = frequency.reason or (_left_out(fit, scenario) if in_loop else "") or other
    middle, stiffness, fitted, rings = poses[0] if poses else None, np.nan, scenario, np.empty((0, 2))
    power = 0.5
    mode = cache(lambda one, pose: first_mode(one, in_loop, pose))
    try:
        if not reason:
            fitted, power = _solve_stiffness(scenario, frequency.value, lambda one: mode(one, middle)[0])
            if in_loop:  # In arms that give way, the damping changes the frequency a little.
                damped = _solve_damping(fitted, path, ratio, lambda one: mode(one, middle)[1], "", "")[1]
                fitted, power = _solve_stiffness(damped, frequency.value, lambda one: mode(one, middle)[0])
            stiffness = fitted.payload.bending_stiffness
            rings = np.array([mode(fitted, pose) for pose in poses])
    except FlexlabError as error:
        reason, stiffness, fitted = str(error) if isinstance(error, StudyError) else OUT_OF_RANGE, np.nan, scenario
    if len(rings):
        elsewhere, off = rings[0, 0] / rings[:, 0], rings[:, 1] - rings[0, 1]
        low, high = frequency.low * float(elsewhere.min()), frequency.high * float(elsewhere.max())
        frequency = replace(frequency, low=low, high=high)
        ratio = replace(ratio, low=ratio.low - float(off.max()), high=ratio.high - float(off.min()))
    spread = (np.array([frequency.low, frequency.high]) / frequency.value) ** (1 / power)
    EI = Estimate(stiffness, *map(float, stiffness * spread), "N·m²", reason)
    unit = scenario.about(path).unit_text().strip()
    damping, final = _solve_damping(fitted, path, ratio, lambda one: mode(one, middle)[1], unit, reason)
    return BeamParameters(EI, density, damping, path, frequency, ratio, final)


FINE = 32
"""Number of elements with which the first modes are those of the continuous beam, to 1e-6."""


def mesh_note(found: BeamParameters) -> str:
    """A sentence on a real beam's stiffness if it lies outside the interval of the fit, whose mesh has few elements; else "".

    Two elements ring 0.4 % too high, which is a hundred times the interval of a good measurement.
    """
    EI, few = found.bending_stiffness, found.scenario.payload.element_count
    if not EI.identifiable or few >= FINE:
        return ""
    finer = found.scenario.replace({"payload.element_count": FINE, "initial.beam_coordinates": None})
    real = EI.value * (first_mode(found.scenario, False)[0] / first_mode(finer, False)[0]) ** 2
    if EI.low <= real <= EI.high:
        return ""
    mesh = counted(few, "element")
    return f"EI belongs to a mesh of {mesh}, which rings too high: a real beam of this frequency has {real:.5g} N·m²."


def _left_out(fit: RingFit, scenario: Scenario) -> str:
    """Why the linear model of a scenario's loop cannot ring as a run did; empty if it can."""
    if scenario.grips.active:
        return "the grips give way, and the loop with which a ring is compared has rigid ones"
    change = scenario.payload.mass_change
    if change.active and fit.end > change.begin:
        return "the payload's mass changes, and a ring tells EI/ρ alone"
    return ""


ALIKE = 1.5
"""Largest ratio between a ring's frequency and its loop's first, either way; the second mode's is 2.7 times the first."""


def another_mode(fit: RingFit, scenario: Scenario, pose: Pose | None) -> str:
    """Why a run under `scenario` does not ring in its first mode; empty if it does, or if the first mode is not known.

    Other rings are an aliased one, another mode's in a window too short for the first, and that of an energy, which has twice
    the beam's frequency.
    """
    try:
        expected = first_mode(scenario, True, pose)[0]
    except FlexlabError:
        return ""
    frequency = fit.first.frequency.value
    if 1 / ALIKE <= frequency / expected <= ALIKE:
        return ""
    return f"it rings at {frequency:.4g} Hz, and the first mode of this run's loop is at {expected:.4g} Hz"


def first_mode(scenario: Scenario, in_loop: bool, pose: Pose | None = None) -> tuple[float, float]:
    """Frequency, Hz, and damping ratio of the beam's first mode, with its grips held by the arms or by a vice.

    `pose`: where the arms hold it; None: at the path's centre.
    """
    found = modes(scenario, pose)
    if not in_loop:
        return float(found.frequency[0]), float(found.damping_ratio[0])
    for pole, origin in zip(found.poles, found.pole_origin, strict=True):
        if origin == SEEN_AS and pole.imag > 0:
            return float(abs(pole)) / (2 * np.pi), float(-pole.real / abs(pole))
    raise StudyError(NO_RING)


def _solve_stiffness(
    scenario: Scenario, frequency: float, frequency_of: Callable[[Scenario], float]
) -> tuple[Scenario, float]:
    """The scenario with the stiffness that gives this frequency, and d ln f / d ln EI there, by secant steps.

    In a vice f grows as √EI. Near its buckling load a pressed beam's f grows much faster, and a long step makes it buckle.
    Raises `StudyError` if no stiffness gives this frequency.
    """
    field = "payload.bending_stiffness"

    def missing(scenario: Scenario) -> float:
        return float(np.log(frequency / frequency_of(scenario)))

    miss, step, power = missing(scenario), NUDGE, np.nan
    for _ in range(ROUNDS):
        try:
            farther = scenario.replace({field: scenario.get(field) * float(np.exp(step))})
            left = missing(farther)
        except FlexlabError:
            step /= 2
            continue
        power = (miss - left) / step
        scenario, miss = farther, left
        if abs(miss) < CLOSE:
            return scenario, power
        if not power > 0:
            break
        step = float(np.clip(miss / power, -FARTHEST, FARTHEST))
    raise StudyError(OUT_OF_RANGE)


def _solve_damping(
    scenario: Scenario, path: str, ratio: Estimate, ratio_of: Callable[[Scenario], float], unit: str, reason: str
) -> tuple[Estimate, Scenario]:
    """The damping that gives this ratio, by secant steps, as the first mode's ζ is nearly linear in it."""
    if reason or ratio.reason:
        return Estimate(np.nan, np.nan, np.nan, unit, reason or ratio.reason), scenario
    start = scenario.get(path) or 1e-6
    try:
        here, there = (ratio_of(scenario.replace({path: value})) for value in (start, 1.1 * start))
        slope = (there - here) / (0.1 * start)
        value, low, high = (start + (wanted - here) / slope for wanted in (ratio.value, ratio.low, ratio.high))
        for _ in range(ROUNDS):
            change = (ratio.value - ratio_of(scenario.replace({path: value}))) / slope
            value, low, high = value + change, low + change, high + change
            if abs(change) < CLOSE * max(abs(value), high - low):
                break
        else:
            raise StudyError(OUT_OF_RANGE)
        return Estimate(value, low, high, unit), scenario.replace({path: value})
    except FlexlabError:
        return Estimate(np.nan, np.nan, np.nan, unit, OUT_OF_RANGE), scenario
