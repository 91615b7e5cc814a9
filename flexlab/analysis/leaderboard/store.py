"""Rows on disk, each under its key, and which of them the last table showed."""

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from flexlab.analysis.leaderboard.row import Row
from flexlab.errors import StudyError
from flexlab.recording.store.notes import is_regular, replacing

FOLDER = Path("leaderboard")
"""Where somebody works."""
ROWS, LAST = "rows", "last.json"
LARGEST = 1_000_000
"""Bytes of a file that is read."""


class RowStore:
    """The rows that were computed in one place."""

    def __init__(self, folder: Path):
        self.folder = folder

    def prepare(self) -> None:
        """Make the folder. Raises `StudyError` if that cannot be."""
        with self._full(self.folder / ROWS):
            (self.folder / ROWS).mkdir(parents=True, exist_ok=True)

    def get(self, key: str) -> Row | None:
        """The row of a key; None if there is none, or its file holds something else."""
        try:
            row = Row.from_data(_read(self._path(key)))
        except (OSError, ValueError, TypeError, RecursionError):
            return None
        return row if row.key == key else None

    def put(self, row: Row) -> None:
        """Keep a row. Raises `StudyError`."""
        self._write(self._path(row.key), row.as_data())

    def put_last(self, rows: Iterable[Row]) -> None:
        """Note which rows the newest table has. Raises `StudyError`."""
        self._write(self.folder / LAST, [row.key for row in rows])

    def last(self) -> tuple[Row, ...]:
        """The rows of the newest table; empty if there is none."""
        try:
            keys = _read(self.folder / LAST)
        except (OSError, ValueError, RecursionError):
            return ()
        if not isinstance(keys, list):
            return ()
        found: Sequence[Row | None] = [self.get(key) for key in keys if isinstance(key, str) and key.isalnum()]
        return tuple(row for row in found if row is not None)

    def _path(self, key: str) -> Path:
        return self.folder / ROWS / f"{key}.json"

    def _write(self, path: Path, data: object) -> None:
        with self._full(path.parent):
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as draft:
                draft.write_text(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False), encoding="utf-8")

    @contextmanager
    def _full(self, folder: Path) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise StudyError(
                f"{folder} cannot be written ({error.strerror}): make room or choose another folder."
            ) from None


def _read(path: Path) -> Any:
    if not is_regular(path) or path.stat().st_size > LARGEST:
        raise ValueError("no ordinary file")
    return json.loads(path.read_text(encoding="utf-8"))
