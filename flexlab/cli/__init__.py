"""The command line, which uses all other packages.

Each command is a module of this folder with a function `command`, and is loaded only when it is called, so that help is instant.
The module's first line is the command's usage and purpose for the help.
"""

import difflib
import errno
import functools
import importlib
import io
import os
import re
import shutil
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr
from linecache import getline
from pathlib import Path
from pkgutil import iter_modules
from traceback import walk_tb
from types import FrameType
from typing import Any

from flexlab.cli.console import EXIT_INTERRUPTED, complain, note, notes
from flexlab.errors import FlexlabError
from flexlab.text import aligned, tell_failures_plainly, visible

ENDING = "_command"
COMMANDS = tuple(sorted(it.name.removesuffix(ENDING) for it in iter_modules(__path__) if it.name.endswith(ENDING)))
"""Names of the commands; `flexlab` alone means `flexlab lab`."""
EXIT_OK, EXIT_BAD_INPUT = 0, 2
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk, a quota and a limit on the size of files."""
NARROWEST = 40
"""Least width, in columns, that texts are wrapped to: in fewer, tables lose words and tyro's help takes minutes."""
LONGEST_NUMBER = 9
"""Most digits that COLUMNS and LINES may have: Python refuses to convert thousands of digits."""
NO_HANDLES = (errno.EMFILE, errno.ENFILE)
UNUSABLE = (errno.EACCES, errno.EPERM, errno.ENAMETOOLONG)
"""Errors of a file or folder that may not be used, or whose name is too long."""
OWN = "flexlab"
NO_MEMORY = "failed to map segment"
"""Part of the system's message if a library finds no room in memory."""
UNWRITABLE = "no locator available"
"""Part of Numba's message if it cannot store machine code."""
NEAR = 10
"""Lines before the failed one that are searched for the name of the environment variable at fault."""
LONGEST_REASON, LONGEST_VALUE = 200, 60
"""Most characters of a reason, and of a variable's value, in a sentence."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script. Exit codes: 0 success, 1 the run failed, 2 bad input, 130 interrupted."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    reconfigure: Any = getattr(sys.stdout, "reconfigure", None)  # The streams of tests do not have it.
    if reconfigure is not None:  # Names that are not valid text can then be printed.
        reconfigure(errors="backslashreplace")
    _widen()
    tell_failures_plainly()
    try:
        try:
            code = _dispatch(words)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()  # A failed write is reported here, not by Python at exit.
        sys.exit(code)
    except KeyboardInterrupt:
        note("Interrupted.")
        sys.exit(EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader of the output has closed it, as in `flexlab presets | head`.
        if sys.stderr is not None:
            sys.stderr.close()
        sys.exit(EXIT_OK)
    except Exception as error:
        if isinstance(error, OSError) and error.filename is None and error.errno in NO_ROOM:
            complain(f"The output cannot be written ({error.strerror}): make room or send it elsewhere.")
            os._exit(EXIT_BAD_INPUT)  # Python would try to write it once more.
        sentence = refusal(error)
        if sentence is None:
            raise
        complain(sentence)
        sys.exit(EXIT_BAD_INPUT)


def _widen() -> None:
    """Wrap texts for a terminal of at least `NARROWEST` columns, whatever COLUMNS or the window says."""
    for name in ("COLUMNS", "LINES"):
        given = os.environ.get(name, "0")
        if not given.isdecimal() or len(given) > LONGEST_NUMBER:  # rich takes ² for a digit; int() does not.
            del os.environ[name]
    if int(os.environ.get("COLUMNS", shutil.get_terminal_size().columns)) < NARROWEST:
        os.environ["COLUMNS"] = str(NARROWEST)


def _dispatch(words: list[str]) -> int:
    name, rest = ("lab", words) if not words or words[0].startswith("-") else (words[0], words[1:])
    if "--version" in words[:1]:
        from flexlab import __version__

        print(f"flexlab {__version__}")
        return EXIT_OK
    if name not in COMMANDS:
        close = difflib.get_close_matches(name, COMMANDS, n=1)
        hint = f"did you mean {close[0]}?" if close else "see flexlab --help."
        raise FlexlabError(f"There is no command {name!r}: the commands are {', '.join(COMMANDS)}; {hint}")
    import tyro

    from flexlab.cli.options import check_options

    command = importlib.import_module(f"flexlab.cli.{name}{ENDING}").command
    check_options(command, rest)
    description = None if name != "lab" else f"{command.__doc__}\n\nOther commands:\n{_others()}"
    prog = "flexlab" if words[:1] != [name] else f"flexlab {name}"

    @functools.wraps(command)
    def chosen(*words: Any, **options: Any) -> Any:
        return lambda: command(*words, **options)

    # tyro's complaints repeat the arguments, which may hold control characters.
    complaint = io.StringIO()
    try:
        with redirect_stderr(complaint):
            config = (tyro.conf.FlagCreatePairsOff,)
            run = tyro.cli(chosen, prog=prog, args=rest, config=config, description=description)
    finally:
        if complaint.getvalue():
            notes().print(complaint.getvalue(), end="", soft_wrap=True)
    code = run()
    return EXIT_OK if code is None else code


def _others() -> str:
    """Usage and purpose of each command except the lab, for the help."""
    files = (Path(__path__[0], f"{name}{ENDING}.py") for name in COMMANDS if name != "lab")
    firsts = (file.read_text(encoding="utf-8").partition("\n")[0] for file in files)
    return "\n".join(f"  {line}" for line in aligned([first.strip('"`.').split("`: ") for first in firsts]))


def refusal(error: Exception) -> str | None:
    """The sentence that says what is wrong, what the machine lacks or which library fails to load; None for other errors."""
    if isinstance(error, FlexlabError):
        return str(error)
    if isinstance(error, MemoryError) or NO_MEMORY in str(error):
        return "No memory is left: close other programs, or allow more (ulimit -v)."
    if isinstance(error, OSError) and error.errno in NO_HANDLES:
        return f"{error.strerror}: close other programs, or allow more (ulimit -n)."
    if isinstance(error, OSError) and error.errno in UNUSABLE and isinstance(error.filename, str):
        return f"{visible(error.filename, LONGEST_REASON)} cannot be used ({error.strerror}): choose another place."
    if isinstance(error, FileNotFoundError):
        from flexlab.recording.store.run_files import vanished

        if gone := vanished(error):
            return gone
    if UNWRITABLE in str(error):
        from flexlab.assets import user_cache

        place = os.environ.get("NUMBA_CACHE_DIR") or user_cache()
        return f"Machine code cannot be kept in {place}: set NUMBA_CACHE_DIR to a folder that you may write to."
    return _unloadable(error)


def _unloadable(error: Exception) -> str | None:
    """The sentence about the library whose import raised this error; None for any other error."""
    frames = [frame for frame, _ in walk_tb(error.__traceback__)]
    if not any(frame.f_code.co_name == "<module>" for frame in frames) or _is_interrupt(error):
        return None
    foreign = [each for each in walk_tb(error.__traceback__) if _library(each[0]) != OWN]
    if foreign:
        library = _library(foreign[-1][0])
    elif isinstance(error, ModuleNotFoundError) and error.name:
        library = error.name.partition(".")[0]
    else:
        return None
    why = visible(" ".join(str(error).split()), LONGEST_REASON).rstrip(".") or type(error).__name__
    variables = [said for frame, line in reversed(foreign) if (said := _variables(frame, line))]
    mending = f"correct or unset {variables[0]}" if variables else f"install {library} again"
    return f"{library} cannot be loaded ({why}): {mending}."


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C caused this error, even if a library has turned it into one of its own."""
    return error is not None and (isinstance(error, KeyboardInterrupt) or _is_interrupt(error.__context__))


def _library(frame: FrameType) -> str:
    return frame.f_globals.get("__name__", OWN).partition(".")[0]


def _variables(frame: FrameType, failed: int) -> str:
    """The environment variables named in a failed line or shortly before it, with their values."""
    text = "".join(getline(frame.f_code.co_filename, line) for line in range(max(1, failed - NEAR), failed + 1))
    names = dict.fromkeys(re.findall(r"\b[A-Z][A-Z0-9_]+\b", text))
    return " and ".join(f"{name} = {visible(os.environ[name], LONGEST_VALUE)}" for name in names if name in os.environ)
