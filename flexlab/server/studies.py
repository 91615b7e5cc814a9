"""The studies that visitors have started: how far they are, what came of them; bounded, gone when the server closes."""

import asyncio
import contextlib
import logging
import secrets
import shutil
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.plan import Plan
from flexlab.analysis.sweep.result import TABLE
from flexlab.analysis.tuning import Cost
from flexlab.errors import FlexlabError, LabError
from flexlab.scenario import Scenario
from flexlab.scenario.settings import change_settings
from flexlab.server.limits import Asker
from flexlab.server.study_jobs import GrowingSweep, Tuned, sweep_study, tuning_study
from flexlab.server.tasks import Tasks

AT_ONCE = 1
"""Studies that compute together: the server's other long work keeps a turn of its own."""
MOST_WAITING = 5
"""Studies that wait for their turn."""
MOST_OF_ONE = 2
"""Studies of one visitor that compute or wait."""
MOST_OF_ADDRESS = AT_ONCE + MOST_WAITING - 1
"""The same of one address: a place stays free for others."""
MOST_KEPT = 30
"""Studies that are remembered: the oldest finished one goes first."""
ID_BYTES = 9
"""Randomness of a study's address: whoever has it may look and cancel, so that nobody guesses it."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SweepWish:
    """A sweep that somebody wants."""

    scenario: Scenario
    """What is varied, with the accuracy of a lab's run, which is finer than a cell's."""
    plan: Plan

    def cell_scenario(self, cell: int) -> Scenario:
        """A cell's scenario for the lab. Raises `ScenarioError` for one that is not valid."""
        return change_settings(self.scenario, self.plan.changes(cell))

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The fields."""
        return self.plan.axes

    @property
    def kind(self) -> str:
        """In a word."""
        return "Sweep"


@dataclass(frozen=True)
class TuningWish:
    """A tuning that somebody wants."""

    scenario: Scenario
    axes: tuple[Axis, ...]
    cost: Cost
    duration: float
    candidates: int

    @property
    def kind(self) -> str:
        """In a word."""
        return "Tuning"


@dataclass(frozen=True)
class Study:
    """One study, as it stands."""

    id: str
    asker: Asker
    visitor: str
    """Whose it is; empty: everybody's."""
    name: str
    """Of the scenario: a preset's, or the lab's."""
    wish: SweepWish | TuningWish
    share: float = 0.0
    """How far it is, 0 to 1."""
    working: bool = True
    sentence: str = "Waiting for its turn"
    problem: bool = False
    data: dict[str, Any] | None = None
    """Of a finished sweep, what the page draws."""
    tuned: Tuned | None = None
    """Of a finished tuning."""


@dataclass
class Studies:
    """All studies of one server. For its event loop only."""

    tasks: Tasks
    folder: Path
    """Where the tables lie; somebody else removes it."""
    _turn: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(AT_ONCE))
    _studies: OrderedDict[str, Study] = field(default_factory=OrderedDict[str, Study])
    _tasks: dict[str, asyncio.Task[None]] = field(default_factory=dict[str, asyncio.Task[None]])
    _growing: dict[str, GrowingSweep] = field(default_factory=dict[str, GrowingSweep])

    def start(self, asker: Asker, visitor: str, name: str, wish: SweepWish | TuningWish) -> Study:
        """Begin a study, or queue it. Raises `LabError` if too much is going on."""
        working = [study for study in self._studies.values() if study.working]
        if sum(study.visitor == visitor for study in working) >= MOST_OF_ONE:
            raise LabError(f"{MOST_OF_ONE} studies of yours are being computed: wait for one, or cancel it.")
        from_here = sum(study.asker.address == asker.address for study in working)
        most = AT_ONCE + MOST_WAITING + asker.is_teacher  # One place is kept for the teacher.
        if len(working) >= most or (from_here >= MOST_OF_ADDRESS and not asker.is_teacher):
            raise LabError(f"{len(working)} studies are being computed on this machine: try again in a few minutes.")
        study = Study(secrets.token_urlsafe(ID_BYTES), asker, visitor, name, wish)
        self._studies[study.id] = study
        self._forget_old()
        task = asyncio.create_task(self._compute(study))
        self._tasks[study.id] = task
        task.add_done_callback(lambda _: (self._tasks.pop(study.id, None), self._growing.pop(study.id, None)))
        return study

    def get(self, name: str) -> Study | None:
        """A study by its id."""
        return self._studies.get(name)

    def of(self, visitor: str) -> list[Study]:
        """A visitor's studies, the newest first."""
        return [study for study in reversed(self._studies.values()) if study.visitor == visitor]

    def cancel(self, study: Study) -> None:
        """End a study that is being computed."""
        task = self._tasks.get(study.id)
        if task is not None:
            task.cancel()
            self._note(study.id, working=False, problem=True, sentence="Cancelled.")

    async def data(self, study: Study) -> dict[str, Any] | None:
        """What the page draws of a sweep, as far as it is computed; None of what has no map."""
        if study.data is not None or not (study.working and isinstance(study.wish, SweepWish)):
            return study.data
        growing = self._growing.setdefault(study.id, GrowingSweep(study.wish.plan, self._place(study)))
        return await asyncio.to_thread(growing.data)

    def table(self, study: Study) -> Path | None:
        """The table of a finished sweep."""
        path = self._place(study) / TABLE
        return path if study.data is not None and path.exists() else None

    def _place(self, study: Study) -> Path:
        return self.folder / f"study-{study.id}"

    async def _compute(self, study: Study) -> None:
        def report(share: float) -> None:
            self._note(study.id, share=share, sentence=f"Computing: {100 * share:.0f} %")

        try:
            async with self._turn:
                self._note(study.id, sentence="Starting")
                if isinstance(study.wish, SweepWish):
                    job = self.tasks.run(
                        study.asker, sweep_study, study.wish.plan, self._place(study), on_progress=report
                    )
                    self._note(study.id, data=await job)
                else:
                    wish = study.wish
                    parts = wish.scenario, wish.axes, wish.cost, wish.duration, wish.candidates
                    self._note(
                        study.id, tuned=await self.tasks.run(study.asker, tuning_study, *parts, on_progress=report)
                    )
        except FlexlabError as error:
            self._note(study.id, working=False, problem=True, sentence=str(error))
        except asyncio.CancelledError:
            with contextlib.suppress(OSError):
                await asyncio.shield(asyncio.to_thread(shutil.rmtree, self._place(study), ignore_errors=True))
            raise
        except Exception as error:
            log.exception("A study failed.")
            sentence = f"This study failed ({type(error).__name__}): try it on the command line."
            self._note(study.id, working=False, problem=True, sentence=sentence)
        else:
            self._note(study.id, working=False, share=1.0, sentence="Finished.")

    def _note(self, name: str, **news: Any) -> None:
        if name in self._studies and self._studies[name].working:
            self._studies[name] = replace(self._studies[name], **news)

    def _forget_old(self) -> None:
        done = [study for study in self._studies.values() if not study.working]
        for study in done[: max(len(self._studies) - MOST_KEPT, 0)]:
            del self._studies[study.id]
            shutil.rmtree(self._place(study), ignore_errors=True)
