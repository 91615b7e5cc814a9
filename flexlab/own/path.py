"""Paths in Python as the engine sees them: a model of their options, and a table of their poses.

Text and table are part of the scenario (`trajectory.source`, `trajectory.table`). The engine follows the spline through the
table, so that a replay runs no code. The text runs only if it was allowed, to make a table for other options or another text.

A spline of degree five through the poses at N + 1 equally spaced instants is compared with the function at two places in every
interval, one of them irregular, so that no period of the function hides a difference. N doubles until they agree.
"""

import base64
import binascii
import json
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from flexlab.compiled import pluggable
from flexlab.control.path import PATHS, Path, Trajectory
from flexlab.control.paths.table import FREE_ROWS, along_pieces, polynomials, spline
from flexlab.errors import FlexlabError
from flexlab.files import short_hash
from flexlab.own import hosts
from flexlab.own.declaration import PathDeclaration, Setting, read_path_declaration
from flexlab.own.endless_calls import CALLS
from flexlab.own.kinds import MODELS_KEPT, OWN_PLACE, OwnKinds, field_of, flat_numbers, source_field
from flexlab.own.reading import TextProblem
from flexlab.quantities import Number, quantity
from flexlab.text import number_text

LONGEST_TABLE = 200_000
"""Characters of a table as text."""
MILLI = 1e-3
RECORD = np.dtype([("start", "f8"), ("period", "f8")])
"""Numbers of the kernel besides the table; a period of 0 means that the path ends."""
TABLES_KEPT = 128
"""How many tables are kept, for options that return to an earlier value."""
COMPUTED = ("trajectory.source", "trajectory.table", "trajectory.table_of")
"""Fields that are recorded with every change of such a path."""

FEWEST, MOST = 64, 4096
"""Intervals of a table."""
AGREED = 1e-9
"""Allowed error of the spline, m and rad: a hundred thousandth of the paper's deflection."""
TOLERATED = 1e-6
"""Allowed error, m and rad, for a function whose acceleration jumps: more intervals help it little."""
SMOOTH = 8.0
"""Least factor by which halving the intervals reduces the difference of a smooth function."""
ROUND = 1e-6
"""Allowed difference between the two ends of a period, m and rad."""
GOLDEN = 0.5 * (np.sqrt(5) - 1)
FARTHEST = 1e6
"""m and rad: the largest coordinate of a pose."""
COLUMNS = 4

Poses = Callable[[np.ndarray], tuple[float, np.ndarray]]
"""Shares of a path's length (N,) → its length, s, and the poses there, (N, 3)."""


class OwnTrajectory(Trajectory):
    """Settings of a path in Python."""

    repeats: ClassVar[bool] = False
    options: ClassVar[tuple[tuple[str, Setting], ...]] = ()
    """The options, in the order of their declaration."""

    start: Number = quantity(0.0, "Its t = 0 is at", "t_0", "s", low=-1e6, high=1e6)
    source: str = source_field("", "path")
    table: str = Field("", max_length=LONGEST_TABLE, title="Poses of the path")
    """The rows (t, x, y, θ) as `to_text` writes them."""
    table_of: str = Field("", max_length=64, title="What the poses belong to")
    """Digest of the text and the options that gave the table."""

    def __reduce__(self) -> Any:
        """Another process makes the class anew from the text."""
        return _restored, (self.model_dump(),)

    @model_validator(mode="after")
    def _has_its_table(self) -> "OwnTrajectory":
        chosen = json.dumps({name: getattr(self, field_of(name, type(self))) for name, _ in self.options})
        wanted = short_hash(f"{short_hash(self.source)} {chosen}")
        if self.table_of != wanted or from_text(self.table) is None:
            try:
                options = flat_numbers(self, self.options).tobytes()
                table = _made_table(self.kind, self.source, self.repeats, options)
            except (TextProblem, FlexlabError) as error:
                raise PydanticCustomError("path", "{text}", {"text": str(error).rstrip(".")}) from None
            vars(self).update(table=table, table_of=wanted)
            self.model_fields_set.update(("table", "table_of"))
        return self

    @property
    def rows(self) -> np.ndarray:
        """(t, x, y, θ), (N, 4), s, m, m, rad."""
        rows = from_text(self.table)
        assert rows is not None
        return rows

    @property
    def slowest_period(self) -> float:
        """Time in which the whole path is seen once, s."""
        return float(self.rows[-1, 0])

    @property
    def span(self) -> float:
        """Time after which the path repeats or ends, s."""
        return self.slowest_period if self.repeats else self.start + self.slowest_period

    @property
    def end(self) -> float | None:
        """Time at which the path ends, s; None if it repeats."""
        return None if self.repeats else self.span

    @property
    def jumps(self) -> bool:
        """Whether the path has ends, at which even the velocity may jump."""
        return not self.repeats

    @property
    def discontinuities(self) -> tuple[float, ...]:
        """Instants of both ends, s; none if the path repeats."""
        return () if self.repeats else self.window

    @property
    def window(self) -> tuple[float, float]:
        """First and last instant between which the whole path is seen once, s."""
        return (0.0, self.span) if self.repeats else (self.start, self.span)

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """With other options the path is as far along as before; one that has ended begins anew."""
        if "start" in changes or not isinstance(changed, OwnTrajectory):
            return changed
        if not self.repeats:
            return changed if time <= self.span else changed.model_copy(update={"start": _now(time)})
        phase = math.modf((time - self.start) / self.slowest_period)[0]
        return changed.model_copy(update={"start": time - phase * changed.slowest_period})

    def taken_up(self, old: Trajectory, given: Collection[str], time: float) -> Trajectory:
        """This path, beginning now."""
        return self if "start" in given else self.model_copy(update={"start": _now(time)})


def _now(time: float) -> float:
    return round(time / MILLI) * MILLI


def _restored(data: dict[str, Any]) -> OwnTrajectory:
    return OWN_PATHS.restored(data)


@lru_cache(maxsize=TABLES_KEPT)
def _pieces(table: str, repeats: bool) -> np.ndarray:
    rows = from_text(table)
    assert rows is not None
    return polynomials(rows, "round" if repeats else "free")


@lru_cache(maxsize=TABLES_KEPT)
def _made_table(kind: str, source: str, repeats: bool, options: bytes) -> str:
    """Run the text for the table of its poses; `options`: their numbers. Raises `TextProblem` or `ScenarioError`."""
    if not hosts.is_allowed(source):
        raise TextProblem(
            f"The path {kind} came with this scenario as Python code, which does not run by itself, and without the poses "
            "for these options. If you know who wrote it and have read it, allow it: give its file with --path."
        )
    file = hosts.file_of(source).replace("\\", "/").rpartition("/")[2]

    def poses(shares: np.ndarray) -> tuple[float, np.ndarray]:
        with CALLS.call(source):
            return hosts.host("path", source).poses(np.frombuffer(options), shares)

    return to_text(sampled(poses, repeats, file))


@pluggable
def own_path(path, rows, t, desired):
    """The spline through the table's poses, repeated if the path has a period."""
    own = t - path.start
    if path.period > 0:
        own -= math.floor(own / path.period) * path.period
        if own >= path.period:
            own -= path.period
    along_pieces(rows, own, desired)


@dataclass(frozen=True, kw_only=True)
class PythonPath(Path):
    """A path in Python, compared by its declaration."""

    declaration: PathDeclaration

    @property
    def record(self) -> np.dtype:
        """One type for all paths in Python, so that the kernel is compiled once."""
        return RECORD

    def numbers(self, trajectory: Trajectory) -> np.ndarray:
        """Start and period."""
        assert isinstance(trajectory, OwnTrajectory)
        return np.array([(trajectory.start, trajectory.slowest_period if trajectory.repeats else 0.0)], RECORD)


@lru_cache(maxsize=MODELS_KEPT)
def own_path_of(source: str, file: str, kind: str = "") -> PythonPath:
    """The path that a text declares, under another name if one is given. Raises `ScenarioError` with file and line."""
    declared = read_path_declaration(source, file)
    model = OWN_PATHS.model(declared, source, file, kind or declared.kind)
    model.repeats, model.options = declared.repeats, declared.settings
    return PythonPath(model, own_path, lambda own: _pieces(own.table, own.repeats), OWN_PLACE, declaration=declared)


OWN_PATHS = OwnKinds(PATHS, PythonPath, OwnTrajectory, "trajectory", "path", "path", "option", own_path_of)
add_own_path, with_known_path = OWN_PATHS.add, OWN_PATHS.named


def needs_running(trajectory: Trajectory, changes: Mapping[str, Any]) -> bool:
    """Whether these changes of a scenario with this path may run a text in Python, which can take long."""
    whole = changes.get("trajectory", {})
    kind = changes.get("trajectory.kind", whole.get("kind", trajectory.kind))
    path = PATHS.all().get(kind)
    if not isinstance(path, PythonPath):
        return False
    names = ("kind", "source", *(field_of(name, path.model) for name, _ in path.model.options))
    return not {"trajectory", *(f"trajectory.{name}" for name in names)}.isdisjoint(changes)


def with_table(changes: Mapping[str, Any], changed: Trajectory) -> dict[str, Any]:
    """The changes that made a scenario's path `changed`, with its text and table if it is in Python, for recordings."""
    if not isinstance(changed, OwnTrajectory) or not needs_running(changed, changes):
        return dict(changes)
    return {**changes, **{path: getattr(changed, path.rpartition(".")[2]) for path in COMPUTED}}


def sampled(poses: Poses, repeats: bool, file: str) -> np.ndarray:
    """Rows (t, x, y, θ), (N + 1, 4), of a path. Raises `TextProblem` if no spline can follow it."""
    count, before = FEWEST, np.inf
    span, grid = poses(np.linspace(0.0, 1.0, count + 1))
    _check_size(grid, span, file)
    if repeats:
        _check_round(grid, span, file)
    while True:
        if repeats:
            grid[-1] = grid[0]
        place = np.arange(count)
        shares = np.concatenate([(place + 0.5) / count, (place + (place * GOLDEN) % 1.0) / count])
        _, between = poses(shares)
        _check_size(between, span, file)
        rows = np.column_stack([np.linspace(0.0, 1.0, count + 1) * span, grid])
        differences = np.abs(spline(rows, "round" if repeats else "free")(shares * span) - between).max(axis=1)
        worst = float(differences.max())
        if worst <= AGREED or (worst <= TOLERATED and worst > before / SMOOTH):
            return rows
        if count == MOST:
            if worst <= TOLERATED:
                return rows
            at = float(shares[differences.argmax()]) * span
            raise TextProblem(
                f"{file}: near t = {number_text(at)} s it turns too sharply: a spline through {MOST + 1} poses is "
                f"{number_text(1e3 * worst, 2)} mm or mrad off there. Is there a jump or a corner? Round it off, or give the "
                "path a shorter duration."
            )
        finer = np.empty((2 * count + 1, 3))
        finer[::2], finer[1::2] = grid, between[:count]
        grid, before, count = finer, worst, 2 * count


def _check_size(poses: np.ndarray, span: float, file: str) -> None:
    if np.abs(poses).max() > FARTHEST:
        raise TextProblem(
            f"{file}: a pose within its {number_text(span)} s is more than {number_text(FARTHEST)} m or rad away."
        )


def _check_round(grid: np.ndarray, span: float, file: str) -> None:
    gap = np.abs(grid[-1] - grid[0])
    if gap.max() > ROUND:
        name, unit = [("x", "m"), ("y", "m"), ("θ", "rad")][int(gap.argmax())]
        raise TextProblem(
            f"{file}: after its period of {number_text(span)} s it is not where it began: {name} differs by "
            f"{number_text(float(gap.max()), 3)} {unit}. "
            "Make position(period) equal to position(0), or declare duration instead of period."
        )


def to_text(rows: np.ndarray) -> str:
    """A table as base64 of little-endian float64, row by row."""
    return base64.b64encode(rows.astype("<f8").tobytes()).decode()


@lru_cache(maxsize=TABLES_KEPT)
def from_text(text: str) -> np.ndarray | None:
    """The table (N, 4) that `to_text` was given, read only; None for any other text."""
    try:
        numbers = np.frombuffer(base64.b64decode(text, validate=True), "<f8")
    except (ValueError, binascii.Error):
        return None
    if len(numbers) % COLUMNS or not FREE_ROWS <= len(numbers) // COLUMNS <= MOST + 1:
        return None
    rows = numbers.reshape(-1, COLUMNS).astype(float)
    rows.flags.writeable = False
    usable = np.isfinite(rows).all() and rows[0, 0] == 0 and (np.diff(rows[:, 0]) > 0).all()
    return rows if usable and np.abs(rows).max() <= FARTHEST else None
