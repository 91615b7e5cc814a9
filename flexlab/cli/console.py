"""What the commands say: results on standard output, progress and complaints on standard error."""

from functools import cache
from typing import TYPE_CHECKING

from flexlab.errors import StudyError
from flexlab.text import console, visible_json

if TYPE_CHECKING:
    from rich.console import Console

EXIT_INTERRUPTED = 130


@cache
def output() -> "Console":
    """Results: tables, addresses."""
    return console()


@cache
def notes() -> "Console":
    """Progress and notes; a separate stream, so that results can be piped."""
    return console(stderr=True)


def complain(sentence: str) -> None:
    """Show what went wrong, in red, on standard error."""
    notes().print(sentence, style="red", soft_wrap=True)


def note(sentence: str) -> None:
    """Say something in passing, on standard error."""
    notes().print(sentence, soft_wrap=True)


def print_json(text: str, end: str = "\n") -> None:
    """Print JSON, the same data whatever its texts hold."""
    output().out(visible_json(text), end=end)


def agreed(question: str, otherwise: str) -> bool:
    """Whether the person answers yes. Raises `StudyError` if nobody is there to answer; `otherwise` says what to do then."""
    notes().print(f"{question} [y/N] ", end="", soft_wrap=True)
    try:
        return input().strip().lower() in ("y", "yes")
    except EOFError:
        notes().print()
        raise StudyError(f"Nobody answered, so nothing was done: {otherwise}.") from None
