"""The exceptions of flexlab, and how a lab reports errors. Every text is a sentence for the person at the screen."""

import copyreg
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from flexlab.text import limited

log = limited(__name__)

_BREAK = re.compile(r"\s*[\r\n]\s*")


class FlexlabError(Exception):
    """Base of all errors that a user can cause and correct; `str(error)` is the sentence to show, in one line."""

    def __init__(self, sentence: str = ""):
        super().__init__(_BREAK.sub(" ", sentence).strip())  # A value in it, such as a table, may have lines.

    def __reduce__(self) -> tuple[Any, ...]:
        """How processes pass the error on: without its `__init__`, whose arguments may be others than `args`."""
        return copyreg.__newobj__, (type(self), *self.args), vars(self)


class ScenarioError(FlexlabError):
    """A scenario, or a change to one, is not valid. `problems` lists (field path, sentence) pairs, a line each in its text."""

    def __init__(self, problems: list[tuple[str, str]]):
        self.problems = [(path, _BREAK.sub(" ", sentence)) for path, sentence in problems]
        Exception.__init__(self, "\n".join(sentence for _, sentence in self.problems))


class PresetError(FlexlabError):
    """A preset or scenario file cannot be found or read."""


class RecordingError(FlexlabError):
    """A recording cannot be written, opened or read."""


class LabError(FlexlabError):
    """The lab's server cannot be started as asked."""


class StudyError(FlexlabError):
    """A study (run, batch, export, benchmark) was asked for something that cannot be done."""


@contextmanager
def telling(tell: Callable[[str], object], failed: str) -> Iterator[None]:
    """Pass the sentence of an error in the block to `tell`. An unexpected error is logged too, and completes `failed`."""
    try:
        yield
    except FlexlabError as error:
        tell(str(error))
    except Exception as error:
        sentence = failed.format(f"{type(error).__name__}: {error}")
        log.exception("%s", sentence)
        tell(sentence)
