"""Sentences for errors of the machine or of a library, such as no memory or an unreadable environment variable."""

import errno
import os
import re
from linecache import getline
from traceback import walk_tb
from types import FrameType

from flexlab.text import visible

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


def refusal(error: Exception) -> str | None:
    """The sentence that says what the machine lacks, which library fails to load or what was deleted; None for other errors."""
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
