"""A page in HTML, as notebooks show it in their cell."""

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
