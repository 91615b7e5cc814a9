"""Long work that pages come back to: how far each task is, and what came of it. Bounded, gone when the server closes."""

import asyncio
import contextlib
import hashlib
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
from flexlab.server.limits import THE_SERVER, Asker, Limit
from flexlab.server.tasks import Tasks

MOST_BYTES = 1_000_000_000
"""Of the files of one book's finished tasks; the newest one keeps its own whatever they are."""
GOOD, BAD = "good", "bad"
NAME_DIGITS = 16
"""Of a task's folder, hexadecimal."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome:
    """What a task's work gives."""

    result: Any = None
    sentence: str = "Finished."
    kind: str = GOOD


@dataclass(frozen=True)
class Task:
    """One task, as it stands."""

    key: str
    asker: Asker
    folder: Path
    """For its files; made by the work that has some."""
    about: Any = None
    """What its page knows of it."""
    share: float = 0.0
    """How far it is, 0 to 1."""
    working: bool = True
    sentence: str = ""
    kind: str = ""
    """"good" or "bad" once it is over."""
    result: Any = None
    """None, too, if it came to no end."""
    size: int = 0
    """Bytes of its files."""

    def as_data(self) -> dict[str, Any]:
        """How it stands, for the script in its page."""
        return {"working": self.working, "share": self.share, "sentence": self.sentence, "kind": self.kind}


IDLE = Task("", THE_SERVER, Path(), working=False)
"""One that nobody has begun."""


class TaskBook:
    """The tasks of one kind, of one server. For its event loop only."""

    def __init__(self, tasks: Tasks, folder: Path, most_kept: int, limit: Limit | None = None, long: bool = False):
        """`folder`: where their folders lie; somebody else removes it. `most_kept`: finished ones that are remembered.

        `limit`: bounds those that work or wait, besides what bounds all tasks. `long`: only one of them works at a time.
        """
        self._all, self._folder, self._most_kept, self._limit, self._long = tasks, folder, most_kept, limit, long
        self._tasks: OrderedDict[str, Task] = OrderedDict()
        self._jobs: dict[str, asyncio.Task[None]] = {}

    def start(
        self, word: str, key: str, asker: Asker, work: Callable[..., Outcome], *arguments: Any, about: Any = None
    ) -> Task:
        """Begin `work(*arguments)`, or queue it, unless that is being done; `word`: what it is, as in "Replay".

        Work with a parameter `folder` gets the task's, which it makes; `report` as in `Tasks.run`. Raises `BusyError`.
        """
        task = self._tasks.get(key)
        if task is not None and task.working:
            return task
        held = ExitStack()
        if self._limit is not None:
            held.enter_context(self._limit.place(asker))
        with held:
            self._all.check(asker)
            held = held.pop_all()
        folder = self._folder / f"task-{hashlib.sha256(f'{word} {key}'.encode()).hexdigest()[:NAME_DIGITS]}"
        task = Task(key, asker, folder, about, sentence=f"{word}: waiting for its turn")
        self._tasks[key] = task
        self._tasks.move_to_end(key)
        if "folder" in signature(work).parameters:
            work = partial(work, folder=folder)
        job = asyncio.create_task(self._carry_out(word, task, work, arguments))
        self._jobs[key] = job
        job.add_done_callback(lambda _: (held.close(), self._jobs.pop(key, None)))
        return task

    async def finished(
        self, word: str, key: str, asker: Asker, work: Callable[..., Outcome], *arguments: Any, about: Any = None
    ) -> Task:
        """The task with this key, at its end, begun if nobody has. Raises `FlexlabError` if it fails."""
        task = self._tasks.get(key)
        if task is None or (not task.working and task.result is None):
            task = self.start(word, key, asker, work, *arguments, about=about)
        if key in self._jobs:
            await asyncio.shield(self._jobs[key])
            task = self._tasks[key]
        if task.result is None:
            raise LabError(task.sentence)
        self._tasks.move_to_end(key)
        return task

    def get(self, key: str) -> Task | None:
        """A task by its key."""
        return self._tasks.get(key)

    def all(self) -> list[Task]:
        """Those that are known, the newest first."""
        return list(reversed(self._tasks.values()))

    def cancel(self, task: Task) -> None:
        """End a task that works or waits."""
        if task.key in self._jobs:
            self._jobs[task.key].cancel()
            self._note(task, working=False, kind=BAD, sentence="Cancelled.")

    async def _carry_out(self, word: str, task: Task, work: Callable[..., Outcome], arguments: tuple[Any, ...]) -> None:
        def report(share: float) -> None:
            self._note(task, share=share, sentence=f"{word}: {100 * share:.0f} %")

        try:
            found = await self._all.run(task.asker, work, *arguments, on_progress=report, long=self._long)
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
        """Those that went, whose files may go."""
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
