"""HTML as notebooks show it: a page in a cell, and the tables of `_repr_html_` of scenarios, runs, modes and sweeps."""

from collections.abc import Iterable, Sequence
from html import escape

CELL_HEIGHT = 640
"""px of a cell."""


class Page:
    """An HTML page that notebooks show in their cell; `html` is its text, to be saved as a file."""

    def __init__(self, html: str, height: int = CELL_HEIGHT):
        self.html, self._height = html, height

    def __repr__(self) -> str:
        return f"<Page of {len(self.html.encode()) / 1e6:.1f} MB: a notebook shows it; .html is its text>"

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" width="100%" height="{self._height}" style="border:0"></iframe>'


def html_table(rows: Iterable[Sequence[object]], heads: Sequence[str] = (), caption: str = "") -> str:
    """An HTML table of plain texts; without `heads`, each row's first cell is its head."""
    lines = []
    if heads:
        lines.append("".join(f"<th>{escape(head)}</th>" for head in heads))
    for first, *others in rows:
        mark = "td" if heads else "th"
        cells = "".join(f"<td>{escape(str(cell))}</td>" for cell in others)
        lines.append(f"<{mark}>{escape(str(first))}</{mark}>{cells}")
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"
