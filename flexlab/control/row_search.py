"""Where in a path's table an instant falls."""

from flexlab.compiled import inlined


@inlined
def row_before(rows, t):
    """Index of the last row whose first column is at most t, 0 if there is none; the first column rises."""
    low, high = 0, len(rows)
    while high - low > 1:
        middle = (low + high) // 2
        if rows[middle, 0] <= t:
            low = middle
        else:
            high = middle
    return low
