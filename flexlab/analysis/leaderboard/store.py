"""Rows on disk, each under a key of what it depends on: whatever else changes, the row stays.

The store also knows which rows the last table showed.
"""

import ast
import hashlib
import json
import platform
import secrets
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
import numpy as np
import scipy

from flexlab.analysis.leaderboard.case import SAMPLE_PERIOD, Case, Variant
from flexlab.analysis.leaderboard.entry import Row
from flexlab.assets import web_assets_folder
from flexlab.control.law import laws
from flexlab.errors import StudyError
from flexlab.own.law import PythonLaw
from flexlab.own.link import address_in
from flexlab.recording.run_info import package_version
from flexlab.recording.store.notes import is_regular, replacing
from flexlab.scenario import Scenario
from flexlab.text import syntax_tree

DIGITS = 16
"""Of a key, hexadecimal."""
LAWS, CASES = "flexlab.control.laws.", "flexlab.analysis.leaderboard.cases."
COMMON = ("engine", "version", "machine", "seed")
"""What all rows of a table have in common that one machine computed at once."""
_THIS_PROCESS = secrets.token_hex()
_PACKAGE = Path(__file__).resolve().parents[2]
_ROOMS = ("physics", "control", "sim", "scenario", "own", "analysis/metrics")
_FILES = ("compiled.py", "numba_internals.py", "signal.py", "quantities.py", "boundaries.py")
_HERE = ("case.py", "entry.py")


def digest(parts: Iterable[bytes | str]) -> str:
    """`DIGITS` hexadecimal digits of some texts, one after the other."""
    found = hashlib.sha256()
    for part in parts:
        raw = part.encode() if isinstance(part, str) else part
        found.update(len(raw).to_bytes(8, "big") + raw)
    return found.hexdigest()[:DIGITS]


@cache
def engine() -> str:
    """What computes rows here besides the law itself: flexlab's sources without those of laws, and versions of libraries."""
    laws_folder = _PACKAGE / "control" / "laws"
    files = [file for room in _ROOMS for file in sorted((_PACKAGE / room).rglob("*.py"))]
    files = [file for file in files if laws_folder not in file.parents]
    files += [_PACKAGE / name for name in _FILES] + [Path(__file__).with_name(name) for name in _HERE]
    versions = [package_version(), numba.__version__, np.__version__, scipy.__version__, platform.python_version()]
    return digest([*versions, *(part for file in files for part in (file.name, file.read_bytes()))])


def machine() -> str:
    """The processor, for whose instructions the engine is compiled: another one may round otherwise."""
    return f"{platform.machine()} {llvmlite.binding.get_host_cpu_name()}"


def law_source(scenario: Scenario) -> str:
    """A digest of the files in which a scenario's law is written: its own, and those of laws that it uses.

    A law in Python stands in the scenario itself; what a program elsewhere computes is known to this process alone, as the
    next one may find another program there.
    """
    controller: Any = scenario.controller
    slow = getattr(controller, "slow", None)
    kinds = [controller.kind] + ([slow.kind] if slow is not None else [])
    known = [laws()[kind] for kind in kinds]
    found = _digest_of(tuple(law.model.__module__ for law in known if not isinstance(law, PythonLaw)))
    return digest([found, _THIS_PROCESS]) if address_in(getattr(controller, "source", "")) else found


@cache
def _digest_of(modules: tuple[str, ...]) -> str:
    """Of the modules, and those of the laws' folder that they import, and so on."""
    found: set[str] = set()
    left = list(modules)
    while left:
        module = left.pop()
        if module not in found:
            found.add(module)
            imported = [n.module for n in ast.walk(syntax_tree(_text(module))) if isinstance(n, ast.ImportFrom)]
            left += [name for name in imported if name is not None and name.startswith(LAWS)]
    return digest(_text(module) for module in sorted(found))


@cache
def _text(module: str) -> str:
    return _file(module).read_text(encoding="utf-8")


def _file(module: str) -> Path:
    loaded = sys.modules.get(module)
    if loaded is not None and loaded.__file__:
        return Path(loaded.__file__)
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin)


def row_key(name: str, case: Case, variant: Variant, scenario: Scenario | None, problem: str) -> str:
    """The key of a law, by its name among those that enter, in a case.

    Of the scenario or why it is none, what is done to it and measured, the law's sources, and the engine.
    """
    scores = [(score.column, score.formula, score.number, score.window) for score in case.scores]
    task = [name, case.name, variant.name, case.duration, SAMPLE_PERIOD, case.commands, scores, problem]
    metrics = sorted({score.metric.__module__ for score in case.scores})
    parts = [repr(task), *(_text(module) for module in metrics if module.startswith(CASES)), engine()]
    if scenario is not None:
        parts += [json.dumps(scenario.model_dump(mode="json"), sort_keys=True), law_source(scenario)]
    return digest(parts)


FOLDER = Path("leaderboard")
"""Where somebody works."""
ROWS, LAST = "rows", "last.json"
LARGEST = 1_000_000
"""Bytes of a file that is read."""
SHIPPED = "leaderboard.json"
"""In `web_assets`: the table that is shown before anything was computed; a test computes its rows again."""


@cache
def shipped_rows() -> tuple[Row, ...]:
    """The rows that came with flexlab, of all its laws in all cases but the long ones."""
    common, rows = _read(web_assets_folder() / SHIPPED)
    return tuple(Row.from_data(common | row) for row in rows)


def ship(rows: Sequence[Row]) -> None:
    """Make these the rows that come with flexlab; all were computed by one engine."""
    data = [row.as_data() for row in rows]
    common = {name: data[0][name] for name in COMMON}
    lines = [json.dumps({name: row[name] for name in row if name not in COMMON}, ensure_ascii=False) for row in data]
    text = ",\n".join(lines)
    (web_assets_folder() / SHIPPED).write_text(f"[{json.dumps(common)}, [\n{text}\n]]\n", encoding="utf-8")


class RowStore:
    """The rows that were computed in one place."""

    def __init__(self, folder: Path):
        self.folder = folder

    def prepare(self) -> None:
        """Make the folder. Raises `StudyError` if that cannot be."""
        with self._full(self.folder / ROWS):
            (self.folder / ROWS).mkdir(parents=True, exist_ok=True)

    def get(self, key: str) -> Row | None:
        """The row of a key; None if there is none, or its file holds something else."""
        try:
            row = Row.from_data(_read(self._path(key)))
        except (OSError, ValueError, TypeError, RecursionError):
            return None
        return row if row.key == key else None

    def put(self, row: Row) -> None:
        """Keep a row. Raises `StudyError`."""
        self._write(self._path(row.key), row.as_data())

    def put_last(self, rows: Iterable[Row]) -> None:
        """Note which rows the newest table has. Raises `StudyError`."""
        self._write(self.folder / LAST, [row.key for row in rows])

    def last(self) -> tuple[Row, ...]:
        """The rows of the newest table; empty if there is none."""
        try:
            keys = _read(self.folder / LAST)
        except (OSError, ValueError, RecursionError):
            return ()
        if not isinstance(keys, list):
            return ()
        found: Sequence[Row | None] = [self.get(key) for key in keys if isinstance(key, str) and key.isalnum()]
        return tuple(row for row in found if row is not None)

    def _path(self, key: str) -> Path:
        return self.folder / ROWS / f"{key}.json"

    def _write(self, path: Path, data: object) -> None:
        with self._full(path.parent):
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as draft:
                draft.write_text(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False), encoding="utf-8")

    @contextmanager
    def _full(self, folder: Path) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise StudyError(
                f"{folder} cannot be written ({error.strerror}): make room or choose another folder."
            ) from None


def _read(path: Path) -> Any:
    if not is_regular(path) or path.stat().st_size > LARGEST:
        raise ValueError("no ordinary file")
    return json.loads(path.read_text(encoding="utf-8"))
