"""Tables for notebooks: what `_repr_html_` of scenarios, runs, modes and sweeps is made of."""

from collections.abc import Iterable, Sequence
from html import escape


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
