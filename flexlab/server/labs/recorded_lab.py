"""One lab with its recorder: its page is on a loopback port, its runs go to the logs folder. Also the one lab that all share."""

import asyncio
import math
import shutil
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from flexlab.analysis.run_summary import MetricNotes
from flexlab.errors import RecordingError
from flexlab.guide import LOCKED, ClassRules, LessonProgress, begun
from flexlab.lab.lab_state import Outside
from flexlab.lab.session import Session
from flexlab.recording.live import LiveHub, Take
from flexlab.recording.reader import read_range
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.run_index import OPEN_LESSON
from flexlab.scenario import Scenario
from flexlab.server.labs import Choice, Lab, LabProvider, LabStatus, Order, Request
from flexlab.server.limits import Quota, Visitor
from flexlab.server.scenario_links import encode_scenario, scenario_path
from flexlab.server.settings import GIGABYTE, MEGABYTE
from flexlab.sim.commands import Pause, Play
from flexlab.sim.samples import Samples

LOOK_PERIOD = 1.0
"""Seconds between two checks of the file and the disk."""
MEASURED = 10
"""Number of checks over which the rate is measured, each of which found a larger file."""
STILL = 3 * LOOK_PERIOD
"""Seconds of an unchanged size after which there is no rate: the run waits for its page, or is paused."""
LITTLE_SPACE = 2 * GIGABYTE
"""Free bytes below which there is a warning: room for an hour of a lab that nobody stops."""


def little_space(logs: Path) -> str:
    """A warning, without a full stop, if the disk of the logs folder is nearly full; else empty."""
    try:
        free = shutil.disk_usage(logs).free
    except OSError:
        return ""
    if free >= LITTLE_SPACE:
        return ""
    return f"Only {free / GIGABYTE:.1f} GB free on this disk: delete runs that nobody needs"


class RecordingText:
    """The panel's sentence about the recording. The panel calls it ten times a second; it checks the disk once a second."""

    def __init__(self, recorder: Recorder, logs: Path, clock: Callable[[], float] = time.monotonic):
        self._recorder, self._logs, self._clock = recorder, logs, clock
        self._looks: deque[tuple[float, int]] = deque(maxlen=MEASURED)
        self._path: Path | None = None
        self._size = 0
        self._looked_at = float("-inf")
        self._warning = ""

    def __call__(self) -> str:
        """Return the sentence; empty before there is a recording."""
        if self._recorder.problem is not None:
            return self._recorder.problem
        path = self._recorder.path
        if path is None:
            return ""
        if self._clock() - self._looked_at >= LOOK_PERIOD:
            self._look(path)
        return f"Recording to {path.name}{self._rate()}{self._warning}"

    def _look(self, path: Path) -> None:
        self._looked_at = self._clock()
        try:
            size = path.stat().st_size
        except OSError:
            return  # The recorder reports what is wrong with the disk.
        if path != self._path or (self._looks and self._looked_at - self._looks[-1][0] >= STILL):
            self._looks.clear()
        elif size != self._size:
            self._looks.append((self._looked_at, size))
        self._path, self._size = path, size
        little = little_space(self._logs)
        self._warning = f". {little}" if little else ""

    def _rate(self) -> str:
        if len(self._looks) < 2:
            return ""
        (first, before), (last, now) = self._looks[0], self._looks[-1]
        return f", {60 * (now - before) / (last - first) / MEGABYTE:.0f} MB/min"


class RecordedLab(Lab):
    """A session and its recorder, opened and closed together."""

    def __init__(self, order: Order, live: Take | None = None, on_problem: Callable[[str], None] | None = None):
        """Start both; `live` takes the data as they come. Raises `FlexlabError`, and leaves nothing running, on failure."""
        self.secret, self.name, self._owner = order.secret, order.visitor, order.owner
        self._lesson: Callable[[], str] = str
        self._lessons: Callable[[], Iterable[LessonProgress]] = tuple
        self._recorder = recorder = Recorder(
            order.logs,
            live,
            on_problem=on_problem,
            start_notes=MetricNotes,
            circumstances=self._circumstances,
            refusal=Quota(order.logs, order.owner, order.quota),
        )
        self._shown: tuple[Scenario | None, str] = (None, "")

        def link(scenario: Scenario) -> str:
            path = scenario_path(encode_scenario(scenario))
            return path and order.address + path

        try:
            self._session = Session(
                order.choice.scenario,
                order.choice.name,
                consumers=[recorder],
                port=0,
                shadows=order.shadows,
                origin=order.choice.origin,
                secret=order.secret,
                playing=not order.choice.stands,
                # Live data may be watched while no page of the lab is open.
                attended=live is None,
                outside=Outside(
                    RecordingText(recorder, order.logs),
                    lambda: recorder.path.stem if recorder.path is not None else "",
                    self._recorded,
                    link,
                    order.lesson,
                    order.lessons,
                ),
            )
            self._session.start()
            self.port = self._session.port
            lab_state = self._session.lab_state
            self._lesson = lambda: lab_state.lesson
            self._lessons = lambda: lab_state.lessons.values()  # Its run ends after the session.
        except BaseException:
            recorder.close()
            raise

    def load(self, choice: Choice) -> None:
        """Start a run of a scenario, or continue an earlier run; a lab that already shows this scenario is left alone."""
        if self._session.lab_state.rules.locked:
            self._session.lab_state.warn(LOCKED)
        elif self._open(choice) and not self._owner and self._session.lab_state.company():
            title = choice.scenario.title or choice.name
            self._session.lab_state.say(f"Somebody opened {title} in this lab. Undo (Ctrl+Z) goes back.")

    def _open(self, choice: Choice) -> bool:
        snapshot = self._session.runner.snapshot
        shown = snapshot.scenario == choice.scenario and snapshot.name == choice.name and not snapshot.status.failed
        if shown and choice.origin is None:
            return False
        self._session.lab_state.load(choice.scenario, choice.name, choice.origin)
        if choice.stands or self._session.lab_state.rules.locked:
            self._session.lab_state.submit(Pause())
        elif not snapshot.playing:
            # A playing lab starts the new run by itself once its page is drawn; this command would not wait for that.
            self._session.lab_state.submit(Play())
        return True

    def _circumstances(self) -> dict[str, Any]:
        """The notes of a run: its owner with their open lesson, and the lessons that were begun in this lab."""
        lessons = [lesson._asdict() for lesson in begun(self._lessons())]
        whose = {"owner": self._owner, "visitor": self.name, OPEN_LESSON: self._lesson()} if self._owner else {}
        return whose | ({"lessons": lessons} if lessons else {})

    def _recorded(self, end: float) -> Samples:
        """The present run up to an instant, s. Raises `RecordingError` if it is not being recorded."""
        path = self._recorder.path
        if path is None:
            raise RecordingError(self._recorder.problem or "This run is not being recorded.")
        return read_range(path, None, end)

    def rename(self, visitor: str) -> None:
        """Take its visitor's new name."""
        self.name = visitor

    async def ask(self, what: Request) -> None:
        """Carry out the teacher's request."""
        self.carry_out(what)

    def carry_out(self, what: Request) -> None:
        """As `ask`, without an event loop."""
        lab_state = self._session.lab_state
        if isinstance(what, Choice):
            self._open(what)
            lab_state.say(f"The teacher opened {what.scenario.title or what.name}.")
        elif isinstance(what, ClassRules):
            self._follow(what)
        elif (paused := isinstance(what, Pause)) or not self._session.runner.snapshot.status.failed:
            lab_state.submit(what)
            lab_state.say("The teacher paused this lab." if paused else "The teacher resumed this lab.")

    def _follow(self, rules: ClassRules) -> None:
        """Apply new rules; the lab shows the ones in force and says which have ended."""
        lab_state = self._session.lab_state
        before, lab_state.rules = lab_state.rules, rules
        if rules.locked and not before.locked:
            lab_state.submit(Pause())
        elif before.locked and not rules.locked:
            lab_state.say("The teacher unlocked this lab: press Play.")
        elif before.lesson and not rules.lesson:
            lab_state.say("The teacher lets everybody choose their own lesson.")
        elif rules.hides_names != before.hides_names:
            names = "hides all names" if rules.hides_names else "shows all names"
            lab_state.say(f"The teacher's page {names}.")

    def status(self) -> LabStatus:
        """Its present state."""
        snapshot, recorder = self._session.runner.snapshot, self._recorder
        if self._shown[0] is not snapshot.scenario:
            self._shown = snapshot.scenario, encode_scenario(snapshot.scenario)
        state = "stopped" if snapshot.status.failed else "running" if snapshot.moves else "paused"
        return LabStatus(
            name=snapshot.name,
            title=snapshot.scenario.title or snapshot.name,
            time=float(snapshot.latest.time[0]),
            state=state,
            link=self._shown[1],
            recording=recorder.path,
            problem=recorder.problem or "",
            error=math.hypot(*snapshot.latest.tracking_error[0, :2]),
            lesson=self._session.lab_state.lesson,
            lessons=tuple(self._lessons()),
        )

    def close(self) -> Path | None:
        """End the lab, keep its run, and return the path of its recording."""
        last = self._recorder.path
        self._session.stop()
        self._recorder.close()
        return last


class SharedLab(LabProvider):
    """The lab that all visitors share: they watch and move the same arms."""

    def __init__(self, order: Order, on_problem: Callable[[str], None] | None = None):
        """Start the lab. Raises `FlexlabError` as `RecordedLab` does."""
        super().__init__()
        live = LiveHub() if order.live else None
        self.laboratory = RecordedLab(order, live.take if live else None, on_problem)
        self.laboratory.live = live

    async def enter(self, visitor: Visitor, choice: Choice | None) -> Lab:
        """Return the lab, showing what this visitor chose."""
        if choice is not None:
            self.laboratory.load(choice)
        return self.laboratory

    def of_visitor(self, visitor: str) -> Lab | None:
        """The lab."""
        return self.laboratory

    def running(self) -> Sequence[Lab]:
        """The lab."""
        return [self.laboratory]

    async def close(self) -> Path | None:
        """End the lab and return its last recording."""
        if self.laboratory.live is not None:
            self.laboratory.live.close()
        return await asyncio.to_thread(self.laboratory.close)
