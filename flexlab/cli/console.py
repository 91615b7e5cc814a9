"""What the commands say: results on standard output, progress and complaints on standard error."""

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


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
    notes().print(sentence, style="red", markup=False, soft_wrap=True)


def note(sentence: str) -> None:
    """Say something in passing, on standard error."""
    notes().print(sentence, markup=False, soft_wrap=True)
