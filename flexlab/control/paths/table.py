"""A path as a table of poses over time, joined by a quintic spline."""

from collections.abc import Callable, Collection, Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from flexlab.compiled import inlined, pluggable
from flexlab.control.path import Path, Trajectory, at_nearest_turn
from flexlab.numerics.linear_algebra import product, solve
from flexlab.quantities import Number, Quartet, quantity
from flexlab.text import number_text

MOST_ROWS = 10_000
LARGEST_GAP = 20.0
"""Longest step of the times over their median: beyond it rows are missing, and the spline would overshoot in the gap."""
DEGREE = 5
FREE_ROWS = DEGREE + 1
"""Rows needed for a spline with free ends."""
CHECKED_PER_ROW = 4
"""Instants between two rows at which the reach is checked."""
MILLI = 1e-3


class Table(Trajectory):
    """x_d(t) is the quintic spline through the rows (t, x, y, θ): four times continuously differentiable.

    The first row's pose is held before it, the last row's pose after it. `ends`: "at rest" (velocity and acceleration are
    zero at both ends, so that nothing jumps there), or "free" (a spline without knots next to its ends, for rows cut out of a
    longer motion; the target's velocity jumps where it begins and stops).
    """

    kind: Literal["table"] = "table"
    rows: Annotated[tuple[Quartet, ...], Field(min_length=2, max_length=MOST_ROWS)] = quantity(
        ((0.0, 0.0, 0.65, 0.0), (0.5, 0.1, 0.8, 0.1), (1.0, 0.0, 0.85, 0.0)), "Rows (t, x, y, θ)", unit="s, m, m, rad",
        low=-1e6, high=1e6,
    )  # fmt: skip
    ends: Literal["at rest", "free"] = quantity("at rest", "Ends of the table")
    start: Number = quantity(0.0, "Its t = 0 is at", "t_0", "s", low=0, high=1e6)

    @model_validator(mode="after")
    def _goes_on_in_time(self) -> "Table":
        time = np.array([row[0] for row in self.rows])
        steps = np.diff(time)

        def at(k: int) -> str:
            return f"{number_text(time[k], 9)} s"

        wrong, late = np.flatnonzero(steps <= 0), np.flatnonzero(steps > LARGEST_GAP * np.median(steps))
        if time[0] < 0:
            raise _row_error(1, f"t = {at(0)} lies before the start: begin at 0 s or later")
        if len(wrong):
            k = int(wrong[0]) + 1
            raise _row_error(k + 1, f"t = {at(k)} does not come after the {at(k - 1)} of row {k}: times must rise")
        if len(late):
            k = int(late[0]) + 1
            raise _row_error(
                k + 1,
                f"t jumps from {at(k - 1)} to {at(k)}, more than {number_text(LARGEST_GAP)} times the usual step: "
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
        """When it ends, s."""
        return self.span

    @property
    def jumps(self) -> bool:
        """True with free ends, where even the velocity jumps."""
        return self.ends == "free"

    @property
    def discontinuities(self) -> tuple[float, ...]:
        """Both ends: between them the spline is smooth."""
        return self.window

    @property
    def window(self) -> tuple[float, float]:
        """Its beginning and end, s."""
        return self.start + self.rows[0][0], self.span

    @property
    def slowest_period(self) -> float:
        """Its duration, s."""
        return self.window[1] - self.window[0]

    @property
    def instants(self) -> np.ndarray:
        """The time of every row and a few instants between two rows, s."""
        time = self.start + np.array([row[0] for row in self.rows])
        between = np.linspace(time[:-1], time[1:], CHECKED_PER_ROW, endpoint=False, axis=1)
        return np.append(between, time[-1])

    def place_text(self, time: float) -> str:
        """The pose with its row."""
        times = self.start + np.array([row[0] for row in self.rows])
        k = int(np.searchsorted(times, time, "right"))
        exact = k > 0 and times[k - 1] == time
        rows = f"row {k}" if exact else f"between rows {max(k, 1)} and {min(k + 1, len(times))}"
        return f"the desired pose ({rows} of the table)"

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """With other rows it begins now."""
        if "rows" not in changes or "start" in changes:
            return changed
        return changed.model_copy(update={"start": round(time / MILLI) * MILLI})

    def taken_up(self, old: Trajectory, given: Collection[str], time: float) -> Trajectory:
        """It begins now; default rows are moved to the old path's middle."""
        usual: dict[str, Any] = {"start": round(time / MILLI) * MILLI}
        if "rows" not in given:
            moved = np.array(self.rows) + [0.0, *np.subtract(at_nearest_turn(old.middle, old, time), self.middle)]
            usual["rows"] = tuple(map(tuple, moved.tolist()))
        return self.model_copy(update={name: value for name, value in usual.items() if name not in given})


def _row_error(row: int, text: str) -> PydanticCustomError:
    return PydanticCustomError("path", "row {row}: {text}", {"row": row, "text": text})


@lru_cache(maxsize=16)
def pieces(rows: tuple[tuple[float, ...], ...], ends: str) -> np.ndarray:
    """`polynomials` of a path's rows."""
    return polynomials(np.array(rows), ends)


def polynomials(table: np.ndarray, ends: str) -> np.ndarray:
    """The quintic spline through rows (t, x, y, θ): rows (time of the knot, s; of each axis six coefficients, highest first).

    `ends` as of `Table`, or "round": it repeats.
    """
    unit = 2.0 ** np.frexp(np.median(np.diff(table[:, 0])))[1]
    h, poses = np.diff(table[:, 0]) / unit, table[:, 1:]
    slopes = _slopes(h, poses, ends)
    last = len(h)
    found = np.zeros((last + 1, 1 + 3 * FREE_ROWS))
    found[:, 0] = table[:, 0]
    coefficients = found[:, 1:].reshape(last + 1, 3, FREE_ROWS)
    coefficients[:, :, DEGREE] = poses
    taylor = _taylor(h[:, None], poses[:-1], poses[1:], slopes[:-1], slopes[1:])
    for power, values in enumerate(taylor, 1):
        coefficients[:last, :, DEGREE - power] = values / unit**power
    found.flags.writeable = False
    return found


def spline(table: np.ndarray, ends: str) -> Callable[[np.ndarray], np.ndarray]:
    """The spline of `polynomials` as a function of times (N,) within the table's, returning poses (N, 3)."""
    rows = polynomials(table, ends)
    coefficients = rows[:, 1:].reshape(-1, 3, FREE_ROWS)

    def at(times: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(rows[:, 0], times, "right") - 1, 0, len(rows) - 2)
        dt, found = (times - rows[k, 0])[:, None], np.zeros((len(times), 3))
        for power in range(FREE_ROWS):
            found = found * dt + coefficients[k, :, power]
        return found

    return at


def _taylor(h: np.ndarray, p0: np.ndarray, p1: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> tuple[np.ndarray, ...]:
    """First to fifth Taylor coefficient of the quintic over h between poses p and rates u = (v, a), (..., 2, k)."""
    (v0, a0), (v1, a1) = np.moveaxis(u0, -2, 0), np.moveaxis(u1, -2, 0)
    way, half = (p1 - p0) / h, h / 2
    cubic = (10 * way - 6 * v0 - 4 * v1 - half * (3 * a0 - a1)) / (h * h)
    quartic = (-15 * way + 8 * v0 + 7 * v1 + half * (3 * a0 - 2 * a1)) / (h * h * h)
    quintic = (6 * way - 3 * (v0 + v1) - half * (a0 - a1)) / (h * h * h * h)
    return v0, a0 / 2, cubic, quartic, quintic


def _slopes(h: np.ndarray, poses: np.ndarray, ends: str) -> np.ndarray:
    """Rates and accelerations (N, 2, 3) of the spline at its knots, with continuous third and fourth derivatives."""
    N = len(poses)
    # The solution with rest at both ends, and the effect of a rate or an acceleration at either end.
    values, given = np.zeros((N, 7)), np.zeros((2, 2, 7))
    values[:, :3] = poses
    given[0, :, 3:5] = given[1, :, 5:7] = np.eye(2)
    slopes = _between_ends(h, values, given)
    if ends == "at rest":
        return slopes[:, :, :3]
    jets = np.stack(_taylor(h[:, None], values[:-1], values[1:], slopes[:-1], slopes[1:]))
    if ends == "free":
        # The fifth derivative is continuous, too, at the two knots next to each end.
        missing = jets[4, [1, 2, N - 3, N - 2]] - jets[4, [0, 1, N - 4, N - 3]]
    else:
        step = h[-1]
        third = 6 * jets[2, -1] + step * (24 * jets[3, -1] + step * 60 * jets[4, -1])
        fourth = 24 * jets[3, -1] + step * 120 * jets[4, -1]
        missing = np.stack([*(slopes[-1] - slopes[0]), third - 6 * jets[2, 0], fourth - 24 * jets[3, 0]])
    shares = solve(missing[:, 3:], -missing[:, :3])
    return slopes[:, :, :3] + product(slopes[:, :, 3:], shares)


def _between_ends(h: np.ndarray, values: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Rates and accelerations (N, 2, k) for values (N, k), with those `given` (2, 2, k) at the first knot and the last."""
    inverse = 1 / h
    square = inverse * inverse
    cube = square * inverse
    way = np.diff(values, axis=0) * cube[:, None]
    left, right = slice(None, -1), slice(1, None)
    before = np.array([[-24 * square[left], -3 * inverse[left]], [-168 * cube[left], -24 * square[left]]])
    after = np.array([[24 * square[right], -3 * inverse[right]], [-168 * cube[right], 24 * square[right]]])
    own = np.array(
        [
            [36 * (square[right] - square[left]), 9 * (inverse[left] + inverse[right])],
            [-192 * (cube[left] + cube[right]), 36 * (square[left] - square[right])],
        ]
    )
    steep = way * inverse[:, None]
    sums = np.stack([60 * (way[right] - way[left]), -360 * (steep[left] + steep[right])], axis=1)
    found = np.concatenate([given[:1], sums, given[1:]])
    before, own, after = (np.moveaxis(each, 2, 0) for each in (before, own, after))
    through = np.zeros((2, 2))
    kept = np.zeros_like(after)
    for k, (low, middle, high) in enumerate(zip(before.tolist(), own, after, strict=True)):
        # Eliminate the knot before, which is `found` less `through` times this one.
        (l00, l01), (l10, l11) = low
        lower = np.array(low)
        block = middle - lower[:, :1] * through[0] - lower[:, 1:] * through[1]
        (m00, m01), (m10, m11) = block.tolist()
        determinant = m00 * m11 - m01 * m10
        one = found[k + 1, 0] - l00 * found[k, 0] - l01 * found[k, 1]
        other = found[k + 1, 1] - l10 * found[k, 0] - l11 * found[k, 1]
        found[k + 1, 0] = (m11 * one - m01 * other) / determinant
        found[k + 1, 1] = (m00 * other - m10 * one) / determinant
        through = np.stack([m11 * high[0] - m01 * high[1], m00 * high[1] - m10 * high[0]]) / determinant
        kept[k] = through
    for k in range(len(kept), 0, -1):
        found[k] -= kept[k - 1, :, :1] * found[k + 1, 0] + kept[k - 1, :, 1:] * found[k + 1, 1]
    return found


@inlined
def row_before(rows, t):
    """Index of the last row with a first column of at most t, 0 if there is none; the first column increases."""
    low, high = 0, len(rows)
    while high - low > 1:
        middle = (low + high) // 2
        if rows[middle, 0] <= t:
            low = middle
        else:
            high = middle
    return low


@inlined
def along_pieces(rows, own, desired):
    """The polynomial of the row before the table's time `own`, s; outside the table, the pose at its end."""
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
