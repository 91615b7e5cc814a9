"""Runs a user's law: its text becomes an object, and each call of the engine one call of `act`."""

import linecache
import sys
import traceback
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np

from flexlab.own_laws.declaration import Declaration, read_declaration
from flexlab.own_laws.measurement import Measurement
from flexlab.own_laws.message import (
    ANSWERED,
    FAILED,
    GAINS,
    INPUTS,
    MEMORY,
    OUTCOME,
    PERIOD,
    SIGNALS,
)
from flexlab.physics.law_input import LAW_INPUT

LONGEST_WORDS = 200
"""Characters of an exception's own text that are shown."""


class LawProblem(Exception):
    """What is wrong with a law, as a sentence with file and line."""


class RunningLaw:
    """A law at work. Raises `LawProblem` if its text cannot be run, `ScenarioError` if it declares nothing."""

    def __init__(self, source: str, file: str):
        self.declaration: Declaration = read_declaration(source, file)
        self._file = file
        # Tracebacks then show the line's text, also of a law that came with a recording.
        linecache.cache[file] = (len(source), None, source.splitlines(True), file)
        folder = str(Path(file).resolve().parent)
        if Path(file).exists() and folder not in sys.path:
            sys.path.append(folder)
        names: dict[str, Any] = {"__name__": f"own_law_{self.declaration.kind}", "__file__": file}
        try:
            code: CodeType = compile(source, file, "exec")
            exec(code, names)
            self._law = names[self.declaration.name]()
        except BaseException as error:  # SystemExit too: a file that ends Python must not end the lab.
            raise LawProblem(self._where(error)) from None

    def answer(self, message: np.ndarray, now: np.ndarray) -> str:
        """One call: reads gains and memory of the message (MESSAGE_SIZE,) and `now` (a `LAW_INPUT` record as bytes).

        Writes inputs, signals, memory and outcome. Returns what went wrong as a sentence, empty if nothing did.
        """
        try:
            text = self._answer(message, now.view(LAW_INPUT)[0])
        except BaseException as error:
            text = self._where(error)
        message[OUTCOME] = FAILED if text else ANSWERED
        return text

    def _answer(self, message: np.ndarray, now: Any) -> str:
        law, declared = self._law, self.declaration
        at = GAINS
        for name, gain in declared.gains:
            size = 3 if isinstance(gain.default, tuple) else 1
            setattr(law, name, message[at : at + 3].copy() if size == 3 else float(message[at]))
            at += size
        at = MEMORY
        for name, part in declared.memory:
            setattr(law, name, message[at : at + part.size].copy())
            at += part.size
        for name, _ in declared.signals:
            setattr(law, name, 0.0)
        measurement = Measurement(now, float(message[PERIOD]))
        u = law.act(measurement)
        wanted = (measurement.arm_count, 3)
        try:
            inputs = np.asarray(u, float)
        except (TypeError, ValueError):
            return f"{self._at_return(now, message)}: act returned {_short(u)}, which is no array of numbers {wanted}."
        if inputs.shape != wanted:
            kind = "nothing" if u is None else f"an array {inputs.shape}"
            return f"{self._at_return(now, message)}: act returned {kind} where inputs {wanted} (arms, axes) are due."
        if not np.isfinite(inputs).all():
            return f"{self._at_return(now, message)}: act returned {_short(inputs.tolist())}, which is not finite."
        message[INPUTS : INPUTS + inputs.size] = inputs.ravel()
        return self._write_back(message)

    def _write_back(self, message: np.ndarray) -> str:
        at = MEMORY
        for name, part in self.declaration.memory:
            value = np.asarray(getattr(self._law, name), float)
            if value.shape not in ((part.size,), ()) or not np.isfinite(value).all():
                return (
                    f"{self._first_line()}: the memory {name} became {_short(value.tolist())}; "
                    f"it needs {part.size} finite numbers."
                )
            message[at : at + part.size] = value
            at += part.size
        for place, (name, _) in enumerate(self.declaration.signals):
            try:
                message[SIGNALS + place] = float(getattr(self._law, name))
            except (TypeError, ValueError):
                return f"{self._first_line()}: the signal {name} became {_short(getattr(self._law, name))}, no number."
        return ""

    def _first_line(self) -> str:
        return f"{Path(self._file).name}, line {type(self._law).act.__code__.co_firstlineno}"

    def _at_return(self, now: Any, message: np.ndarray) -> str:
        """File and line of the return that gave the wrong answer: the call is made once more, watched."""
        last = [type(self._law).act.__code__.co_firstlineno]

        def watch(frame: Any, event: str, _: Any) -> Any:
            if frame.f_code is type(self._law).act.__code__:
                if event == "return":
                    last[0] = frame.f_lineno
                return watch
            return None

        before = sys.gettrace()
        sys.settrace(watch)
        try:
            self._law.act(Measurement(now, float(message[PERIOD])))
        except BaseException:
            return self._first_line()
        finally:
            sys.settrace(before)
        return f"{Path(self._file).name}, line {last[0]}"

    def _where(self, error: BaseException) -> str:
        """An exception as a sentence with the line of the law's own file that led to it."""
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == self._file]
        if isinstance(error, SyntaxError) and error.filename == self._file:
            lines.append(error.lineno)
        line = next((line for line in reversed(lines) if line), self.declaration.line)
        words = " ".join(str(error).split())[:LONGEST_WORDS]
        what = f"{type(error).__name__}: {words}" if words else type(error).__name__
        if isinstance(error, MemoryError):
            what = "it needs more memory than a control law may have"
        return f"{Path(self._file).name}, line {line}: {what}."


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
