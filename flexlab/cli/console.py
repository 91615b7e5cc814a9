"""What the commands say: results on standard output, progress and complaints on standard error."""

import sys
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.console import Console

Result = TypeVar("Result")


@cache
def output() -> "Console":
    """Results: tables, addresses."""
    from rich.console import Console

    return Console(highlight=False)


@cache
def notes() -> "Console":
    """Progress and notes; a separate stream, so that results can be piped."""
    from rich.console import Console

    return Console(stderr=True, highlight=False)


def complain(sentence: str) -> None:
    """Show what went wrong, in red, on standard error."""
    console = notes()
    console.print(sentence, style="red", markup=False, soft_wrap=True)


def note(sentence: str) -> None:
    """Say something in passing, on standard error."""
    notes().print(sentence, markup=False, soft_wrap=True)


def while_saying(sentence: str, work: Callable[[], Result]) -> Result:
    """Do `work` under a turning wheel (a plain line where nobody watches a terminal) and return its result."""
    console = notes()
    if not console.is_terminal:
        note(sentence)
        sys.stderr.flush()
        return work()
    with console.status(sentence):
        return work()
