"""Runs the text of a person's class: it becomes an object, and what it does wrong a sentence with file and line."""

import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import CodeType
from typing import Any

LONGEST_WORDS = 200
"""Characters of an exception's own text that are shown."""


class TextProblem(Exception):
    """What is wrong with a text, as a sentence with file and line."""


class RunningText:
    """The object of one class of a text. Raises `TextProblem` if the text cannot be run."""

    def __init__(self, source: str, file: str, name: str, line: int, what: str):
        """`name`, `line`: of the class; `what` it is, in sentences."""
        self._file, self._line, self._what = file, line, what
        folder = str(Path(file).resolve().parent)
        if Path(file).exists() and folder not in sys.path:
            sys.path.append(folder)
        names: dict[str, Any] = {"__name__": f"own_text_{name}", "__file__": file}
        try:
            code: CodeType = compile(source, file, "exec")
            exec(code, names)
            self.made: Any = names[name]()
        except BaseException as error:  # SystemExit too: a file that ends Python must not end the lab.
            raise TextProblem(self.where(error)) from None

    def at_line(self, line: int | None) -> str:
        """File and line as sentences begin with them."""
        return f"{Path(self._file).name}, line {line}"

    def first_line(self, method: str) -> str:
        """File and line where a method begins."""
        return self.at_line(getattr(type(self.made), method).__code__.co_firstlineno)

    def at_return(self, method: str, again: Callable[[], Any]) -> str:
        """File and line of the return that gave a wrong answer: the call is made once more, watched."""
        code = getattr(type(self.made), method).__code__
        last = [code.co_firstlineno]

        def watch(frame: Any, event: str, _: Any) -> Any:
            if frame.f_code is code:
                if event == "return":
                    last[0] = frame.f_lineno
                return watch
            return None

        before = sys.gettrace()
        sys.settrace(watch)
        try:
            again()
        except BaseException:
            return self.first_line(method)
        finally:
            sys.settrace(before)
        return self.at_line(last[0])

    def where(self, error: BaseException) -> str:
        """An exception as a sentence with the line of the text that led to it."""
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == self._file]
        if isinstance(error, SyntaxError) and error.filename == self._file:
            lines.append(error.lineno)
        line = next((line for line in reversed(lines) if line), self._line)
        words = " ".join(str(error).split())[:LONGEST_WORDS]
        what = f"{type(error).__name__}: {words}" if words else type(error).__name__
        if isinstance(error, MemoryError):
            what = f"it needs more memory than a {self._what} may have"
        return f"{self.at_line(line)}: {what}."


def short(value: Any) -> str:
    """A value as sentences show it."""
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
