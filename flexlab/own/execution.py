"""Runs a person's text: each call of the engine becomes a call of the law's `act` or the path's `position`.

An error in a text becomes a sentence with file and line.
"""

import ctypes
import math
import sys
import threading
import time
import traceback
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from flexlab.own import declaration, measurement
from flexlab.own.declaration import (
    LASTING,
    LONGEST,
    MOST_MEMORY,
    MOST_SETTINGS,
    MOST_SIGNALS,
    SHORTEST,
    Declared,
    read_declaration,
    read_path_declaration,
)
from flexlab.own.endless_calls import CALLS, EndlessCall
from flexlab.own.measurement import BELIEVED_SIZE, Believed, Measurement, finite_numbers, real_numbers
from flexlab.own.modules import KeptModules
from flexlab.own.reading import TextProblem, is_foreign
from flexlab.physics.law_input import LAW_INPUT, MOST_ARMS
from flexlab.text import counted

FAILED, ANSWERED, ASKED, INTERRUPTED = 0, 1, 2, 3
"""Outcomes of a call. Asked: the function has not begun. Interrupted: the call before it never began, as Python raises a
Ctrl-C that came during machine code before the function's first line, where it is lost."""
MESSAGE = np.dtype(
    [
        ("outcome", "i8"),
        ("period", "f8"),
        ("inputs", "f8", (MOST_ARMS, 3)),
        ("signals", "f8", (MOST_SIGNALS,)),
        ("gains", "f8", (MOST_SETTINGS,)),
        ("memory", "f8", (MOST_MEMORY,)),
        ("plant", "f8", (BELIEVED_SIZE,)),
    ]
)
"""A call of a law and its answer. `outcome`: `ANSWERED` or `FAILED`. `period`: T_c, s. `inputs`: u. `plant`: `BELIEVED`."""
ANSWER_BYTES = MESSAGE.fields["plant"][1]  # type: ignore[index]  # It has fields.
"""Bytes of a message that are sent back; the bytes after them only go to the law."""

AnswerFunction = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)
"""C function of two addresses: a message, into which it writes the outcome, and a `LAW_INPUT` record."""
FORMER_PLACES = {
    "flexlab.own_laws.declaration": declaration, "flexlab.own_paths.declaration": declaration,
    "flexlab.own_laws.measurement": measurement,
}  # fmt: skip
"""Modules from which texts of version 0.2.0 import."""
UNREPEATABLE = (
    "act gave two answers to the same measurement, so this run cannot be repeated. What a law remembers belongs in a memory, "
    "and it may draw no random numbers."
)
"""The warning about a law that does not follow from gains, measurement and memory alone."""
QUICK = 0.01
"""Longest time of a call that is made twice, s: the second one must not make the answer late."""
LONGEST_WORDS = 200
"""Characters of an exception's own text that are shown."""


class Channel(NamedTuple):
    """The first fields of `law.CHANNEL`."""

    answer: int
    late: int
    calls: int
    next_turn: int
    done: int


def address_of(function: Any) -> int:
    """The address of a C function."""
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def record_at(address: int, kind: np.dtype) -> Any:
    """The record at an address."""
    return np.frombuffer((ctypes.c_char * kind.itemsize).from_address(address), kind)[0]


class RunningText:
    """A text that has been executed, with an object of its class. Raises `TextProblem` if that fails."""

    what = ""
    """"control law" or "path", for sentences."""

    def __init__(self, source: str, file: str, declared: Declared):
        self._source, self._file, self._declared, name = source, file, declared, declared.name
        for place, module in FORMER_PLACES.items():
            sys.modules.setdefault(place, module)
        names: dict[str, Any] = vars(KeptModules(source, file).empty(name, file))
        try:
            code: CodeType = compile(source, f"<{name}>" if is_foreign(file) else file, "exec")
            exec(code, names)
            self._made: Any = names[name]()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit too: a file that ends Python must not end the lab.
            raise TextProblem(self._where(error)) from None
        # Runs of several threads share the object.
        self._lock = threading.Lock()

    def _set(self, numbers: np.ndarray) -> None:
        """Set the object's gains or options from their numbers, flat, in the order of declaration."""
        at = 0
        for name, one in self._declared.settings:
            setattr(self._made, name, numbers[at : at + 3].copy() if one.size == 3 else float(numbers[at]))
            at += one.size

    def _at_line(self, line: int | None) -> str:
        """File and line for the beginning of a sentence; the file alone for a text that no person wrote."""
        return Path(self._file).name if is_foreign(self._file) else f"{Path(self._file).name}, line {line}"

    def _first_line(self, method: str) -> str:
        """File and line where a method begins."""
        return self._at_line(getattr(type(self._made), method).__code__.co_firstlineno)

    def _at_return(self, method: str, again: Callable[[], Any]) -> str:
        """File and line of the return that gave a wrong answer, found by making the call `again` under a trace."""
        if is_foreign(self._file):
            return self._at_line(None)
        code = getattr(type(self._made), method).__code__
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
            return self._first_line(method)
        finally:
            sys.settrace(before)
        return self._at_line(last[0])

    def _where(self, error: BaseException) -> str:
        """An exception as a sentence that names the line of the text."""
        if isinstance(error, TextProblem):
            return str(error)
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == self._file]
        if isinstance(error, SyntaxError) and error.filename == self._file:
            lines.append(error.lineno)
        line = next((line for line in reversed(lines) if line), self._declared.line)
        try:
            words = " ".join(str(error).split())[:LONGEST_WORDS]
        except BaseException:  # The text's own exception fails to describe itself.
            words = ""
        what = f"{type(error).__name__}: {words}" if words else type(error).__name__
        if isinstance(error, MemoryError):
            what = f"it needs more memory than a {self.what} may have"
        elif isinstance(error, EndlessCall):
            what = words
        return f"{self._at_line(line)}: {what}."


def short(value: Any) -> str:
    """A value shortened for a sentence."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."


class RunningLaw(RunningText):
    """A law that runs in this process. Raises `TextProblem` if it cannot run, `ScenarioError` if it declares nothing."""

    what = "control law"
    is_ready = True
    """Whether a call is answered at once."""

    def __init__(self, source: str, file: str):
        self._declaration = read_declaration(source, file)
        super().__init__(source, file, self._declaration)
        self._believed = lru_cache(maxsize=1)(Believed)
        """Made anew only if its numbers change."""
        self._function = AnswerFunction(self._called)
        self.channel = Channel(address_of(self._function), 0, -1, -1, -1)
        self._problem, self._is_interrupted = "", False
        self._calls = 0
        self.warning = ""
        """A sentence if the law gave two answers to one measurement; empty if not."""

    @property
    def problem(self) -> str:
        """The last problem, as a sentence; empty if there was none. Raises the KeyboardInterrupt that ended a call, once."""
        if self._is_interrupted:
            self._is_interrupted = False
            raise KeyboardInterrupt
        return self._problem

    cause = problem
    """As `LawApart.cause`."""

    def ensure(self) -> None:
        """Forget earlier problems, as a run begins. Raises a KeyboardInterrupt that came too late for the last run."""
        self._calls = 0
        if self.problem:
            self._problem = ""

    def _called(self, at: int, now: int) -> int:
        message = record_at(at, MESSAGE)
        self._is_interrupted |= bool(message["outcome"] == INTERRUPTED)
        try:
            message["outcome"] = FAILED if self._is_interrupted else self.ask(message, record_at(now, LAW_INPUT))
        except KeyboardInterrupt:
            # The caller is machine code, which would drop it: the run ends, and `problem` raises it.
            self._is_interrupted, message["outcome"] = True, FAILED
        return 0

    def ask(self, message: Any, now: Any) -> int:
        """Make one call by `answer` and return its outcome; its sentence is kept for `problem`."""
        with self._lock, CALLS.call(self._source):
            text = self.answer(message, now)
            self._problem = text or self._problem
        return FAILED if text else ANSWERED

    def answer(self, message: Any, now: Any) -> str:
        """Make one call with gains and memory of the `message` (fields of `MESSAGE` by name) at `now` (a `LAW_INPUT` record).

        Write inputs, signals and memory into the message. Return a sentence if something went wrong, empty if not. Raises
        KeyboardInterrupt. The calls 1, 2, 4, 8, ... of a run are made twice, to see whether the answer is the same.
        """
        self._calls += 1
        again = message.copy() if not self.warning and self._calls & (self._calls - 1) == 0 else None
        begun = time.perf_counter()
        try:
            problem = self._answer(message, now if again is None else now.copy())  # `act` may compute in place in it.
            if again is not None and not problem and time.perf_counter() - begun < QUICK:
                problem = self._answer(again, now)
                if any(again[name].tobytes() != message[name].tobytes() for name in ("inputs", "signals", "memory")):
                    self.warning = f"{self._first_line('act')}: {UNREPEATABLE}"
            return problem
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return self._where(error)

    def _answer(self, message: Any, now: Any) -> str:
        law, declared = self._made, self._declaration
        self._set(message["gains"])
        at = 0
        for name, part in declared.memory:
            setattr(law, name, message["memory"][at : at + part.size].copy())
            at += part.size
        for name, _ in declared.signals:
            setattr(law, name, 0.0)
        measurement = Measurement(now, float(message["period"]), lambda: self._believed(message["plant"].tobytes()))
        u = law.act(measurement)
        wanted = (measurement.arm_count, 3)
        try:
            inputs = real_numbers(u)
        except (TypeError, ValueError):
            return f"{self._line_of(measurement)}: act returned {short(u)}, which is not an array of numbers {wanted}."
        if inputs.shape != wanted:
            kind = "nothing" if u is None else f"an array {inputs.shape}"
            return f"{self._line_of(measurement)}: act returned {kind} instead of inputs {wanted} (arms, axes)."
        if not np.isfinite(inputs).all():
            return f"{self._line_of(measurement)}: act returned {short(inputs.tolist())}, which is not finite."
        message["inputs"][: len(inputs)] = inputs
        return self._write_back(message)

    def _write_back(self, message: Any) -> str:
        at = 0
        for name, part in self._declaration.memory:
            kept = getattr(self._made, name)
            value = finite_numbers(kept, (part.size,), ())
            if value is None:
                became = short(kept.tolist() if type(kept) is np.ndarray else kept)
                needs = counted(part.size, "finite number")
                return f"{self._first_line('act')}: the memory {name} became {became}; it needs {needs}."
            message["memory"][at : at + part.size] = value
            at += part.size
        for place, (name, _) in enumerate(self._declaration.signals):
            given = getattr(self._made, name)
            try:
                message["signals"][place] = real_numbers(given).item()
            except (TypeError, ValueError):
                return f"{self._first_line('act')}: the signal {name} became {short(given)}, which is not a number."
        return ""

    def _line_of(self, measurement: Measurement) -> str:
        return self._at_return("act", lambda: self._made.act(measurement))


class RunningPath(RunningText):
    """A path that runs in this process. Raises `TextProblem` if it cannot run, `ScenarioError` if it declares nothing."""

    what = "path"

    def __init__(self, source: str, file: str):
        declared = read_path_declaration(source, file)
        super().__init__(source, file, declared)
        self._lasts = LASTING[1] if declared.repeats else LASTING[0]

    def poses(self, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
        """The path's length, s, and its poses x, y, θ, (N, 3), at `shares` (N,) of that length. Raises `TextProblem`.

        options: the numbers of the options in the order of their declaration, flat.
        """
        try:
            with self._lock:
                self._set(options)
                span = self._span()
                return span, np.array([self._pose(t) for t in (shares * span).tolist()]).reshape(-1, 3)
        except (TextProblem, KeyboardInterrupt):
            raise
        except BaseException as error:  # SystemExit too.
            raise TextProblem(self._where(error)) from None

    def _pose(self, t: float) -> np.ndarray:
        given = self._made.position(t)
        pose = finite_numbers(given, (3,))
        if pose is None:
            where = self._at_return("position", lambda: self._made.position(t))
            what = "nothing" if given is None else short(given)
            raise TextProblem(f"{where}: position({t:g}) returned {what}, which is not three finite numbers x, y, θ.")
        return pose

    def _span(self) -> float:
        given = getattr(self._made, self._lasts)
        span = given() if callable(given) else given
        try:
            seconds = real_numbers(span).item()
        except (TypeError, ValueError):
            seconds = math.nan
        if not SHORTEST <= seconds <= LONGEST:
            where = self._first_line(self._lasts) if callable(given) else self._at_line(self._declared.line)
            raise TextProblem(f"{where}: {self._lasts} = {short(span)} s is outside {SHORTEST:g} to {LONGEST:g} s.")
        return seconds
