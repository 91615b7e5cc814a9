"""Runs a person's text: each call of the engine becomes a call of the law's `act` or the path's `position`.

An error in a text becomes a sentence with file and line. The numbers of a law's call go both ways in a message
(MESSAGE_SIZE,) of float64.
"""

import ctypes
import math
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from flexlab.own import declaration
from flexlab.own.declaration import (
    LASTING,
    LONGEST,
    MOST_MEMORY,
    MOST_SETTINGS,
    MOST_SIGNALS,
    SHORTEST,
    Declaration,
    PathDeclaration,
    Setting,
    read_declaration,
    read_path_declaration,
)
from flexlab.own.endless_calls import CALLS, EndlessCall
from flexlab.own.measurement import BELIEVED_SIZE, Believed, Measurement, real_numbers
from flexlab.own.reading import TextProblem, is_foreign
from flexlab.physics.law_input import LAW_INPUT

OUTCOME = 1
"""State of the call: `ASKED`, `ANSWERED` or `FAILED`; `WAIT` where a late answer may still come. At 0 is the turn's byte."""
ASKED, ANSWERED, FAILED, WAIT = 0.0, 1.0, 2.0, 3.0
PERIOD = 2
"""T_c, s."""
INPUTS = 3
"""u, (arms, 3) row by row: the answer."""
SIGNALS = INPUTS + 6
GAINS = SIGNALS + MOST_SIGNALS
MEMORY = GAINS + MOST_SETTINGS
ANSWER_SIZE = MEMORY + MOST_MEMORY
"""Numbers that go back; the ones after them go to the law only."""
PLANT = ANSWER_SIZE
MESSAGE_SIZE = PLANT + BELIEVED_SIZE

AnswerFunction = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)
"""C function of two addresses: a message and a `LAW_INPUT` record."""


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


def message_at(address: int) -> np.ndarray:
    """The message (MESSAGE_SIZE,) at an address."""
    return np.ctypeslib.as_array((ctypes.c_double * MESSAGE_SIZE).from_address(address))


def now_at(address: int) -> np.ndarray:
    """The bytes of the `LAW_INPUT` record at an address."""
    return np.ctypeslib.as_array((ctypes.c_uint8 * LAW_INPUT.itemsize).from_address(address))


FORMER_PLACES = ("flexlab.own_laws.declaration", "flexlab.own_paths.declaration")
"""Modules from which texts in earlier recordings import."""
LONGEST_WORDS = 200
"""Characters of an exception's own text that are shown."""


class RunningText:
    """A text whose code was executed, and an object of its class. Raises `TextProblem` if that fails."""

    def __init__(self, source: str, file: str, name: str, line: int, what: str):
        """`name` and `line` of the class; `what`: "control law" or "path", for sentences."""
        self._file, self._line, self._what = file, line, what
        folder = str(Path(file).resolve().parent)
        if Path(file).exists() and folder not in sys.path:
            sys.path.append(folder)
        for place in FORMER_PLACES:
            sys.modules.setdefault(place, declaration)
        names: dict[str, Any] = {"__name__": f"own_text_{name}", "__file__": file}
        try:
            code: CodeType = compile(source, f"<{name}>" if is_foreign(file) else file, "exec")
            exec(code, names)
            self.made: Any = names[name]()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit too: a file that ends Python must not end the lab.
            raise TextProblem(self.where(error)) from None

    def set(self, settings: tuple[tuple[str, Setting], ...], numbers: np.ndarray) -> None:
        """Set the object's gains or options from their numbers, flat, in the order of declaration."""
        at = 0
        for name, one in settings:
            setattr(self.made, name, numbers[at : at + 3].copy() if one.size == 3 else float(numbers[at]))
            at += one.size

    def at_line(self, line: int | None) -> str:
        """File and line, as sentences begin; the file alone for a text that no person wrote."""
        return Path(self._file).name if is_foreign(self._file) else f"{Path(self._file).name}, line {line}"

    def first_line(self, method: str) -> str:
        """File and line where a method begins."""
        return self.at_line(getattr(type(self.made), method).__code__.co_firstlineno)

    def at_return(self, method: str, again: Callable[[], Any]) -> str:
        """File and line of the return that gave a wrong answer, found by making the call `again` under a trace."""
        if is_foreign(self._file):
            return self.at_line(None)
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
        """An exception as a sentence that names the line of the text."""
        if isinstance(error, TextProblem):
            return str(error)
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == self._file]
        if isinstance(error, SyntaxError) and error.filename == self._file:
            lines.append(error.lineno)
        line = next((line for line in reversed(lines) if line), self._line)
        try:
            words = " ".join(str(error).split())[:LONGEST_WORDS]
        except BaseException:  # The text's own exception cannot say what it is.
            words = ""
        what = f"{type(error).__name__}: {words}" if words else type(error).__name__
        if isinstance(error, MemoryError):
            what = f"it needs more memory than a {self._what} may have"
        elif isinstance(error, EndlessCall):
            what = words
        return f"{self.at_line(line)}: {what}."


def short(value: Any) -> str:
    """A value as sentences show it."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."


class RunningLaw:
    """A law that runs in this process. Raises `TextProblem` if it cannot run, `ScenarioError` if it declares nothing."""

    is_ready = True
    """Whether a call is answered at once."""

    def __init__(self, source: str, file: str):
        self.declaration: Declaration = read_declaration(source, file)
        self._text = RunningText(source, file, self.declaration.name, self.declaration.line, "control law")
        self._law = self._text.made
        self._told = b""
        self._believed: Believed | None = None
        self._lock = threading.Lock()
        self._function = AnswerFunction(self._called)
        self.channel = Channel(address_of(self._function), 0, -1, -1, -1)
        self._problem, self._is_interrupted = "", False

    @property
    def problem(self) -> str:
        """What went wrong last, as a sentence; empty if nothing did. Raises, once, the KeyboardInterrupt that ended a call."""
        if self._is_interrupted:
            self._is_interrupted = False
            raise KeyboardInterrupt
        return self._problem

    def ensure(self) -> None:
        """Forget what went wrong before: a run begins."""
        self._problem, self._is_interrupted = "", False

    def _called(self, message: int, now: int) -> None:
        try:
            if not self._is_interrupted:
                self.ask(message_at(message), now_at(now))
                return
        except KeyboardInterrupt:
            # The caller is machine code, which would drop it: the run ends, and whoever asks why gets it.
            self._is_interrupted = True
        message_at(message)[OUTCOME] = FAILED

    def ask(self, message: np.ndarray, now: np.ndarray) -> None:
        """One call, as `answer`; a sentence goes to `problem`."""
        with self._lock, CALLS.call():  # Runs of several threads share the object.
            self._problem = self.answer(message, now) or self._problem

    def answer(self, message: np.ndarray, now: np.ndarray) -> str:
        """One call: reads gains and memory of the message (MESSAGE_SIZE,) and `now` (a `LAW_INPUT` record as bytes).

        Writes inputs, signals, memory and outcome. Returns what went wrong as a sentence, empty if nothing did. Raises
        KeyboardInterrupt.
        """
        try:
            text = self._answer(message, now.view(LAW_INPUT)[0])
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            text = self._text.where(error)
        message[OUTCOME] = FAILED if text else ANSWERED
        return text

    def _answer(self, message: np.ndarray, now: Any) -> str:
        law, declared = self._law, self.declaration
        self._text.set(declared.settings, message[GAINS:])
        at = MEMORY
        for name, part in declared.memory:
            setattr(law, name, message[at : at + part.size].copy())
            at += part.size
        for name, _ in declared.signals:
            setattr(law, name, 0.0)
        measurement = self._measurement(now, message)
        u = law.act(measurement)
        wanted = (measurement.arm_count, 3)
        try:
            inputs = real_numbers(u)
        except (TypeError, ValueError):
            return f"{self._at_return(now, message)}: act returned {short(u)}, which is no array of numbers {wanted}."
        if inputs.shape != wanted:
            kind = "nothing" if u is None else f"an array {inputs.shape}"
            return f"{self._at_return(now, message)}: act returned {kind} where inputs {wanted} (arms, axes) are due."
        if not np.isfinite(inputs).all():
            return f"{self._at_return(now, message)}: act returned {short(inputs.tolist())}, which is not finite."
        message[INPUTS : INPUTS + inputs.size] = inputs.ravel()
        return self._write_back(message)

    def _measurement(self, now: Any, message: np.ndarray) -> Measurement:
        """`Believed` is made when a law asks for it, and anew only when its numbers change."""

        def believed() -> Believed:
            told = message[PLANT:].tobytes()
            if self._believed is None or told != self._told:
                self._told, self._believed = told, Believed(message[PLANT:])
            return self._believed

        return Measurement(now, float(message[PERIOD]), believed)

    def _write_back(self, message: np.ndarray) -> str:
        at = MEMORY
        for name, part in self.declaration.memory:
            kept = getattr(self._law, name)
            try:
                value = real_numbers(kept)
                fits = value.shape in ((part.size,), ()) and bool(np.isfinite(value).all())
            except (TypeError, ValueError):
                fits = False
            if not fits:
                became = short(kept.tolist() if type(kept) is np.ndarray else kept)
                return f"{self._first_line()}: the memory {name} became {became}; it needs {part.size} finite numbers."
            message[at : at + part.size] = value
            at += part.size
        for place, (name, _) in enumerate(self.declaration.signals):
            try:
                message[SIGNALS + place] = real_numbers(getattr(self._law, name)).item()
            except (TypeError, ValueError):
                return f"{self._first_line()}: the signal {name} became {short(getattr(self._law, name))}, no number."
        return ""

    def _first_line(self) -> str:
        return self._text.first_line("act")

    def _at_return(self, now: Any, message: np.ndarray) -> str:
        return self._text.at_return("act", lambda: self._law.act(self._measurement(now, message)))


class RunningPath:
    """A path that runs in this process. Raises `TextProblem` if it cannot run, `ScenarioError` if it declares nothing."""

    def __init__(self, source: str, file: str):
        self.declaration: PathDeclaration = read_path_declaration(source, file)
        self._text = RunningText(source, file, self.declaration.name, self.declaration.line, "path")
        self._path = self._text.made
        self._lasts = LASTING[1] if self.declaration.repeats else LASTING[0]
        self._lock = threading.Lock()

    def poses(self, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
        """How long it lasts, s, and x, y, θ, (N, 3), at `shares` (N,) of that. Raises `TextProblem`.

        options: the numbers of the options in the order of their declaration, flat.
        """
        try:
            with self._lock:  # Runs of several threads share the object.
                self._text.set(self.declaration.settings, options)
                span = self._span()
                return span, np.array([self._pose(t) for t in (shares * span).tolist()]).reshape(-1, 3)
        except (TextProblem, KeyboardInterrupt):
            raise
        except BaseException as error:  # SystemExit too.
            raise TextProblem(self._text.where(error)) from None

    def _pose(self, t: float) -> np.ndarray:
        given = self._path.position(t)
        try:
            pose = real_numbers(given)
            fits = pose.shape == (3,) and np.isfinite(pose).all()
        except (TypeError, ValueError):
            fits = False
        if not fits:
            where = self._text.at_return("position", lambda: self._path.position(t))
            what = "nothing" if given is None else short(given)
            raise TextProblem(f"{where}: position({t:g}) returned {what}, which is not three finite numbers x, y, θ.")
        return pose

    def _span(self) -> float:
        given = getattr(self._path, self._lasts)
        span = given() if callable(given) else given
        try:
            seconds = real_numbers(span).item()
        except (TypeError, ValueError):
            seconds = math.nan
        if not SHORTEST <= seconds <= LONGEST:
            where = self._text.at_line(self.declaration.line)
            if callable(given):
                where = self._text.first_line(self._lasts)
            raise TextProblem(f"{where}: {self._lasts} = {short(span)} s is outside {SHORTEST:g} to {LONGEST:g} s.")
        return seconds
