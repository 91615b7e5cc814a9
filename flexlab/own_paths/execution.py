"""Runs a user's path: its text becomes an object, and shares of its length poses."""

import math
from typing import Any

import numpy as np

from flexlab.own_laws.running_text import RunningText, TextProblem, short
from flexlab.own_paths.declaration import LASTING, LONGEST, SHORTEST, PathDeclaration, read_path_declaration


class RunningPath:
    """A path at work. Raises `TextProblem` if its text cannot be run, `ScenarioError` if it declares nothing."""

    def __init__(self, source: str, file: str):
        self.declaration: PathDeclaration = read_path_declaration(source, file)
        self._text = RunningText(source, file, self.declaration.name, self.declaration.line, "path")
        self._path = self._text.made
        self._lasts = LASTING[1] if self.declaration.repeats else LASTING[0]

    def poses(self, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
        """How long it lasts, s, and x, y, θ, (N, 3), at `shares` (N,) of that. Raises `TextProblem`.

        options: the numbers of the options in the order of their declaration, flat.
        """
        at = 0
        for name, option in self.declaration.options:
            size = 3 if isinstance(option.default, tuple) else 1
            setattr(self._path, name, options[at : at + 3].copy() if size == 3 else float(options[at]))
            at += size
        try:
            span = self._span()
            found = np.empty((len(shares), 3))
            for k, t in enumerate((shares * span).tolist()):
                given = self._path.position(t)
                try:
                    found[k] = given
                    fits = np.shape(given) == (3,) and np.isfinite(found[k]).all()
                except (TypeError, ValueError):
                    fits = False
                if not fits:
                    raise TextProblem(self._wrong(t, given))
        except TextProblem:
            raise
        except BaseException as error:  # SystemExit too.
            raise TextProblem(self._text.where(error)) from None
        return span, found

    def _span(self) -> float:
        given = getattr(self._path, self._lasts)
        span = given() if callable(given) else given
        try:
            seconds = float(span)
        except (TypeError, ValueError):
            seconds = math.nan
        if not SHORTEST <= seconds <= LONGEST:
            where = self._text.at_line(self.declaration.line)
            if callable(given):
                where = self._text.first_line(self._lasts)
            raise TextProblem(f"{where}: {self._lasts} = {short(span)} s is outside {SHORTEST:g} to {LONGEST:g} s.")
        return seconds

    def _wrong(self, t: float, given: Any) -> str:
        where = self._text.at_return("position", lambda: self._path.position(t))
        what = "nothing" if given is None else short(given)
        return f"{where}: position({t:g}) returned {what}, which is not three finite numbers x, y, θ."
