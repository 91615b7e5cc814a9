"""The one table of the beam's boundaries: which nodal coordinates each holds at zero."""

HELD_COORDINATES: dict[str, tuple[int, ...]] = {
    "pinned-pinned": (0, -2),
    "clamped-clamped": (0, 1, -2, -1),
    "clamped-pinned": (0, 1, -2),
    "pinned-clamped": (0, -2, -1),
    "clamped-free": (0, 1),
}
"""Indices among the 2 (n + 1) nodal coordinates (deflection, slope per node, left to right); negative from the end."""


def held_coordinates(element_count: int, boundary: str) -> list[int]:
    """Indices of the held nodal coordinates, ascending."""
    total = 2 * (element_count + 1)
    return sorted(index % total for index in HELD_COORDINATES[boundary])
