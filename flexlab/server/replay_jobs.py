"""Which runs are being replayed, how far, and what came of it."""

import asyncio
from collections import OrderedDict
from dataclasses import dataclass

from flexlab.errors import FlexlabError
from flexlab.recording.store.run_index import RunRow
from flexlab.server.limits import Asker
from flexlab.server.run_jobs import replay_run
from flexlab.server.tasks import Tasks

MOST_KEPT = 200
"""Findings that are remembered."""


@dataclass(frozen=True)
class ReplayState:
    """How the replay of one run stands."""

    working: bool
    sentence: str
    kind: str = ""
    """"good" or "bad" once it is over."""


class Replays:
    """All replays of one server, at most one at a time of each run. For its event loop only."""

    def __init__(self, tasks: Tasks):
        self._all = tasks
        self._states: OrderedDict[tuple[str, int], ReplayState] = OrderedDict()
        self._tasks: set[asyncio.Task[None]] = set()

    def start(self, asker: Asker, row: RunRow) -> None:
        """Replay a run, unless that is being done. Raises `BusyError`."""
        state = self.state(row)
        if state is not None and state.working:
            return
        self._all.check(asker)
        self._note(row, ReplayState(True, "Replay: waiting for its turn"))
        task = asyncio.create_task(self._replay(asker, row))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def state(self, row: RunRow) -> ReplayState | None:
        """How the run's replay stands; None if nobody asked for one since the file last changed."""
        return self._states.get(_key(row))

    async def _replay(self, asker: Asker, row: RunRow) -> None:
        def report(share: float) -> None:
            self._note(row, ReplayState(True, f"Replay: {100 * share:.0f} %"))

        try:
            agrees, text = await self._all.run(asker, replay_run, row.path, on_progress=report)
        except FlexlabError as error:
            self._note(row, ReplayState(False, f"Not replayed: {error}", "bad"))
        else:
            self._note(row, ReplayState(False, text, "good" if agrees else "bad"))

    def _note(self, row: RunRow, state: ReplayState) -> None:
        self._states[_key(row)] = state
        while len(self._states) > MOST_KEPT:
            self._states.popitem(last=False)


def _key(row: RunRow) -> tuple[str, int]:
    return row.id, row.size
