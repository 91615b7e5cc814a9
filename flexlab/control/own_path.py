"""Paths in plain Python, as the engine sees them: a model of their options, and the table of poses that they gave.

The text of a path is part of the scenario (`trajectory.source`), and so is the table of its poses: the engine follows the
spline through them, and a replay or a scenario from elsewhere needs nothing else. The text runs only if this process was told
to allow it, when the table does not belong to text and options; here, or in a process of its own (`own_path_hosts`).
"""

import hashlib
import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from flexlab.compiled import pluggable
from flexlab.control import own_law_hosts as permission
from flexlab.control.own_kinds import OWN_PLACE, OwnKinds, source_field
from flexlab.control.own_path_hosts import poses_of
from flexlab.control.own_path_sampling import from_text, sampled, to_text
from flexlab.control.path import PATHS, Path, Trajectory
from flexlab.control.paths.table import along_pieces, polynomials
from flexlab.errors import FlexlabError
from flexlab.own_laws.declaration import digest
from flexlab.own_laws.running_text import TextProblem
from flexlab.own_paths.declaration import PathDeclaration, read_path_declaration
from flexlab.quantities import Number, quantity

LONGEST_TABLE = 200_000
"""Characters of a table in letters."""
MILLI = 1e-3
RECORD = np.dtype([("start", "f8"), ("period", "f8")])
"""What the kernel takes besides the table; a period of 0: the path ends."""
TABLES_KEPT = 128
"""Tables that need not be made again when an option comes back to where it was."""
COMPUTED = ("trajectory.source", "trajectory.table", "trajectory.table_of")
"""Fields that go with every change of such a path, so that a recording of the change is complete."""
RESERVED = ("rows", "span", "end", "window")
"""What every path says of itself, besides its fields."""


class OwnTrajectory(Trajectory):
    """What all paths in Python share."""

    repeats: ClassVar[bool] = False
    options: ClassVar[tuple[str, ...]] = ()
    """Names of the options, in the order of their declaration."""

    start: Number = quantity(0.0, title="Its t = 0 is at", symbol="t_0", unit="s", low=-1e6, high=1e6)
    source: str = source_field("", "path")
    table: str = Field("", max_length=LONGEST_TABLE, title="Poses of the path")
    """`own_path_sampling.to_text` of rows (t, x, y, θ)."""
    table_of: str = Field("", max_length=64, title="What the poses belong to")
    """Digest of the text and the options."""

    def __reduce__(self) -> Any:
        """For other processes, which make the class themselves from the text."""
        return _restored, (self.model_dump(),)

    @model_validator(mode="after")
    def _has_its_table(self) -> "OwnTrajectory":
        wanted = _digest_of(self)
        if self.table_of != wanted or _rows(self.table) is None:
            try:
                table = _made_tables.get(wanted) or _make_table(self, wanted)
            except (TextProblem, FlexlabError) as error:
                raise PydanticCustomError("path", "{text}", {"text": str(error).rstrip(".")}) from None
            vars(self).update(table=table, table_of=wanted)
            self.model_fields_set.update(("table", "table_of"))
        return self

    @property
    def rows(self) -> np.ndarray:
        """(t, x, y, θ), (N, 4), s, m, m, rad."""
        rows = _rows(self.table)
        assert rows is not None
        return rows

    @property
    def slowest_period(self) -> float:
        """s."""
        return float(self.rows[-1, 0])

    @property
    def span(self) -> float:
        """s."""
        return self.slowest_period if self.repeats else self.start + self.slowest_period

    @property
    def end(self) -> float | None:
        """s."""
        return None if self.repeats else self.span

    @property
    def jumps(self) -> bool:
        """Where it ends, even the velocity may."""
        return not self.repeats

    @property
    def kinks(self) -> tuple[float, ...]:
        """Both ends, if it has any."""
        return () if self.repeats else self.window

    @property
    def window(self) -> tuple[float, float]:
        """s."""
        return (0.0, self.span) if self.repeats else (self.start, self.span)

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """Another option: as far along as it was; a path that has ended begins anew."""
        if "start" in changes or not isinstance(changed, OwnTrajectory):
            return changed
        if not self.repeats:
            return changed if time <= self.span else changed.model_copy(update={"start": _now(time)})
        phase = math.modf((time - self.start) / self.slowest_period)[0]
        return changed.model_copy(update={"start": time - phase * changed.slowest_period})

    def taken_up(self, old: Trajectory, given: Collection[str], time: float) -> Trajectory:
        """From its beginning, now."""
        return self if "start" in given else self.model_copy(update={"start": _now(time)})


def _now(time: float) -> float:
    return round(time / MILLI) * MILLI


def _restored(data: dict[str, Any]) -> OwnTrajectory:
    """What `__reduce__` took apart."""
    return OWN_PATHS.restored(data)


def _digest_of(path: OwnTrajectory) -> str:
    options = {name: getattr(path, name) for name in path.options}
    return hashlib.sha256(f"{digest(path.source)} {json.dumps(options)}".encode()).hexdigest()[:16]


@lru_cache(maxsize=TABLES_KEPT)
def _rows(table: str) -> np.ndarray | None:
    rows = from_text(table)
    if rows is not None:
        rows.flags.writeable = False
    return rows


@lru_cache(maxsize=TABLES_KEPT)
def _pieces(table: str, repeats: bool) -> np.ndarray:
    rows = _rows(table)
    assert rows is not None
    return polynomials(rows, "round" if repeats else "free")


_made_tables: dict[str, str] = {}
"""Table by digest of text and options, of the texts that ran here; the oldest go first."""


def _make_table(path: OwnTrajectory, name: str) -> str:
    """Have the text give its poses. Raises `TextProblem` or `ScenarioError`."""
    if not permission.is_allowed(path.source):
        raise TextProblem(
            f"The path {path.kind} came with this scenario as Python code, which does not run by itself, and without the poses "
            "for these options. If you know who wrote it and have read it, allow it: give its file with --path."
        )
    flat = [np.atleast_1d(np.asarray(getattr(path, option), float)) for option in path.options]
    sizes = [_option_size(type(path), option) for option in path.options]
    numbers = np.concatenate([np.zeros(0), *(np.broadcast_to(a, n) for a, n in zip(flat, sizes, strict=True))])
    file = permission.file_of(path.source).replace("\\", "/").rpartition("/")[2]
    table = to_text(sampled(lambda shares: poses_of(path.source, numbers, shares), path.repeats, file))
    while len(_made_tables) >= TABLES_KEPT:
        _made_tables.pop(next(iter(_made_tables)), None)
    _made_tables[name] = table
    return table


def _option_size(model: type[OwnTrajectory], option: str) -> int:
    return 3 if model.model_fields[option].annotation == float | tuple[float, float, float] else 1


@pluggable
def own_path(path, rows, t, desired):
    """The spline through the table's poses from the start on; a path with a period comes round again."""
    own = t - path.start
    if path.period > 0:
        own -= math.floor(own / path.period) * path.period
        if own >= path.period:
            own -= path.period
    along_pieces(rows, own, desired)


@dataclass(frozen=True)
class PythonPath(Path):
    """A path in Python, complete. Compared by what it declares."""

    declaration: PathDeclaration | None = None

    @property
    def record(self) -> np.dtype:  # type: ignore[override]  # Computed there, and kept: one for all here.
        """The same for all: so the kernel is compiled once."""
        return RECORD

    def numbers(self, trajectory: Trajectory) -> np.ndarray:
        """Start and period."""
        assert isinstance(trajectory, OwnTrajectory)
        return np.array([(trajectory.start, trajectory.slowest_period if trajectory.repeats else 0.0)], RECORD)


def own_path_of(source: str, file: str, kind: str = "") -> PythonPath:
    """The path that a text declares, under another name if one is given. Raises `ScenarioError` with file and line."""
    declared = read_path_declaration(source, file)
    model = OWN_PATHS.model(declared, declared.options, source, file, kind or declared.kind, RESERVED)
    model.repeats, model.options = declared.repeats, tuple(option for option, _ in declared.options)

    def rows(trajectory: Any) -> np.ndarray:
        return _pieces(trajectory.table, trajectory.repeats)

    return PythonPath(model, own_path, rows, OWN_PLACE, declared)


def same_options(one: PythonPath, other: PythonPath) -> bool:
    """Whether two paths have the same options and last in the same way."""
    parts = [(path.declaration.repeats, path.declaration.options) for path in (one, other) if path.declaration]
    return parts[0] == parts[1]


OWN_PATHS = OwnKinds(
    PATHS, PythonPath, OwnTrajectory, "trajectory", "path", "path", "option", own_path_of, same_options
)
add_own_path, with_known_path = OWN_PATHS.add, OWN_PATHS.named


def needs_running(trajectory: Trajectory, changes: Mapping[str, Any]) -> bool:
    """Whether changes of a scenario with this path may have a text in Python run, which takes its time."""
    whole = changes.get("trajectory", {})
    kind = changes.get("trajectory.kind", whole.get("kind", trajectory.kind))
    path = PATHS.all().get(kind)
    if not isinstance(path, PythonPath):
        return False
    wanted = {
        "trajectory",
        "trajectory.kind",
        "trajectory.source",
        *(f"trajectory.{name}" for name in path.model.options),
    }
    return not wanted.isdisjoint(changes)


def with_table(changes: Mapping[str, Any], changed: Trajectory) -> dict[str, Any]:
    """Changes that made a scenario's path `changed`, with text and table if it is one in Python: complete for a recording."""
    if not isinstance(changed, OwnTrajectory) or not needs_running(changed, changes):
        return dict(changes)
    return {**changes, **{path: getattr(changed, path.rpartition(".")[2]) for path in COMPUTED}}
