"""Runs a user's law: its text becomes an object, and each call of the engine one call of `act`."""

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
from flexlab.own_laws.running_text import RunningText, short
from flexlab.physics.law_input import LAW_INPUT


class RunningLaw:
    """A law at work. Raises `TextProblem` if its text cannot be run, `ScenarioError` if it declares nothing."""

    def __init__(self, source: str, file: str):
        self.declaration: Declaration = read_declaration(source, file)
        self._text = RunningText(source, file, self.declaration.name, self.declaration.line, "control law")
        self._law = self._text.made

    def answer(self, message: np.ndarray, now: np.ndarray) -> str:
        """One call: reads gains and memory of the message (MESSAGE_SIZE,) and `now` (a `LAW_INPUT` record as bytes).

        Writes inputs, signals, memory and outcome. Returns what went wrong as a sentence, empty if nothing did.
        """
        try:
            text = self._answer(message, now.view(LAW_INPUT)[0])
        except BaseException as error:
            text = self._text.where(error)
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
            return f"{self._at_return(now, message)}: act returned {short(u)}, which is no array of numbers {wanted}."
        if inputs.shape != wanted:
            kind = "nothing" if u is None else f"an array {inputs.shape}"
            return f"{self._at_return(now, message)}: act returned {kind} where inputs {wanted} (arms, axes) are due."
        if not np.isfinite(inputs).all():
            return f"{self._at_return(now, message)}: act returned {short(inputs.tolist())}, which is not finite."
        message[INPUTS : INPUTS + inputs.size] = inputs.ravel()
        return self._write_back(message)

    def _write_back(self, message: np.ndarray) -> str:
        at = MEMORY
        for name, part in self.declaration.memory:
            value = np.asarray(getattr(self._law, name), float)
            if value.shape not in ((part.size,), ()) or not np.isfinite(value).all():
                return (
                    f"{self._first_line()}: the memory {name} became {short(value.tolist())}; "
                    f"it needs {part.size} finite numbers."
                )
            message[at : at + part.size] = value
            at += part.size
        for place, (name, _) in enumerate(self.declaration.signals):
            try:
                message[SIGNALS + place] = float(getattr(self._law, name))
            except (TypeError, ValueError):
                return f"{self._first_line()}: the signal {name} became {short(getattr(self._law, name))}, no number."
        return ""

    def _first_line(self) -> str:
        return self._text.first_line("act")

    def _at_return(self, now: Any, message: np.ndarray) -> str:
        return self._text.at_return("act", lambda: self._law.act(Measurement(now, float(message[PERIOD]))))
