"""Long tasks with progress and results that pages show later. The number kept is bounded, and all end with the server."""

import asyncio
import contextlib
import logging
import shutil
from collections import OrderedDict
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

from flexlab.errors import FlexlabError, LabError
from flexlab.files import short_hash
from flexlab.server.limits import THE_SERVER, Limit, Visitor
from flexlab.server.tasks import Tasks

MOST_BYTES = 1_000_000_000
"""Most bytes of all files of finished tasks; the newest task keeps its files whatever their size."""
GOOD, BAD = "good", "bad"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome:
    """The result of a task's work."""

    result: Any = None
    sentence: str = "Finished."
    kind: str = GOOD


@dataclass(frozen=True)
class Task:
    """The state of one task."""

    key: str
    asker: Visitor
    folder: Path
    """Folder for its files, which the work makes if it writes any."""
    about: Any = None
    """Anything that its page wants to keep with it."""
    share: float = 0.0
    """Progress, 0 to 1."""
    working: bool = True
    sentence: str = ""
    kind: str = ""
    """"good" or "bad" once it has ended."""
    result: Any = None
    """The result of the work; None until it is finished, and if it failed or was cancelled."""
    size: int = 0
    """Size of its files, bytes."""

    def as_data(self) -> dict[str, Any]:
        """The state for the script in its page."""
        return {"working": self.working, "share": self.share, "sentence": self.sentence, "kind": self.kind}


IDLE = Task("", THE_SERVER, Path(), working=False)
"""The state of a task that was never started."""


class TaskBook:
    """All tasks of one kind on one server. To be used in its event loop only."""

    def __init__(self, tasks: Tasks, folder: Path, most_kept: int, limit: Limit | None = None, long: bool = False):
        """`folder`: parent of the tasks' folders, which the caller removes. `most_kept`: finished tasks that are kept.

        `limit`: bounds running and waiting tasks, in addition to the bounds of `Tasks`. `long`: only one runs at a time.
        """
        self._all, self._folder, self._most_kept, self._limit, self._long = tasks, folder, most_kept, limit, long
        self._tasks: OrderedDict[str, Task] = OrderedDict()
        self._jobs: dict[str, asyncio.Task[None]] = {}

    def start(
        self,
        word: str,
        key: str,
        asker: Visitor,
        work: Callable[..., Outcome],
        *arguments: Any,
        about: Any = None,
        anew: bool = True,
    ) -> Task:
        """Start or queue `work(*arguments)`, unless a task with this key is running; `word` names it, as in "Replay".

        Unless `anew`, a finished task with this key is kept, too. Work with a parameter `folder` gets the task's folder; `report`
        is as for `Tasks.run`. Raises `BusyError`.
        """
        task = self._tasks.get(key)
        if task is not None and (task.working or (task.result is not None and not anew)):
            self._tasks.move_to_end(key)
            return task
        self._all.check(asker)
        held = ExitStack()
        if self._limit is not None:
            held.enter_context(self._limit.place(asker))
        folder = self._folder / f"task-{short_hash(f'{word} {key}')}"
        task = Task(key, asker, folder, about, sentence=f"{word}: waiting for its turn")
        self._tasks[key] = task
        self._tasks.move_to_end(key)
        if "folder" in signature(work).parameters:
            work = partial(work, folder=folder)
        job = asyncio.create_task(self._carry_out(word, task, work, arguments))
        self._jobs[key] = job

        def ended(_: object) -> None:
            held.close()
            if self._jobs.get(key) is job:  # A task of this key may have been started anew while this one was put away.
                del self._jobs[key]

        job.add_done_callback(ended)
        return task

    async def finished(
        self, word: str, key: str, asker: Visitor, work: Callable[..., Outcome], *arguments: Any
    ) -> Task:
        """Wait for the task with this key, started unless it is kept. Raises `FlexlabError` if it fails."""
        task = self.start(word, key, asker, work, *arguments, anew=False)
        if key in self._jobs:
            await asyncio.shield(self._jobs[key])
            task = self._tasks[key]
        if task.result is None:
            raise LabError(task.sentence)
        return task

    def get(self, key: str) -> Task | None:
        """The task with this key, if any."""
        return self._tasks.get(key)

    def all(self) -> list[Task]:
        """All tasks that are kept, newest first."""
        return list(reversed(self._tasks.values()))

    def cancel(self, task: Task) -> None:
        """Cancel a task that is running or waiting."""
        if task.key in self._jobs:
            self._jobs[task.key].cancel()
            self._note(task, working=False, kind=BAD, sentence="Cancelled.")

    async def _carry_out(self, word: str, task: Task, work: Callable[..., Outcome], arguments: tuple[Any, ...]) -> None:
        def report(share: float) -> None:
            self._note(task, share=share, sentence=f"{word}: {100 * share:.0f} %")

        try:
            found = await self._all.run(task.asker, work, *arguments, on_progress=report, shown=True, long=self._long)
            size = await asyncio.to_thread(_bytes, task.folder)
        except FlexlabError as error:
            self._note(task, working=False, kind=BAD, sentence=str(error))
        except asyncio.CancelledError:
            with contextlib.suppress(OSError):
                await asyncio.shield(asyncio.to_thread(_remove, [task]))
            raise
        except Exception as error:
            log.exception("%s failed.", word)
            self._note(task, working=False, kind=BAD, sentence=f"{word} failed ({type(error).__name__}).")
        else:
            self._note(task, working=False, share=1.0, size=size, **vars(found))
        await asyncio.to_thread(_remove, self._forget_old())

    def _note(self, task: Task, **news: Any) -> None:
        known = self._tasks.get(task.key)
        if known is not None and known.working:
            self._tasks[task.key] = replace(known, **news)

    def _forget_old(self) -> list[Task]:
        """Forget the oldest finished tasks over the bounds; returns them, so that their files can be removed."""
        done = [task for task in self._tasks.values() if not task.working]
        gone: list[Task] = []
        while len(done) > 1 and (len(done) > self._most_kept or sum(task.size for task in done) > MOST_BYTES):
            gone.append(self._tasks.pop(done.pop(0).key))
        return gone


def _bytes(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _remove(tasks: Iterable[Task]) -> None:
    for task in tasks:
        shutil.rmtree(task.folder, ignore_errors=True)
