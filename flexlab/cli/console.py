"""Output of the commands: results on standard output, progress and complaints on standard error."""

import json
import shlex
import subprocess
import sys
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any

from flexlab.errors import StudyError
from flexlab.text import console, visible, visible_json

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

EXIT_INTERRUPTED = 130


@cache
def output() -> "Console":
    """The console for results, such as tables and addresses."""
    return console()


@cache
def notes() -> "Console":
    """The console for progress and notes, on another stream so that results can be piped."""
    return console(stderr=True)


def tell(*lines: object, style: str | None = None) -> None:
    """Print lines of results, unbroken where they are piped."""
    for line in lines:
        output().print(str(line), style=style, soft_wrap=True)


def note(sentence: str, style: str | None = None) -> None:
    """Print a remark on standard error, unless nothing can be written there."""
    with suppress(OSError):
        try:
            notes().print(sentence, style=style, soft_wrap=True)
        except (ImportError, MemoryError, SystemError):  # rich finds no memory.
            print(visible(sentence), file=sys.stderr)


def complain(sentence: str) -> None:
    """Print an error in red on standard error, unless nothing can be written there."""
    note(sentence, "red")


def typed(word: object) -> str:
    """A word of a command line as a person types it: quoted for this system's shell if need be."""
    return subprocess.list2cmdline([str(word)]) if sys.platform == "win32" else shlex.quote(str(word))


def new_table(*heads: str, padding: tuple[int, int, int, int] = (0, 2, 0, 0), **options: Any) -> "Table":
    """A table without lines, for results; `options`: as for rich's `Table`."""
    from rich.table import Table

    return Table(*heads, box=None, pad_edge=False, padding=padding, **options)


def print_json(data: Any) -> None:
    """Print plain data as JSON with control characters escaped."""
    print_json_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n")


def print_json_text(text: str) -> None:
    """Print JSON with control characters escaped; in ASCII if the output has another encoding than JSON's own, UTF-8."""
    output().out(visible_json(text, ascii_only=output().encoding != "utf-8"), end="")


def agreed(question: str, otherwise: str) -> bool:
    """Ask a question; whether the answer is yes. Raises `StudyError` with the advice `otherwise` if nobody can answer."""
    notes().print(f"{question} [y/N] ", end="", soft_wrap=True)
    try:
        return input().strip().lower() in ("y", "yes")
    except (EOFError, OSError, RuntimeError, ValueError):  # It is closed, or gives bytes that are no text.
        notes().print()
        raise StudyError(f"Nobody answered, so nothing was done: {otherwise}.") from None
