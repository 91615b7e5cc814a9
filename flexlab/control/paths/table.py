"""A path as a table of poses over time, joined by a quintic spline."""

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from flexlab.compiled import inlined, pluggable
from flexlab.control.path import Path, Trajectory
from flexlab.control.row_search import row_before
from flexlab.quantities import Number, Quartet, quantity

MOST_ROWS = 10_000
LARGEST_GAP = 20.0
"""Longest step of the times over their median: beyond it rows are missing, and the spline would swing through the gap."""
DEGREE = 5
FREE_ROWS = DEGREE + 1
"""Rows that a spline needs which is free at its ends."""
CHECKED_PER_ROW = 4
"""Instants between two rows at which the reach is checked."""
MILLI = 1e-3


class Table(Trajectory):
    """x_d(t) is the quintic spline through the rows (t, x, y, θ): four times continuously differentiable.

    Before the first row its pose is held, after the last row the last one's. `ends`: "at rest" (velocity and acceleration are
    zero at both ends, so that nothing jumps there), or "free" (a spline without knots next to its ends, for rows cut out of a
    longer motion; the target's velocity jumps where it begins and stops).
    """

    kind: Literal["table"] = "table"
    rows: Annotated[tuple[Quartet, ...], Field(min_length=2, max_length=MOST_ROWS)] = quantity(
        ((0.0, 0.0, 0.65, 0.0), (0.5, 0.1, 0.8, 0.1), (1.0, 0.0, 0.85, 0.0)),
        title="Rows (t, x, y, θ)",
        unit="s, m, m, rad",
        low=-1e6,
        high=1e6,
    )
    ends: Literal["at rest", "free"] = quantity("at rest", title="Ends of the table")
    start: Number = quantity(0.0, title="Its t = 0 is at", symbol="t_0", unit="s", low=0, high=1e6)

    @model_validator(mode="after")
    def _goes_on_in_time(self) -> "Table":
        time = np.array([row[0] for row in self.rows])
        steps = np.diff(time)
        wrong, late = np.flatnonzero(steps <= 0), np.flatnonzero(steps > LARGEST_GAP * np.median(steps))
        if time[0] < 0:
            raise _row_error(1, f"t = {time[0]:g} s lies before the start: begin at 0 s or later")
        if len(wrong):
            k = int(wrong[0]) + 1
            raise _row_error(
                k + 1, f"t = {time[k]:g} s does not come after the {time[k - 1]:g} s of row {k}: times must rise"
            )
        if len(late):
            k = int(late[0]) + 1
            raise _row_error(
                k + 1,
                f"t jumps from {time[k - 1]:g} s to {time[k]:g} s, more than {LARGEST_GAP:g} times the usual step: "
                "put in the rows that are missing",
            )
        if self.ends == "free" and len(time) < FREE_ROWS:
            raise PydanticCustomError(
                "path", "with free ends a table needs {n} rows or more: add rows or choose at rest", {"n": FREE_ROWS}
            )
        return self

    def pieces(self) -> np.ndarray:
        """Rows of `pieces` of this path."""
        return pieces(self.rows, self.ends)

    @property
    def span(self) -> float:
        """The last row's time, s."""
        return self.start + self.rows[-1][0]

    @property
    def end(self) -> float:
        """s."""
        return self.span

    @property
    def jumps(self) -> bool:
        """With free ends even the velocity."""
        return self.ends == "free"

    @property
    def kinks(self) -> tuple[float, ...]:
        """Both ends: between them the spline is smooth."""
        return self.window

    @property
    def window(self) -> tuple[float, float]:
        """s."""
        return self.start + self.rows[0][0], self.span

    @property
    def slowest_period(self) -> float:
        """s."""
        return self.window[1] - self.window[0]

    @property
    def instants(self) -> np.ndarray:
        """Every row's time and a few between two, s."""
        time = self.start + np.array([row[0] for row in self.rows])
        between = np.linspace(time[:-1], time[1:], CHECKED_PER_ROW, endpoint=False, axis=1)
        return np.append(between, time[-1])

    def place_text(self, time: float) -> str:
        """With its row."""
        times = self.start + np.array([row[0] for row in self.rows])
        k = int(np.searchsorted(times, time, "right"))
        exact = k > 0 and times[k - 1] == time
        rows = f"row {k}" if exact else f"between rows {max(k, 1)} and {min(k + 1, len(times))}"
        return f"the desired pose ({rows} of the table)"

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """Another table begins now."""
        if "rows" not in changes or "start" in changes:
            return changed
        return changed.model_copy(update={"start": round(time / MILLI) * MILLI})

    def taken_up(self, old: Trajectory, given: Collection[str], time: float) -> Trajectory:
        """From now on; rows that nobody gave lie about the old path's middle."""
        usual: dict[str, Any] = {"start": round(time / MILLI) * MILLI}
        if "rows" not in given:
            moved = np.array(self.rows) + [0.0, *np.subtract(old.middle, self.middle)]
            usual["rows"] = tuple(map(tuple, moved.tolist()))
        return self.model_copy(update={name: value for name, value in usual.items() if name not in given})


def _row_error(row: int, text: str) -> PydanticCustomError:
    return PydanticCustomError("path", "row {row}: {text}", {"row": row, "text": text})


@lru_cache(maxsize=16)
def pieces(rows: tuple[tuple[float, ...], ...], ends: str) -> np.ndarray:
    """`polynomials` of a path's rows."""
    return polynomials(np.array(rows), ends)


def spline(table: np.ndarray, ends: str) -> Any:
    """The quintic spline through rows (t, x, y, θ) as a function of time; `ends` as of `Table`, or "round": it repeats."""
    rest = [(1, np.zeros(3)), (2, np.zeros(3))]
    # Here, as every start of flexlab would wait a tenth of a second for it.
    from scipy.interpolate import make_interp_spline

    conditions: dict[str, Any] = {"at rest": (rest, rest), "free": None, "round": "periodic"}
    return make_interp_spline(table[:, 0], table[:, 1:], k=DEGREE, bc_type=conditions[ends])


def polynomials(table: np.ndarray, ends: str) -> np.ndarray:
    """The spline's polynomials, rows (time of the knot, s; of x, y, θ each the six coefficients, highest power first)."""
    through = spline(table, ends)
    knots = table[:-1, 0]
    found = np.empty((len(table), 1 + 3 * FREE_ROWS))
    found[:, 0] = table[:, 0]
    factorial = 1.0
    for power in range(FREE_ROWS):
        # Each knot's Taylor coefficients: what the spline is made of where free ends leave knots out, too.
        factorial *= max(power, 1)
        found[:-1, 1 + DEGREE - power :: FREE_ROWS] = through(knots, nu=power) / factorial
    found[-1, 1:] = 0.0
    found[-1, FREE_ROWS::FREE_ROWS] = table[-1, 1:]
    found.flags.writeable = False
    return found


@inlined
def along_pieces(rows, own, desired):
    """The polynomial of the row before the table's time `own`, s; outside the table its ends."""
    k = row_before(rows, own)
    dt = own - rows[k, 0]
    if dt < 0 or k == len(rows) - 1:
        dt = 0.0
    for a in range(3):
        first = 1 + 6 * a
        p = v = g = 0.0
        for power in range(6):
            g = g * dt + 2 * v
            v = v * dt + p
            p = p * dt + rows[k, first + power]
        desired[0, a], desired[1, a], desired[2, a] = p, v, g
        if own < rows[0, 0] or k == len(rows) - 1:
            desired[1, a] = desired[2, a] = 0.0


@pluggable
def table(path, rows, t, desired):
    """The table's poses from its start on."""
    along_pieces(rows, t - path.start, desired)


PATH = Path(Table, table, rows=Table.pieces, place=70)
