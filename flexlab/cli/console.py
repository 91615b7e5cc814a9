"""Output of the commands: results on standard output, progress and complaints on standard error."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

from flexlab.errors import StudyError
from flexlab.text import console, visible_json

if TYPE_CHECKING:
    from rich.console import Console

EXIT_INTERRUPTED = 130


@cache
def output() -> "Console":
    """The console for results, such as tables and addresses."""
    return console()


@cache
def notes() -> "Console":
    """The console for progress and notes, on another stream so that results can be piped."""
    return console(stderr=True)


def complain(sentence: str) -> None:
    """Print an error in red on standard error."""
    notes().print(sentence, style="red", soft_wrap=True)


def note(sentence: str) -> None:
    """Print a remark on standard error."""
    notes().print(sentence, soft_wrap=True)


@contextmanager
def progress(what: str, total: float | None, shown: str) -> Generator[Callable[[float], None]]:
    """A progress bar on a terminal; yields the function that moves it on. `shown`: rich's text beside the bar."""
    if not notes().is_terminal:
        yield lambda _: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn(what), BarColumn(), TextColumn(shown), TimeRemainingColumn()
    with Progress(*columns, console=notes(), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)


def print_json(text: str, end: str = "\n") -> None:
    """Print JSON with control characters escaped."""
    output().out(visible_json(text), end=end)


def agreed(question: str, otherwise: str) -> bool:
    """Whether the person answers yes. Raises `StudyError` with the advice `otherwise` if nobody can answer."""
    notes().print(f"{question} [y/N] ", end="", soft_wrap=True)
    try:
        return input().strip().lower() in ("y", "yes")
    except EOFError:
        notes().print()
        raise StudyError(f"Nobody answered, so nothing was done: {otherwise}.") from None
