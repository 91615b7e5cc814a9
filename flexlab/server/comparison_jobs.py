"""The comparisons that were made last: overlays as files of the server's own, bounded, gone when it closes."""

import asyncio
import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

from flexlab.recording.store.run_index import RunRow
from flexlab.server.limits import Asker
from flexlab.server.run_jobs import ComparisonTables, compare_runs
from flexlab.server.tasks import Tasks

MOST_KEPT = 8
"""Comparisons that are kept: enough to go back and forth."""
MOST_BYTES = 1_000_000_000
"""Of all their files; the newest one is always kept."""


class Comparisons:
    """All comparisons of one server. For its event loop only."""

    def __init__(self, tasks: Tasks, folder: Path):
        """`folder`: where the overlays lie; somebody else removes it."""
        self._tasks, self._folder = tasks, folder
        self._made: OrderedDict[str, ComparisonTables] = OrderedDict()
        self._making: dict[str, asyncio.Future[ComparisonTables]] = {}

    async def get(self, asker: Asker, rows: Sequence[RunRow]) -> tuple[str, ComparisonTables]:
        """(id, tables) of the comparison of these runs, made if need be. Raises `FlexlabError` if they cannot be compared."""
        key = hashlib.sha256(repr([(row.id, row.size) for row in rows]).encode()).hexdigest()[:24]
        if key in self._made and self._path(key).exists():
            self._made.move_to_end(key)
            return key, self._made[key]
        if key not in self._making:
            # Two who ask at once share what the first one's question starts.
            self._making[key] = asyncio.ensure_future(self._make(asker, key, rows))
            self._making[key].add_done_callback(lambda _: self._making.pop(key, None))
        return key, await asyncio.shield(self._making[key])

    def file(self, key: str) -> Path | None:
        """The overlay; None if it is no more."""
        return self._path(key) if key in self._made else None

    async def _make(self, asker: Asker, key: str, rows: Sequence[RunRow]) -> ComparisonTables:
        tables = await self._tasks.run(asker, compare_runs, tuple(row.path for row in rows), self._path(key))
        self._made[key] = tables
        await asyncio.to_thread(self._make_room)
        return tables

    def _make_room(self) -> None:
        while len(self._made) > 1 and (len(self._made) > MOST_KEPT or self._bytes() > MOST_BYTES):
            key, _ = self._made.popitem(last=False)
            self._path(key).unlink(missing_ok=True)

    def _bytes(self) -> int:
        return sum(self._path(key).stat().st_size for key in self._made if self._path(key).exists())

    def _path(self, key: str) -> Path:
        return self._folder / f"comparison-{key}.rrd"
