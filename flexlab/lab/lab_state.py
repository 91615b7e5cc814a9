"""The state that all controls of one lab share: commands to the runner, requested scenario, undo, view settings, notices."""

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, NamedTuple

from flexlab.errors import LabError, ScenarioError
from flexlab.guide import LOCKED, ClassRules, LessonProgress
from flexlab.lab.changes import Settings, SlowChanges, Undo
from flexlab.lab.mode_computation import peak_deflection
from flexlab.lab.reference_run import Recorded, ReferenceRun
from flexlab.lab.view_settings import ViewSettings, fitting_window, tamed_exaggeration
from flexlab.own.path import needs_running, with_table
from flexlab.physics.plant import ON_BEAM, Hand
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import changes_towards, differences
from flexlab.sim.commands import ChangeScenario, Command, LoadScenario, Pause, Play, Pull, Reset, SetSpeed
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Origin, WorldState
from flexlab.sim.snapshot import Snapshot
from flexlab.sim.target import change_path
from flexlab.sim.termination import check_trajectory, same_reach
from flexlab.views import fitting_exaggeration

NOTICE_TIME = 12.0
"""How long a notice stays on the screen, wall s: enough to read two lines twice."""
SEEN_AT_ONCE = 0.3
"""Time over which the largest deflection counts as the present one, simulated s: a period of the softest beam offered."""

BY_UNDO = "Undo (Ctrl+Z) goes back."
"""The way back from a preset or file that somebody has opened."""

BY_PERSON: ContextVar[bool] = ContextVar("by_person", default=False)
"""Whether a person at the page makes the request: the teacher's lock binds only them."""


@dataclass(frozen=True)
class Notice:
    """A sentence for the person at the screen; `level` "info" or "error"."""

    text: str
    level: str = "info"
    at: float = 0.0


class Outside(NamedTuple):
    """What a lab asks of the program around it."""

    recording: Callable[[], str] = lambda: ""
    """The sentence that the panel shows about the recording."""
    recorded_as: Callable[[], str] = lambda: ""
    """The name of the present run's recording; empty if it is not recorded."""
    recorded: Recorded | None = None
    """Reads the part of the present run that the engine no longer keeps."""
    link: Callable[[Scenario], str] | None = None
    """The address that opens a scenario in another browser, empty for one that is too long; None if there are no addresses."""
    lesson: str = ""
    lessons: tuple[LessonProgress, ...] = ()
    """The open lesson and the progress of the same person's lab before, as in `LabState`."""


class LabState:
    """Takes changes from callbacks on the server's event loop, and is read by the drawing thread. Thread-safe."""

    def __init__(self, runner: Runner, origin: Origin | None = None, outside: Outside | None = None):
        """`origin`: the instant from which the runner's first run continues."""
        snapshot = runner.snapshot
        self.outside = outside or Outside()
        self.runner = runner
        """Simulates the run that the lab shows."""
        self.lock = threading.RLock()
        """Held while settings change, and by code that reads them more than once."""
        self._settings = Settings.of_run(snapshot.scenario, snapshot.name, origin)
        self._run_name = snapshot.name
        self._run_number = snapshot.run_number
        self._undo = Undo()
        self._asked = 0
        self._asked_play, self._asked_speed = (0, False), (0, 1.0)
        self._notice = Notice("")
        self.pulled: Pull | None = None
        """The pull that a person holds now."""
        self.kept: ReferenceRun | None = None
        """The run that is drawn behind the present one."""
        self.touched_at = -math.inf
        """When a person last used a control, monotonic s."""
        self.lesson = self.outside.lesson
        """The open lesson and its progress, in words; empty if none is open."""
        self.lessons = {progress.lesson: progress for progress in self.outside.lessons}
        """Progress in each lesson that was opened."""
        self.rules = ClassRules()
        """The teacher's rules."""
        self.company: Callable[[], int] = lambda: 0
        """Number of browsers connected to this lab."""
        self.view = ViewSettings(exaggeration=fitting_exaggeration(snapshot.scenario))
        """What the screen shows."""
        self._lesson_factor: float | None = None
        self._fitted_speed = snapshot.target_speed
        self._slow = SlowChanges(self._change_slowly, self.warn)
        self._let_go_of(origin)

    @property
    def snapshot(self) -> Snapshot:
        """The runner's newest snapshot."""
        return self.runner.snapshot

    @property
    def intended(self) -> Scenario:
        """The scenario with every accepted change, including those that the engine has not applied yet."""
        return self._settings.scenario

    @property
    def to_keep(self) -> Scenario:
        """`intended` with the title and words of `baseline`, to be saved: the run itself keeps its earlier ones."""
        return self.intended.replace({"title": self.baseline.title, "watch": self.baseline.watch})

    @property
    def baseline(self) -> Scenario:
        """The preset or file that the scenario came from, unchanged."""
        return self._settings.baseline

    @property
    def name(self) -> str:
        """Name of the preset or file that the scenario came from."""
        return self._settings.name

    @property
    def playing(self) -> bool:
        """Whether the run moves, or will as soon as the engine has answered the last request."""
        (number, wanted), snapshot = self._asked_play, self.snapshot
        return wanted if snapshot.answered < number else snapshot.moves

    @property
    def target_speed(self) -> float:
        """Simulated seconds per wall second, as last requested."""
        (number, wanted), snapshot = self._asked_speed, self.snapshot
        return wanted if snapshot.answered < number else snapshot.target_speed

    @property
    def changed(self) -> bool:
        """Whether the scenario differs from the preset or file that it came from, apart from titles."""
        return bool(differences(self._settings.baseline, self._settings.scenario))

    def set_view(self, **changes: Any) -> None:
        """Change settings of the screen."""
        with self.lock:
            self.view = dataclasses.replace(self.view, **changes)

    def hold_exaggeration(self, factor: float | None) -> None:
        """Begin each run with this factor on the drawn deflection, as in a lesson; None for the factor that suits the run."""
        self._lesson_factor = factor
        if factor is not None and self.view.follow_deflection:
            self.set_view(exaggeration=factor)

    def _fit_exaggeration(self, scenario: Scenario) -> None:
        """Choose the factor for a run that begins. Beside a kept run it stays, so that the two can be compared."""
        if self.view.follow_deflection and self.kept is None:
            self.set_view(exaggeration=self._lesson_factor or fitting_exaggeration(scenario))

    def change(self, changes: Mapping[str, Any]) -> None:
        """Request changes of scenario fields, by field path. Raises `ScenarioError`, and sends nothing, if the result is invalid.

        A change that runs a person's own path is carried out on another thread; if it is refused, a notice says why.
        """
        self._check_lock()
        of_path = any(path.partition(".")[0] == "trajectory" for path in changes)
        if of_path and (self._slow.is_busy or needs_running(self.intended.trajectory, changes)):
            self._slow.ask(changes)
        else:
            self._change(changes)

    def _change_slowly(self, changes: Mapping[str, Any], asked: SlowChanges) -> None:
        """Carry out a change, unless another run has begun since it was asked for: it was not meant for that one."""
        if asked is self._slow:
            # This computes and caches the poses, so that the change itself does not wait for them.
            self.intended.replace(changes)
        with self.lock:
            if asked is self._slow:
                self._change(changes)

    def _change(self, changes: Mapping[str, Any]) -> None:
        with self.lock:
            wanted = change_path(self.intended, changes, float(self.snapshot.latest.time[0]))
            fault = None if same_reach(self.intended, wanted) else check_trajectory(wanted)
            if fault is not None:
                raise ScenarioError([("trajectory", fault.text)])
            self._undo.note(self._settings, gesture=tuple(changes))
            complete = with_table(changes, wanted.trajectory)
            self._send(dataclasses.replace(self._settings, scenario=wanted), complete)

    def load(self, scenario: Scenario, name: str, origin: Origin | None = None) -> None:
        """Request a new run of another scenario, or one that continues an earlier run; it plays after one that `has_failed`."""
        self._check_lock()
        with self.lock:
            plays = self.has_failed
            self._undo.note(self._settings)
            self._start(Settings.of_run(scenario, name, origin))
            if plays:
                self.submit(Play())

    @property
    def has_failed(self) -> bool:
        """Whether the run played until it failed; one that failed at its start may have been paused."""
        last = self.snapshot
        return last.status.failed and float(last.latest.time[0]) > last.start_time

    def go_on(self, scenario: Scenario, origin: Origin) -> None:
        """Request a run that continues from an instant of the present one; its preset or file stays the same."""
        self._check_lock()
        with self.lock:
            self._undo.note(self._settings)
            self._start(Settings(scenario, self.name, self.baseline, origin))

    def saved(self, scenario: Scenario, name: str) -> None:
        """Count changes against `scenario` from now on: the present one with another title, which was saved as a file."""
        with self.lock:
            old, self._settings = self._settings, dataclasses.replace(self._settings, name=name, baseline=scenario)
            self._undo.renamed(old, self._settings)

    def undo(self) -> None:
        """Undo the last change; raises `LabError` if there is none."""
        self._step(self._undo.back, "There is nothing to undo.", "Redo (Ctrl+Shift+Z) goes back.")

    def redo(self) -> None:
        """Redo the last undone change; raises `LabError` if there is none."""
        self._step(self._undo.forward, "There is nothing to redo.", BY_UNDO)

    def back_to_baseline(self) -> None:
        """Discard all changes of the preset or file, and start a new run of it."""
        self.load(self.baseline, self.name)

    def submit(self, command: Command) -> int:
        """Pass on any other command; returns its number, as counted by `Snapshot.answered`."""
        self._check_lock()
        with self.lock:
            if isinstance(command, Reset):
                self.pulled = None
                self._fit_exaggeration(self.intended)
            self._ask(command)
            if isinstance(command, Play | Pause):
                self._asked_play = (self._asked, isinstance(command, Play))
            elif isinstance(command, SetSpeed):
                self._asked_speed = (self._asked, command.speed)
            return self._asked

    def pull(self, pull: Pull | None) -> None:
        """Pull the beam or a link, or let go (None)."""
        if pull is not None:
            self._check_lock()
            self.runner.submit(pull)
        elif self.pulled is not None:
            self.runner.submit(dataclasses.replace(self.pulled, stiffness=0.0))
        self.pulled = pull

    def settle(self, snapshot: Snapshot) -> None:
        """Adopt the engine's scenario if it differs: after a change that it refused, or a change or run from elsewhere."""
        with self.lock:
            if snapshot.run_number != self._run_number:
                self._run_number = snapshot.run_number
                # A run begins without a pull, unless time went on, as after a change of the mesh.
                if not _hand(self.runner.checkpoint(float(snapshot.latest.time[0])).state).stiffness:
                    self.pulled = None
            if snapshot.answered < self._asked:
                return
            if snapshot.name != self._run_name:
                self._run_name = snapshot.name
                self._settings = Settings(snapshot.scenario, snapshot.name, snapshot.scenario)
            elif snapshot.scenario != self.intended:
                self._settings = dataclasses.replace(self._settings, scenario=snapshot.scenario)

    def fit_view(self, snapshot: Snapshot) -> None:
        """Adapt exaggeration and plot window to the run, unless a person chose them; called ten times a second."""
        if snapshot.target_speed != self._fitted_speed:
            self._fitted_speed = snapshot.target_speed
            if self.view.follow_speed:
                self.set_view(plot_window=fitting_window(snapshot.target_speed))
        if not self.view.follow_deflection or not snapshot.playing or snapshot.answered < self._asked:
            return  # The request may begin another run, whose factor the old run's bending must not lower.
        payload, recent = snapshot.scenario.payload, self.runner.recent(SEEN_AT_ONCE)
        if len(recent) and recent.beam_coordinates.shape[1] == payload.coordinate_count:
            deflection = peak_deflection(payload, recent.beam_coordinates)
            factor = tamed_exaggeration(self.view.exaggeration, deflection, payload.length)
            if factor != self.view.exaggeration:
                self.set_view(exaggeration=factor)

    def say(self, text: str, level: str = "info") -> None:
        """Show a sentence to everybody in this lab."""
        self._notice = Notice(text, level, time.monotonic())

    def warn(self, text: str) -> None:
        """Show everybody a sentence about what went wrong or was refused."""
        self.say(text, "error")

    @property
    def notice(self) -> Notice:
        """The notice to show now; its text is empty if there is none."""
        notice = self._notice
        return notice if time.monotonic() - notice.at < NOTICE_TIME else Notice("")

    def _ask(self, command: Command) -> None:
        with self.lock:
            self._asked = self.runner.submit(command)

    def _check_lock(self) -> None:
        """Raise `LabError` if a person at the page makes a request while the teacher has locked the lab."""
        if self.rules.locked and BY_PERSON.get():
            raise LabError(LOCKED)

    def _step(self, move: Callable[[Settings], Settings | None], otherwise: str, way_back: str) -> None:
        self._check_lock()
        with self.lock:
            present = self._settings
            wanted = move(present)
            if wanted is None:
                raise LabError(otherwise)
            if dataclasses.replace(wanted, scenario=present.scenario) == present:
                self._send(wanted, changes_towards(present.scenario, wanted.scenario))
            else:
                self._start(wanted, way_back)

    def _send(self, settings: Settings, changes: Mapping[str, Any]) -> None:
        self._settings = settings
        self._ask(ChangeScenario(dict(changes)))

    def _start(self, settings: Settings, way_back: str = BY_UNDO) -> None:
        self._settings, self._run_name = settings, settings.name
        self._slow = SlowChanges(self._change_slowly, self.warn)
        self.pulled = None
        self.set_view(shown_mode=None)
        self._fit_exaggeration(settings.scenario)
        self._ask(LoadScenario(settings.scenario, settings.name, settings.origin))
        self._let_go_of(settings.origin)
        if BY_PERSON.get() and self.company() > 1:
            self.say(f'Somebody in this lab opened "{settings.scenario.title or settings.name}". {way_back}')

    def _let_go_of(self, origin: Origin | None) -> None:
        """End a pull that was active at `origin`: nobody holds it now, and no arrow would show it."""
        if origin is None or not (hand := _hand(origin.state)).stiffness:
            return
        held = None if hand.arm == ON_BEAM else (int(hand.arm) + 1, int(hand.link) + 1)
        self.runner.submit(Pull(hand.position, (hand.target_x, hand.target_y), 0.0, held))


def _hand(state: WorldState) -> Hand:
    """The pull that is active in a state."""
    return Hand(*map(float, state.pull))
