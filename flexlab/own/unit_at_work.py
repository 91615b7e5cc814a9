"""A functional mock-up unit that runs as a control law, by FMPy, in the process of that law.

At each control instant the unit gets the measurement, is moved on from the instant before, and its outputs drive the arms. A law
may be asked again from an earlier instant, or for another run; the unit then returns to its state of that instant, or computes
the way there again if it cannot save its state. The law's memory holds a number that identifies the state: a digest of all
inputs since the unit began.
"""

import contextlib
import hashlib
import os
import shutil
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexlab.assets import code_cache
from flexlab.own.measurement import Measurement
from flexlab.own.reading import TextProblem, is_unit
from flexlab.own.unit import GRIPS, MOTORS, PARTS
from flexlab.text import visible

STATES_KEPT = 4096
"""Instants to which the unit can return."""
MARK_BYTES = 6
"""Bytes of the digest that makes a mark."""
MARKS = 2.0 ** (8 * MARK_BYTES + 1)
"""Above every mark: the memory holds mark / MARKS, below 1 and exact."""
WORST = 3
"""fmi2Error, fmi3Error: from this status on, messages are about errors."""


class Kept(NamedTuple):
    """The unit after an instant."""

    before: int
    """Mark of the instant before; 0: none."""
    state: Any
    """None if the unit cannot give its state."""
    time: float
    given: list[float]
    parameters: list[float]
    answer: list[float]


class Unit:
    """A loaded unit. Raises `TextProblem` if it cannot be loaded or fails."""

    def __init__(self, name: str, sha256: str, place: str, gains: dict[str, str], signals: dict[str, str]):
        """`place`: the file, if known; `gains`, `signals`: attribute of the law → variable of the unit."""
        self._name, self._gains, self._signals = name, list(gains), list(signals)
        file = Path(place if is_unit(place) else name)
        try:
            data = file.read_bytes()
        except OSError:
            data = b""
        if hashlib.sha256(data).hexdigest() != sha256:
            where = "is not there" if not data else "is another file than this law was made of"
            raise self._problem(f"it {where} (SHA-256 {sha256[:12]}…): give that file with --law")
        import fmpy
        from fmpy.simulation import instantiate_fmu

        self._said = ""
        about = fmpy.read_model_description(str(file), validate=False)
        self._third = about.fmiVersion == "3.0"
        try:
            self._unit = instantiate_fmu(
                str(_extracted(file, sha256)),
                about,
                "CoSimulation",
                logger=self._note_third if self._third else self._note,
            )
        except Exception as error:
            raise self._problem(self._said or f"it cannot be loaded ({_words(error)})") from None
        numbers = {each.name: each.valueReference for each in about.modelVariables}
        self._inputs = [each.name for each in about.modelVariables if each.causality == "input"]
        self._asked = [numbers[each] for each in self._inputs]
        self._tuned = [numbers[each] for each in gains.values()]
        answers = GRIPS if next(iter(GRIPS)) in numbers else MOTORS
        self._has_grips = answers is GRIPS
        self._answers = [each for each in answers if each in numbers]
        self._given = [numbers[each] for each in (*self._answers, *signals.values())]
        self._goes_back = bool(getattr(about.coSimulation, "canGetAndSetFMUstate", False))
        self._known: dict[int, Kept] = {}
        """By mark, which identifies all inputs up to an instant, and so the answer."""
        self._now = 0
        """Mark of the instant that the unit has reached; 0: none."""
        self._is_new = True

    def act(self, law: Any, at: Measurement) -> Any:
        """One call of the law's `act`."""
        before, parameters = int(MARKS * law.answered[0]), [float(getattr(law, name)) for name in self._gains]
        # With one arm, or few gauges, there are fewer numbers than names.
        numbers = {
            name: value
            for asked, parts in PARTS.items()
            for name, value in zip(parts, getattr(at, asked).ravel().tolist(), strict=False)
        }
        missing = [name for name in self._inputs if name not in numbers]
        if missing:
            raise self._problem(f"its input {missing[0]} is not something that this scenario has")
        given = [numbers[name] for name in self._inputs]
        told = np.array([before, at.time, at.period, *given, *parameters])
        mark = 1 + int.from_bytes(hashlib.sha256(told.tobytes()).digest()[:MARK_BYTES], "big")
        if self._is_corrected(before, at.time, parameters):
            mark = self._now  # It cannot go back: its first answer holds.
        elif mark not in self._known:
            try:
                self._move(before, mark, at, given, parameters)
            except TextProblem:
                raise
            except Exception as error:
                raise self._problem(self._said or f"it failed ({_words(error)})") from None
        law.answered = np.array([mark / MARKS])
        answer = self._known[mark].answer
        for name, value in zip(self._signals, answer[len(self._answers) :], strict=True):
            setattr(law, name, value)
        wanted = 3 * at.arm_count
        if len(self._answers) < wanted:
            raise self._problem(f"it drives {len(self._answers) // 3} arm, and the scenario has {at.arm_count}")
        found = np.array(answer[:wanted]).reshape(at.arm_count, 3)
        return found if self._has_grips else at.from_torques(found)

    def _is_corrected(self, before: int, time: float, parameters: list[float]) -> bool:
        """Whether the newest instant of a unit that cannot save its state is asked again, as by a shorter step of the engine."""
        now = self._known.get(self._now)
        is_same = now is not None and now.before == before != 0 and now.time == time and now.parameters == parameters
        return is_same and not self._goes_back

    def _move(self, before: int, mark: int, at: Measurement, given: list[float], parameters: list[float]) -> None:
        """Move the unit from the instant `before` (0: not begun) to this one."""
        self._said = ""
        if before == 0:
            self._begin(at.time, given, parameters)
        else:
            self._go_back(before)
            self._go_on(self._known[before], at.time, given, parameters)
        answer = list((self._unit.getFloat64 if self._third else self._unit.getReal)(self._given))
        state = self._unit.getFMUState() if self._goes_back else None
        self._known[mark] = Kept(before, state, at.time, given, parameters, answer)
        self._now = mark
        if len(self._known) > STATES_KEPT:
            oldest = self._known.pop(next(iter(self._known)))
            if oldest.state is not None:
                self._unit.freeFMUState(oldest.state)

    def _begin(self, time: float, given: list[float], parameters: list[float]) -> None:
        if not self._is_new:
            self._unit.reset()
        self._is_new = False
        if not self._third:
            self._unit.setupExperiment(startTime=time)
        self._set(self._tuned, parameters)
        self._unit.enterInitializationMode(**({"startTime": time} if self._third else {}))
        self._set(self._asked, given)
        self._unit.exitInitializationMode()

    def _go_on(self, before: Kept, time: float, given: list[float], parameters: list[float]) -> None:
        if parameters != before.parameters:
            self._set(self._tuned, parameters)
        self._set(self._asked, given)
        self._unit.doStep(before.time, time - before.time)

    def _go_back(self, mark: int) -> None:
        if mark == self._now:
            return
        way: list[Kept] = []
        while mark and not (way and self._goes_back):
            if mark not in self._known:
                raise self._problem("what it computed up to here is no longer known: begin the run again")
            way.append(self._known[mark])
            mark = way[-1].before
        if self._goes_back:
            self._unit.setFMUState(way[0].state)
            return
        self._begin(way[-1].time, way[-1].given, way[-1].parameters)
        for before, kept in pairwise(reversed(way)):
            self._go_on(before, kept.time, kept.given, kept.parameters)

    def _set(self, references: list[int], values: list[float]) -> None:
        if references:
            (self._unit.setFloat64 if self._third else self._unit.setReal)(references, values)

    def _note(self, _: Any, name: bytes, status: int, category: bytes, message: bytes, *more: Any) -> None:
        if status >= WORST or not self._said:
            self._said = visible(message.decode(errors="replace"))[:300]

    def _note_third(self, _: Any, status: int, category: bytes, message: bytes) -> None:
        self._note(_, b"", status, category, message)

    def _problem(self, text: str) -> TextProblem:
        return TextProblem(f"{self._name}: {text.rstrip('.')}.")


def _words(error: Exception) -> str:
    return visible(" ".join(str(error).split()))[:200] or type(error).__name__


def _extracted(file: Path, sha256: str) -> Path:
    """The folder with a unit's unpacked files, kept beside compiled kernels."""
    import fmpy

    folder = code_cache() / f"unit-{sha256[:32]}"
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        draft = tempfile.mkdtemp(dir=folder.parent, prefix="unit-draft-")
        fmpy.extract(str(file), draft)
        with contextlib.suppress(OSError):  # Another process was first.
            os.rename(draft, folder)
        shutil.rmtree(draft, ignore_errors=True)
    return folder
