"""The laws that enter, with their settings, and the rows: one law in one variant of one case, with its scores."""

import platform
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import llvmlite.binding
from pydantic import ConfigDict, TypeAdapter

from flexlab.analysis.leaderboard.case import SAMPLE_PERIOD, Case
from flexlab.analysis.metrics.run_metrics import between
from flexlab.analysis.result import ResultHash
from flexlab.control.law import laws
from flexlab.errors import FlexlabError, StudyError
from flexlab.lapack import one_blas_thread
from flexlab.own.files import LAW_FILES, law_kind
from flexlab.scenario import Scenario
from flexlab.scenario.settings import PERIOD, change_settings, with_period_if_needed
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import sample_count, tick_at
from flexlab.sim.world import World

SETTINGS: dict[str, dict[str, Any]] = {
    "composite-kalman": {"controller.kind": "composite", "controller.observer.kind": "kalman"},
    "composite-soft": {
        "controller.kind": "composite",
        "controller.slow.sliding_slope": 30.0,
        "controller.lateral_vibration_gain": 60.0,
    },
}
"""Further entries of a law: with an observer instead of measured rates, and with a slow part that suits soft beams."""
AnyEntrant = str | Path | type


@dataclass(frozen=True)
class Entrant:
    """A law with the settings with which it enters all cases."""

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    """The changes that give a scenario this law, by path."""

    @property
    def settings(self) -> str:
        """The settings that differ from the law's defaults, in words."""
        own = {
            path: value for path, value in self.changes.items() if path not in ("controller.kind", "controller.source")
        }
        return ", ".join(f"{path.removeprefix('controller.')} = {value}" for path, value in own.items())

    def scenario(self, plain: Scenario, law_fields: Mapping[str, Any]) -> tuple[Scenario, str] | None:
        """(a case's scenario with this law, a note on what had to be set for it); None if the law lacks one of the fields.

        Raises `ScenarioError` if the scenario is not valid.
        """
        changes = with_period_if_needed(plain, self.changes)
        found = change_settings(plain, changes)
        period = found.controller.control_period
        note = "" if period == plain.controller.control_period else f"sampled, {PERIOD} = {period:g} s"
        for name, value in law_fields.items():
            owner = next((path for path in ("controller", "controller.slow") if found.has(f"{path}.{name}")), None)
            if owner is None:
                return None
            found = found.replace({f"{owner}.{name}": value})
        return found, note


def entrants() -> dict[str, Entrant]:
    """Flexlab's own entrants by name, in the order of menus; laws that drive nothing do not enter."""
    found: dict[str, Entrant] = {}
    for kind, law in laws().items():
        if not law.drives or not law.model.__module__.startswith("flexlab.control.laws."):
            continue
        found[kind] = Entrant(kind, law.chosen())
        for name, settings in SETTINGS.items():
            if settings["controller.kind"] == kind:
                found[name] = Entrant(name, settings)
    return found


def chosen_entrants(wanted: Sequence[AnyEntrant] | None, more: Sequence[AnyEntrant] = ()) -> tuple[Entrant, ...]:
    """Entrants by name, file or class; None: flexlab's own; `more`: further ones. Raises `StudyError` or `ScenarioError`."""
    known = entrants()
    for name, given in (("laws", wanted), ("more_laws", more)):
        if isinstance(given, str) or not (given is None or isinstance(given, Sequence)):
            raise StudyError(f"{name} = {given!r:.60} is not a list: give names or files, as in ['pd', 'my_law.py'].")
    LAW_FILES.kinds_of([law for law in [*(wanted or ()), *(more or ())] if not (isinstance(law, str) and law in known)])
    first = list(known.values()) if wanted is None else [_entrant(law, known) for law in wanted]
    found = {entrant.name: entrant for entrant in [*first, *(_entrant(law, known) for law in more or ())]}
    if not found:
        raise StudyError("laws is empty: name one law or more, as in ['pd', 'my_law.py'], or leave it out for all.")
    return tuple(found.values())


def _entrant(wanted: AnyEntrant, known: Mapping[str, Entrant]) -> Entrant:
    if isinstance(wanted, str) and wanted in known:
        return known[wanted]
    kind = law_kind(wanted)
    law = laws().get(kind)
    if law is None:
        raise StudyError(f"{kind!r:.60} is not a control law: choose from {', '.join(known)}, or give a Python file.")
    return Entrant(kind, law.chosen())


BLOCK = 5000
"""Most samples of a run in memory at once."""
FINISHED, INVALID = "finished", "invalid"


@dataclass(frozen=True)
class Row:
    """The result of a task. Rows with the same key are the same, bit for bit, on the same kind of machine."""

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid")

    law: str
    case: str
    variant: str
    status: str
    """As `Run.status`, or "invalid"."""
    sentence: str
    """Why it failed, or from when on its results are inaccurate; empty if neither."""
    note: str
    """Settings that differ from the law's defaults, and what else had to be set for it."""
    scores: dict[str, float | None] = field(hash=False)
    """The scores by name, SI; None where a score has no value; empty if the law failed."""
    seed: int
    """Seed of the sensors' noise."""
    result_hash: str
    """Hash of all samples, as `Run.result_hash`."""
    key: str
    """Hash of scenario, law, case and engine."""
    engine: str
    version: str
    machine: str

    @property
    def failed(self) -> bool:
        """Whether the law did not reach the end of the case."""
        return self.status != FINISHED

    @property
    def place(self) -> tuple[str, str, str]:
        """(case, variant, law), which no two rows of a table share."""
        return self.case, self.variant, self.law

    def as_data(self) -> dict[str, Any]:
        """The row as plain data."""
        return asdict(self)

    @staticmethod
    def from_data(data: Any) -> "Row":
        """The row from `as_data`. Raises ValueError or TypeError for anything else."""
        return _ROW.validate_python(dict(data))


_ROW = TypeAdapter(Row)


class Task(NamedTuple):
    """A row that is to be computed."""

    case: Case
    scenario: Scenario | None
    """None if it is not valid; the row says why."""
    row: Row
    """The row as far as it is known beforehand."""


def machine() -> str:
    """The processor, for which the engine is compiled."""
    return f"{platform.machine()} {llvmlite.binding.get_host_cpu_name()}"


def compute(task: Task) -> Row:
    """Simulate a task on this machine, which may be a cluster's worker. The row of a law that fails says why."""
    hashed, metrics = ResultHash(), [(score, score.metric()) for score in task.case.scores]
    row = replace(task.row, machine=machine())
    if task.scenario is not None:
        try:
            with one_blas_thread(), _turn(task.scenario):
                world = World(task.scenario.anew(), SAMPLE_PERIOD)
                for samples in _blocks(world, task.case):
                    hashed.update(samples)
                    for score, metric in metrics:
                        if len(piece := between(samples, *score.window)):
                            metric.update(piece)
            if world.status.failed:
                row = replace(row, status=str(world.status), sentence=world.status.text)
            else:
                values = {score.name: float(metric.compute()[score.number]) for score, metric in metrics}
                scores = {name: value if isfinite(value) else None for name, value in values.items()}
                row = replace(row, status=FINISHED, sentence=world.accuracy_warning, scores=scores)
        except FlexlabError as error:
            row = replace(row, sentence=str(error))
    return replace(row, sentence=" ".join(row.sentence.split()), result_hash=hashed.text())


_turns: dict[str, threading.Lock] = {}


def _turn(scenario: Scenario) -> AbstractContextManager[object]:
    """A lock by which runs of the same Python law take turns, because the last error is kept per law, not per run."""
    source = getattr(scenario.controller, "source", "")
    return _turns.setdefault(source, threading.Lock()) if source else nullcontext()


def _blocks(world: World, case: Case) -> Iterator[Samples]:
    """The samples of a case in blocks, from the world's start on, as `sim.simulate` gives them with the case's commands."""
    count = sample_count(case.duration, SAMPLE_PERIOD)
    if not world.status.failed:
        yield world.observe()
    stops = [(min(count, tick_at(time, SAMPLE_PERIOD)), command) for time, command in case.commands]
    for stop, command in [*sorted(stops, key=lambda item: item[0]), (count, None)]:
        while world.tick < stop and not world.status.failed:
            yield world.advance(min(BLOCK, stop - world.tick))
        if command is not None and not world.status.failed:
            world.apply(command)
