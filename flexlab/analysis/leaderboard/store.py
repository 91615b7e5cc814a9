"""Rows of the leaderboard on disk, each under a hash of everything on which it depends, and the keys of the newest table."""

import ast
import json
import platform
import secrets
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numba
import numpy as np
import scipy

from flexlab import __version__
from flexlab.analysis.leaderboard.case import SAMPLE_PERIOD, Case, Variant
from flexlab.analysis.leaderboard.entry import Row
from flexlab.assets import web_assets_folder
from flexlab.control.law import laws
from flexlab.files import make_folder, read_json, short_hash, writing
from flexlab.own.law import PythonLaw
from flexlab.own.link import address_in
from flexlab.scenario import Scenario
from flexlab.text import syntax_tree

LAWS, CASES = "flexlab.control.laws.", "flexlab.analysis.leaderboard.cases."
COMMON = ("engine", "version", "machine", "seed")
"""Fields that are the same in all rows of a table computed on one machine at one time."""
_THIS_PROCESS = secrets.token_hex()
_PACKAGE = Path(__file__).resolve().parents[2]
_ROOMS = ("numerics", "physics", "control", "sim", "scenario", "own", "analysis/metrics")
_FILES = ("compiled.py", "numba_internals.py", "signal.py", "quantities.py", "boundaries.py")
_HERE = ("case.py", "entry.py")


@cache
def engine() -> str:
    """A digest of everything that computes rows here, except the laws: flexlab's sources and the libraries' versions."""
    laws_folder = _PACKAGE / "control" / "laws"
    files = [file for room in _ROOMS for file in sorted((_PACKAGE / room).rglob("*.py"))]
    files = [file for file in files if laws_folder not in file.parents]
    files += [_PACKAGE / name for name in _FILES] + [Path(__file__).with_name(name) for name in _HERE]
    versions = [__version__, numba.__version__, np.__version__, scipy.__version__, platform.python_version()]
    return short_hash(repr([*versions, *((file.name, file.read_bytes()) for file in files)]))


def law_source(scenario: Scenario) -> str:
    """A digest of the source files of a scenario's law, and of the laws that it uses.

    The source of a law in Python is part of the scenario. The digest of a law at an address holds for this process only, as
    another program may answer there later.
    """
    controller: Any = scenario.controller
    slow = getattr(controller, "slow", None)
    kinds = [controller.kind] + ([slow.kind] if slow is not None else [])
    known = [laws()[kind] for kind in kinds]
    found = _digest_of(tuple(law.model.__module__ for law in known if not isinstance(law, PythonLaw)))
    return short_hash(found + _THIS_PROCESS) if address_in(getattr(controller, "source", "")) else found


@cache
def _digest_of(modules: tuple[str, ...]) -> str:
    """A digest of the modules and of all modules in the laws' folder that they import, directly or not."""
    found: set[str] = set()
    left = list(modules)
    while left:
        module = left.pop()
        if module not in found:
            found.add(module)
            imported = [n.module for n in ast.walk(syntax_tree(_text(module))) if isinstance(n, ast.ImportFrom)]
            left += [name for name in imported if name is not None and name.startswith(LAWS)]
    return short_hash(repr([_text(module) for module in sorted(found)]))


@cache
def _text(module: str) -> str:
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).read_text(encoding="utf-8")


def row_key(name: str, case: Case, variant: Variant, scenario: Scenario | None, problem: str) -> str:
    """The key of an entrant's row: a hash of name, case, scenario (or why it is not valid), law's sources and engine."""
    scores = [(score.column, score.formula, score.number, score.window) for score in case.scores]
    task = [name, case.name, variant.name, case.duration, SAMPLE_PERIOD, case.commands, scores, problem]
    metrics = sorted({score.metric.__module__ for score in case.scores})
    parts = [repr(task), *(_text(module) for module in metrics if module.startswith(CASES)), engine()]
    if scenario is not None:
        parts += [json.dumps(scenario.model_dump(mode="json"), sort_keys=True), law_source(scenario)]
    return short_hash(repr(parts))


FOLDER = Path("leaderboard")
"""The store's folder in the working directory."""
ROWS, LAST = "rows", "last.json"
ADVICE = "make room or choose another folder"
LARGEST = 1_000_000
"""Largest file that is read, bytes."""
SHIPPED = "leaderboard.json"
"""The file in `web_assets` with the table that ships; a test computes its rows again."""


@cache
def shipped_rows() -> tuple[Row, ...]:
    """The rows that ship with flexlab: all its laws in all cases but the long ones."""
    common, rows = read_json(web_assets_folder() / SHIPPED, LARGEST)
    return tuple(Row.from_data(common | row) for row in rows)


def ship(rows: Sequence[Row]) -> None:
    """Make these the rows that ship with flexlab; the same engine must have computed them all."""
    data = [row.as_data() for row in rows]
    common = {name: data[0][name] for name in COMMON}
    lines = [json.dumps({name: row[name] for name in row if name not in COMMON}, ensure_ascii=False) for row in data]
    text = ",\n".join(lines)
    (web_assets_folder() / SHIPPED).write_text(f"[{json.dumps(common)}, [\n{text}\n]]\n", encoding="utf-8")


@dataclass(frozen=True)
class RowStore:
    """The rows in one folder."""

    folder: Path

    def prepare(self) -> None:
        """Make the folder. Raises `StudyError` if that is not possible."""
        make_folder(self.folder / ROWS, ADVICE)

    def get(self, key: str) -> Row | None:
        """The row of a key; None if there is none or its file is damaged."""
        try:
            row = Row.from_data(read_json(self._path(key), LARGEST))
        except (OSError, ValueError, TypeError):
            return None
        return row if row.key == key else None

    def put(self, row: Row) -> None:
        """Write a row. Raises `StudyError`."""
        self._write(self._path(row.key), row.as_data())

    def put_last(self, rows: Iterable[Row]) -> None:
        """Write the keys of the newest table's rows. Raises `StudyError`."""
        self._write(self.folder / LAST, [row.key for row in rows])

    def last(self) -> tuple[Row, ...]:
        """The rows of the newest table; empty if there is none."""
        try:
            keys = read_json(self.folder / LAST, LARGEST)
        except (OSError, ValueError):
            return ()
        usable = [key for key in keys if isinstance(key, str) and key.isalnum()] if isinstance(keys, list) else []
        return tuple(row for key in usable if (row := self.get(key)) is not None)

    def _path(self, key: str) -> Path:
        return self.folder / ROWS / f"{key}.json"

    def _write(self, path: Path, data: object) -> None:
        make_folder(path.parent, ADVICE)
        with writing(path, ADVICE) as draft:
            draft.write_text(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False), encoding="utf-8")
