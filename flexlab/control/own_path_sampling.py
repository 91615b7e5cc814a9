"""Turns a path that is a function of time into a table of poses, fine enough for the spline through them.

The spline of degree five through the poses at N + 1 even instants is compared with the function between them, twice in every
interval, once at a place that no period of the function can share; N doubles until they agree.
"""

import base64
import binascii
from collections.abc import Callable

import numpy as np

from flexlab.control.paths.table import FREE_ROWS, spline
from flexlab.own_laws.running_text import TextProblem

FEWEST, MOST = 64, 4096
"""Intervals of a table."""
AGREED = 1e-9
"""m and rad between spline and function that are good enough: a hundred thousandth of the paper's deflection."""
TOLERATED = 1e-6
"""The same for a function whose acceleration jumps, which more intervals improve slowly."""
SMOOTH = 8.0
"""Factor by which half as long intervals reduce the difference at least where the function is smooth."""
ROUND = 1e-6
"""m and rad between the two ends of a period."""
GOLDEN = 0.5 * (np.sqrt(5) - 1)
FARTHEST = 1e6
"""m and rad: a pose beyond is no pose."""
COLUMNS = 4

Poses = Callable[[np.ndarray], tuple[float, np.ndarray]]
"""Shares of a path's length (N,) → its length, s, and the poses there, (N, 3)."""


def sampled(poses: Poses, repeats: bool, file: str) -> np.ndarray:
    """Rows (t, x, y, θ), (N + 1, 4), of a path. Raises `TextProblem` for one that no spline can follow."""
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
                f"{file}: near t = {at:.4g} s it turns too sharply: a spline through {MOST + 1} poses is {1e3 * worst:.2g} mm "
                "or mrad off there. Is there a jump or a corner? Round it off, or let the path last less long."
            )
        finer = np.empty((2 * count + 1, 3))
        finer[::2], finer[1::2] = grid, between[:count]
        grid, before, count = finer, worst, 2 * count


def _check_size(poses: np.ndarray, span: float, file: str) -> None:
    if np.abs(poses).max() > FARTHEST:
        raise TextProblem(f"{file}: a pose within its {span:g} s is more than {FARTHEST:g} m or rad away.")


def _check_round(grid: np.ndarray, span: float, file: str) -> None:
    gap = np.abs(grid[-1] - grid[0])
    if gap.max() > ROUND:
        name, unit = [("x", "m"), ("y", "m"), ("θ", "rad")][int(gap.argmax())]
        raise TextProblem(
            f"{file}: after its period of {span:g} s it is not where it began: {name} differs by {gap.max():.3g} {unit}. "
            "Let position(period) be position(0), or say duration instead of period."
        )


def to_text(rows: np.ndarray) -> str:
    """A table in letters, every bit kept: base64 of little-endian float64, row by row."""
    return base64.b64encode(rows.astype("<f8").tobytes()).decode()


def from_text(text: str) -> np.ndarray | None:
    """The table (N, 4) that `to_text` was given; None for any other text."""
    try:
        numbers = np.frombuffer(base64.b64decode(text, validate=True), "<f8")
    except (ValueError, binascii.Error):
        return None
    if len(numbers) % COLUMNS or not FREE_ROWS <= len(numbers) // COLUMNS <= MOST + 1:
        return None
    rows = numbers.reshape(-1, COLUMNS).astype(float)
    usable = np.isfinite(rows).all() and rows[0, 0] == 0 and (np.diff(rows[:, 0]) > 0).all()
    return rows if usable and np.abs(rows).max() <= FARTHEST else None
