"""Long tasks whose results pages show later, in real processes: they are limited, can be cancelled, and fail in a sentence."""

import asyncio
import os
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from flexlab.errors import FlexlabError, StudyError
from flexlab.server import task_book
from flexlab.server.limits import BusyError, Limit, Visitor
from flexlab.server.task_book import BAD, GOOD, Outcome, TaskBook
from flexlab.server.tasks import Tasks

ANNA = Visitor("anna", "1")
LIMIT = 2, 2, 2, 0


def write(size: int, folder: Path) -> Outcome:
    """Write `size` bytes into the task's folder."""
    folder.mkdir()
    (folder / "file").write_bytes(bytes(size))
    return Outcome(size)


def refuse() -> Outcome:
    raise StudyError("There is nothing to study.")


def take_long(folder: Path, report: Callable[[float], None]) -> Outcome:
    folder.mkdir()
    report(0.5)
    time.sleep(600)
    return Outcome()


def with_book(tmp_path: Path, use: Callable[[TaskBook], Coroutine[Any, Any, None]], kept: int = 2) -> None:
    """Run `use` with a book that keeps `kept` finished tasks."""

    async def used() -> None:
        tasks = Tasks()
        try:
            await use(TaskBook(tasks, tmp_path, kept, Limit("studies", *LIMIT), long=True))
        finally:
            tasks.close()

    with ThreadPoolExecutor(1) as pool:  # Playwright may keep an event loop on this thread.
        pool.submit(asyncio.run, used()).result()


def test_the_oldest_finished_tasks_are_removed_with_their_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(task_book, "MOST_BYTES", 1000)

    async def use(book: TaskBook) -> None:
        for key, size in (("a", 10), ("b", 20), ("c", 30)):
            assert (await book.finished("Writing", key, ANNA, write, size)).result == size
        assert [task.key for task in book.all()] == ["c", "b"]
        await book.finished("Writing", "d", ANNA, write, 990)
        assert [task.key for task in book.all()] == ["d"], "c and d have more bytes than may be"
        await book.finished("Writing", "e", ANNA, write, 5000)
        assert [file.stat().st_size for file in tmp_path.rglob("file")] == [5000], "the newest one is kept"

    with_book(tmp_path, use)


def test_a_finished_task_is_not_repeated_and_a_failed_one_is(tmp_path: Path):
    async def use(book: TaskBook) -> None:
        first = await book.finished("Writing", "a", ANNA, write, 10)
        assert await book.finished("Writing", "a", ANNA, write, 20) is first
        for _ in range(2):
            with pytest.raises(FlexlabError, match="nothing to study"):
                await book.finished("Refusing", "b", ANNA, refuse)
        failed = book.get("b")
        assert failed is not None
        assert (failed.working, failed.kind, first.kind) == (False, BAD, GOOD)
        book.start("Refusing", "c", ANNA, refuse)
        while book.get("c").working:  # type: ignore[union-attr]
            await asyncio.sleep(0)
        book.start("Writing", "c", ANNA, write, 10)  # At once, while the failed one is put away.
        await asyncio.sleep(0.2)
        assert (await book.finished("Writing", "c", ANNA, write, 10)).result == 10

    with_book(tmp_path, use)


def test_one_long_task_runs_at_a_time_and_cancelled_ones_leave_room_and_no_files(tmp_path: Path):
    async def use(book: TaskBook) -> None:
        long = book.start("Sleep", "a", ANNA, take_long)
        waiting = book.start("Sleep", "b", Visitor("ben", "1"), take_long)
        assert book.start("Sleep", "a", ANNA, take_long) is long
        with pytest.raises(BusyError, match="This server has 2 studies"):
            book.start("Sleep", "c", Visitor("carl", "2"), take_long)
        async with asyncio.timeout(60):
            while book.get("a").share < 0.5:  # type: ignore[union-attr]
                await asyncio.sleep(0.02)
        assert book.get("a").sentence == "Sleep: 50 %"  # type: ignore[union-attr]
        assert book.get("b").sentence == "Sleep: waiting for its turn"  # type: ignore[union-attr]
        for task in (long, waiting):
            book.cancel(task)
        async with asyncio.timeout(60):
            while list(tmp_path.iterdir()):
                await asyncio.sleep(0.02)
        assert [task.sentence for task in book.all()] == ["Cancelled."] * 2
        assert (await book.finished("Writing", "d", ANNA, write, 10)).result == 10

    with_book(tmp_path, use)


def test_a_task_that_a_closing_server_ends_is_not_logged_as_a_failure(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    """The last line in the terminal used to say that a task had ended unexpectedly."""

    async def use() -> str:
        tasks = Tasks()
        begun = asyncio.Event()
        work = asyncio.ensure_future(
            tasks.run(ANNA, take_long, tmp_path / "a", on_progress=lambda share: share > 0 and begun.set())
        )
        async with asyncio.timeout(60):
            await begun.wait()
        tasks.close()
        with pytest.raises(FlexlabError) as ended:
            await work
        return str(ended.value)

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(asyncio.run, use()).result() == "This server is closing."
    assert not caplog.messages


def test_a_task_whose_process_dies_says_so_and_the_next_one_runs():
    """As one that reads a damaged recording may."""

    async def use() -> int:
        tasks = Tasks()
        with pytest.raises(
            FlexlabError, match=r"exit code -?\d+\): the run may be damaged, or too large for this machine\."
        ):
            await tasks.run(ANNA, os.abort)
        return await tasks.run(ANNA, len, "x")

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(asyncio.run, use()).result() == 1
