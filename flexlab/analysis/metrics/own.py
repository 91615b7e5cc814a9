"""A user's own metrics, made from decorated functions; `run.metrics`, sweeps and tuning then include them.

@flexlab.metric("J", "Work of the motors")
def work(samples: flexlab.Samples) -> float:
    return float(samples.input_work[-1] - samples.input_work[0])

They exist as long as the Python process that declared them, and are sent along with the cells of a sweep. `run.save()` notes
their values beside the recording, where lists and later processes find them.
"""

import inspect
import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np

from flexlab.analysis.metrics.metric import METRICS, Column, Metric, Peak, RootMeanSquare, of_signal, register
from flexlab.analysis.metrics.run_metrics import RunMetrics
from flexlab.errors import StudyError
from flexlab.files import short_hash
from flexlab.text import visible

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples

Kind = Literal["run", "peak", "rms"]
"""What the function returns: the number of a run, or a signal whose largest magnitude or root mean square is the number."""
Function = TypeVar("Function", bound=Callable[["Samples"], Any])
REAL = "biuf"
"""NumPy's kinds of real arrays."""
PLACE = 100
"""Rank after all other metrics."""
COLUMNS = ("cell", "status", "sentence", "scenario", "key", "version")
"""Columns of a sweep's table that are no metrics."""


@dataclass(frozen=True)
class OwnMetric:
    """A declared metric."""

    function: Callable[["Samples"], Any]
    unit: str
    title: str
    of: Kind

    @property
    def name(self) -> str:
        """Name of the function."""
        return self.function.__name__

    @property
    def digest(self) -> str:
        """A digest of the function's text and of what the function uses, which is part of a sweep's key."""
        return short_hash(f"{self.name} {self.unit} {self.of} {_text(self.function, set())}")


PLAIN = (int, float, complex, str, bytes, tuple, list, dict, np.ndarray, np.generic)
"""Types of values that count in a digest."""
ADDRESS = re.compile(r" at 0x[0-9a-f]+")
"""The part of an object's text that differs from process to process."""


def _text(function: Any, seen: set[str]) -> str:
    """The text of a function, with the plain values that it uses and the functions of its module, each once (`seen`)."""
    seen.add(getattr(function, "__qualname__", ""))
    code = getattr(function, "__code__", None)
    try:
        parts = [inspect.getsource(function)]
    except (OSError, TypeError):
        parts = [repr(code and (code.co_code, code.co_consts))]
    if code is not None:
        known = inspect.getclosurevars(function)
        defaults = dict(enumerate(function.__defaults__ or ()))
        used = {**known.globals, **known.nonlocals, **(function.__kwdefaults__ or {}), **defaults}
        for name, value in sorted(used.items(), key=lambda item: str(item[0])):
            if isinstance(value, PLAIN):
                parts.append(f"{name} = {value!r}")
            elif getattr(value, "__module__", "") == function.__module__ and inspect.isfunction(value):
                parts += [] if value.__qualname__ in seen else [_text(value, seen)]
    return ADDRESS.sub("", "\n".join(parts))


DECLARED: dict[str, OwnMetric] = {}
_ONE_BY_ONE = threading.Lock()


def metric(unit: str, title: str = "", of: Kind = "run") -> Callable[[Function], Function]:
    """Decorator: makes a metric from a function of `flexlab.Samples`, under the function's name.

    `unit`: SI; "1" for none. `title`: as tables show it. `of`: with "run", the function returns the number of a whole run, which
    is kept in memory for it; with "peak" or "rms", a signal (N,) for any piece of a run, whose largest magnitude or root mean
    square is the number. NaN and infinity mean that the run has none. If the function fails, the cell of a sweep fails and says
    why. Declaring a metric again replaces it. Raises `StudyError` for a name that is taken.
    """
    if not isinstance(unit, str) or not unit:
        raise StudyError(
            f'unit = {unit!r:.60} is not a unit: give it as text, as in @flexlab.metric("J"), "1" for none.'
        )
    if not isinstance(title, str):
        raise StudyError(f"title = {title!r:.60} is not usable: give a text.")
    if not isinstance(of, str) or of not in ("run", "peak", "rms"):
        raise StudyError(f'of = {of!r:.40} is not usable: give "run", "peak" or "rms".')

    def declare(function: Function) -> Function:
        name = getattr(function, "__name__", "")
        if not callable(function) or not name.isidentifier():
            raise StudyError(f"{function!r:.60} makes no metric: give a function with a name, as def makes it.")
        if name in COLUMNS or hasattr(RunMetrics, name) or name == "note":
            raise StudyError(f"The name {name} is taken in tables or by `run.metrics`: give the function another name.")
        know_own_metrics([OwnMetric(function, unit, title or function.__name__.replace("_", " ").capitalize(), of)])
        return function

    return declare


def know_own_metrics(declared: Sequence[OwnMetric]) -> None:
    """Declare metrics, for example on a worker that computes cells. Raises `StudyError`."""
    for own in declared:
        with _ONE_BY_ONE:
            try:
                register(_made(own), again=own.name in DECLARED)
            except ValueError as error:
                raise StudyError(f"{error}: give the function or its title another name.") from None
            DECLARED[own.name] = own


def own_metrics() -> list[OwnMetric]:
    """All declared metrics that are still registered."""
    return [own for name, own in DECLARED.items() if name in METRICS]


def _made(declared: OwnMetric) -> type[Metric]:
    def signal(samples: "Samples") -> np.ndarray:
        found = _called(declared, samples)
        if found.shape != (len(samples),):
            wanted = f"a signal of these samples has ({len(samples)},)"
            raise StudyError(f"The metric {declared.name} gives an array {found.shape}: {wanted}.")
        return found[:, None]

    signal.__name__, signal.__doc__ = declared.name, declared.function.__doc__ or declared.title
    column = Column(declared.name, declared.title, declared.title, declared.unit)
    base: Any = {"run": _OfRun, "peak": Peak, "rms": RootMeanSquare}[declared.of]
    return of_signal(base, PLACE, column, own=True, declared=declared)(signal)


def _called(declared: OwnMetric, samples: "Samples") -> np.ndarray:
    try:
        found = np.asarray(declared.function(samples))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit too: a sweep goes on.
        reason = visible(" ".join(str(error).split())) or "no reason given"
        raise StudyError(f"The metric {declared.name} failed: {type(error).__name__}: {reason:.300}") from error
    if found.dtype.kind not in REAL:
        raise StudyError(f"The metric {declared.name} gives {found!r:.60}: real numbers are needed.")
    return found.astype(float)


class _OfRun(Metric):
    declared: ClassVar[OwnMetric]

    def __init__(self) -> None:
        self._pieces: list[Samples] = []

    def update(self, samples: "Samples") -> None:
        self._pieces.append(samples)

    def compute(self) -> tuple[float, ...]:
        if not self._pieces:
            return (np.nan,)
        from flexlab.sim.samples import join_blocks  # Imported here so that help does not wait for the engine.

        found = _called(self.declared, join_blocks(self._pieces))
        if found.size != 1:
            raise StudyError(f"The metric {self.declared.name} gives {found.size} numbers: one is needed of a run.")
        return (float(found.reshape(())),)
