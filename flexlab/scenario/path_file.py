"""A path from a CSV file: t, x, y and θ in columns with their units, as the path `table` of a scenario."""

import csv
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from flexlab.control.law import LAWS
from flexlab.control.path import PATHS
from flexlab.control.paths.table import MOST_ROWS
from flexlab.errors import PresetError
from flexlab.files import cells, check_ordinary, separator, table_lines
from flexlab.own.files import path_kind
from flexlab.scenario.scenario import Scenario, parse_scenario
from flexlab.text import counted, typed_number, visible

COLUMNS = {"t": "time", "x": "length", "y": "length", "theta": "angle"}
"""Column → its quantity."""
NAMES = {"t": "t", "time": "t", "x": "x", "y": "y", "theta": "theta", "θ": "theta"}
"""Names of columns in a header, in lower case."""
UNITS = {
    "time": {"s": 1.0, "ms": 1e-3},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180},
}
"""Quantity → its units and their size, SI. A column without a unit is in the first."""
HEADER = "t [s], x [m], y [m], theta [rad]"
LONGEST_FILE = 5_000_000
"""The most bytes of a file: ten times what the most rows need."""


def with_path(scenario: Scenario, path: Any) -> Scenario:
    """The scenario on a path given by its kind, by a CSV file, by the Python file that defines it, or as a class of `OwnPath`.

    Raises `PresetError` or `ScenarioError`.
    """
    return path_choice(path)(scenario)


def path_choice(path: Any) -> Callable[[Scenario], Scenario]:
    """A function that does as `with_path`, with the path read once. Raises `PresetError`, and the function `ScenarioError`."""
    if isinstance(path, (str, Path)) and str(path).lower().endswith(".csv"):
        rows = read_path_file(path)
        return lambda scenario: parse_scenario(dict(scenario) | {"trajectory": {"kind": "table", "rows": rows}})
    change = {"trajectory.kind": known_kind("trajectory.kind", path_kind(path))}
    return lambda scenario: scenario.replace(change)


def known_kind(field: str, kind: str) -> str:
    """The kind of a law or a path. Raises `ScenarioError` for one that no scenario can have."""
    if kind not in {"controller.kind": LAWS, "trajectory.kind": PATHS}[field].all():
        Scenario().replace({field: kind})
    return kind


def read_path_file(file: str | Path) -> tuple[tuple[float, float, float, float], ...]:
    """Rows (t, x, y, θ) of a CSV file, s, m, m, rad. Raises `PresetError`."""
    try:
        check_ordinary(Path(file))
        with open(file, "rb") as stream:
            content = stream.read(LONGEST_FILE + 1)
    except (OSError, ValueError) as error:  # ValueError: no file has such a name
        why = error.strerror if isinstance(error, OSError) else "no file has such a name"
        raise PresetError(f"{file!s:.200} cannot be read: {why}.") from None
    return decoded_path(content, str(file))


def decoded_path(content: bytes, name: str) -> tuple[tuple[float, float, float, float], ...]:
    """As `read_path_file`, for the content of a file called `name`."""
    if len(content) > LONGEST_FILE:
        raise PresetError(f"{name} is too long: a path has {MOST_ROWS} rows at most.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise PresetError(f"{name} is not a text file in UTF-8: give a CSV file with the columns {HEADER}.") from None
    lines = [(number, line) for number, line in _cells(text, name) if any(cell.strip() for cell in line)]
    if not lines:
        raise PresetError(f"{name} is empty: give a CSV file with the columns {HEADER}.")
    places = _columns(lines[0][1], name)
    rows = [_row(line, places, f"{name}, row {k} (line {number})") for k, (number, line) in enumerate(lines[1:], 1)]
    if not 2 <= len(rows) <= MOST_ROWS:
        below = "1 row below" if len(rows) == 1 else f"{len(rows)} rows below"
        raise PresetError(f"{name} has {below} its header: a path needs 2 to {MOST_ROWS}.")
    return tuple(rows)


def _cells(text: str, name: str) -> Iterator[tuple[int, list[str]]]:
    """The number of each line, and its cells, with points for decimal commas."""
    lines = list(table_lines(text.splitlines()))
    between = separator(lines[0][1]) if lines else ""
    try:
        for number, line in lines:
            for row in cells([line], between, strict=True):
                # A comma that does not separate columns is a decimal comma.
                yield number, row if between == "," else [cell.replace(",", ".") for cell in row]
    except csv.Error as error:
        raise PresetError(f"{name} is not a CSV file: {error}.") from None


def _columns(header: list[str], name: str) -> dict[str, tuple[int, float]]:
    """Column → its index and the size of its unit."""
    found: dict[str, tuple[int, float]] = {}
    for place, cell in enumerate(header):
        match = re.fullmatch(r"\s*([^\s\[(]+)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*", cell)
        column = NAMES.get(match[1].lower()) if match else None
        if match is None or column is None:
            raise PresetError(
                f"{name}: {visible(cell.strip(), 40)!r} is not a column of a path: name the columns {HEADER} in its first line."
            )
        if column in found:
            raise PresetError(f"{name} has the column {column} twice: keep one of them.")
        units = UNITS[COLUMNS[column]]
        unit = match[2] or next(iter(units))
        if unit not in units:
            raise PresetError(
                f"{name}: {visible(unit, 20)!r} is not a unit of the column {column}: choose {', '.join(units)}."
            )
        found[column] = place, units[unit]
    missing = [column for column in COLUMNS if column not in found]
    if missing:
        raise PresetError(f"{name} lacks the column {', '.join(missing)}: name the columns {HEADER} in its first line.")
    return found


def _row(line: list[str], places: dict[str, tuple[int, float]], where: str) -> tuple[float, float, float, float]:
    if len(line) != len(places):
        raise PresetError(f"{where} has {counted(len(line), 'value')}, not {len(places)}.")
    found: dict[str, float] = {}
    for column, (place, size) in places.items():
        value = typed_number(line[place]) * size
        if not math.isfinite(value):
            raise PresetError(f"{where}: {column} = {visible(line[place].strip(), 40)!r} is not a finite number.")
        found[column] = value
    return found["t"], found["x"], found["y"], found["theta"]
