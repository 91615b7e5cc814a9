"""The simulation thread: drains commands, moves a `LiveRun` by an injected clock, publishes snapshots."""

import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace

from flexlab.errors import FlexlabError, ScenarioError
from flexlab.lapack import one_blas_thread
from flexlab.own.path import with_table
from flexlab.scenario import Scenario
from flexlab.sim.assembly import Assembly, Unprepared
from flexlab.sim.command_queue import ATTEMPTS, MOST_WAITING, CommandQueue, Preparation, merged_changes
from flexlab.sim.commands import (
    ChangeScenario,
    Command,
    LoadScenario,
    Pause,
    Play,
    Pull,
    Reset,
    SetSpeed,
    Tap,
    command_text,
)
from flexlab.sim.history import Checkpoint
from flexlab.sim.live_run import LiveRun
from flexlab.sim.samples import Origin, Samples
from flexlab.sim.snapshot import TICK, Consumer, Event, Snapshot
from flexlab.sim.world import World

FRAME = 1 / 60
"""Wall seconds per frame of the runner: the rate of common screens."""
IDLE_PERIOD = 0.25
"""Wall seconds between two frames while nothing happens: an idle lab costs next to nothing."""
SWITCH_INTERVAL = 1e-3
"""Seconds after which Python takes its global lock from a thread that holds it. The simulation may wait that long after every
block of ticks, and only three of Python's usual 5 ms fit into a frame."""
STOP_PERIOD = 0.02
"""Wall seconds between two reminders that the thread is to stop."""


def _new_world(
    scenario: Scenario, origin: Origin | None, known: Sequence[Assembly] = (), at_once: bool = False
) -> World:
    """A world at the start of its scenario, or at `origin`; raises as `World` and `World.restore` do."""
    if origin is None:
        return World(scenario.anew(), TICK, known, at_once)
    world = World(scenario, TICK, known, at_once)
    world.restore(origin.state)
    return world


class Runner:
    """The owner of the world and its thread. `submit` may be called from any thread; nobody else touches the world."""

    snapshot: Snapshot
    """The newest published snapshot."""

    def __init__(
        self,
        scenario: Scenario,
        name: str = "scenario",
        consumers: Sequence[Consumer] = (),
        playing: bool = True,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
        origin: Origin | None = None,
        executor: Executor | None = None,
        hold_starts: bool = False,
    ):
        """Build the world; raises `ScenarioError`. An unreachable trajectory gives a runner with a failed status.

        With an `origin` the run goes on from there; raises `FlexlabError` if its state is not one of this scenario. Slow
        derivations run in `executor`, or on a thread of the runner's own. With `hold_starts` every run waits at t = 0 until it is
        released or played; of several that a dragged slider begins, only the first.
        """
        self._clock, self._sleep = clock, sleep
        self._stopping = threading.Event()
        self._news = threading.Event()
        self._run = LiveRun(consumers, clock, self._stopping, playing, hold_starts)
        self._commands = CommandQueue()
        self._preparation = Preparation(executor)
        self._released = self._answered = 0
        self._thread: threading.Thread | None = None
        self._run.begin(_new_world(scenario, origin), name)
        if origin is not None:
            self._run.note(LoadScenario(scenario, name, origin))
        self._publish(self._clock())

    def start(self) -> None:
        """Start the thread."""
        self._thread = threading.Thread(target=self._loop, name="flexlab-simulation", daemon=True)
        self._run.restart()
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread, end the run, return when both are done. May be called twice."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self._news.set()
        self._preparation.stop()
        # Repeatedly, as the thread may just have begun to work on another world.
        while self._thread is not None and self._thread.is_alive():
            self._run.world.interrupt()
            self._thread.join(STOP_PERIOD)
        self._run.end(self._run.final_status())

    def submit(self, command: Command) -> int:
        """Queue a command; it takes effect at the head of the runner's next frame. Invalid ones become error events.

        Commands of one frame that supersede one another are merged (see `command_queue`). Returns the command's number: a
        snapshot whose `answered` is at least that shows its result.
        """
        number = self._commands.put(command)
        self._news.set()
        if isinstance(command, (LoadScenario, Reset)):
            self._run.world.interrupt()  # Nobody will see what it still computes.
        return number

    def release(self, run_number: int) -> None:
        """Start the run of this number if it waits at its first instant. Any thread."""
        self._released = run_number
        self._news.set()

    def recent(self, seconds: float, ago: float = 0.0) -> Samples:
        """The last `seconds` of the current run at full rate, as they were `ago` s earlier. A copy, any thread.

        At most `HISTORY_SECONDS` in all, and no more than there is.
        """
        return self._run.history.recent(seconds, round(ago / TICK))

    def checkpoint(self, time: float) -> Checkpoint:
        """The newest checkpoint of the current run before simulation time `time`, s. Any thread."""
        return self._run.checkpoints.before(round(time / TICK))

    def frame(self) -> None:
        """Carry out commands, then the ticks that are due, then publish a snapshot. The thread calls it; tests call it alone."""
        run = self._run
        run.open_frame()
        stepping = run.steps_left > 0
        self._drain()
        run.open_frame()  # Whatever the commands cost, simulation time goes on.
        if stepping and run.steps_left:
            run.work_off_steps()
        if self._released == run.number:
            run.release()
        number, due = run.number, run.pacing.due_ticks(self._clock(), run.world.tick)
        while due > 0 and run.may_go_on and run.pacing.playing and number == run.number:
            due -= run.advance(due)
            self._drain()
        wall = self._clock()
        run.pacing.note(wall, run.world.time)
        self._publish(wall)

    def _loop(self) -> None:
        usual = sys.getswitchinterval()
        sys.setswitchinterval(min(SWITCH_INTERVAL, usual))
        try:
            # Drawing uses BLAS, too: with a fine mesh, its spinning idle threads took a core of their own.
            with one_blas_thread():
                self._rounds()
        finally:
            sys.setswitchinterval(usual)

    def _rounds(self) -> None:
        next_frame = self._clock()
        while not self._stopping.is_set():
            self._news.clear()
            self.frame()
            next_frame = max(next_frame + FRAME, self._clock())
            if self._is_idle:
                self._news.wait(IDLE_PERIOD)
            else:
                self._sleep(max(0.0, next_frame - self._clock()))

    @property
    def _is_idle(self) -> bool:
        """Whether the next frame would find nothing to do unless a command comes."""
        works = self._run.is_busy or self._preparation.current is not None
        return not works and self._commands.is_empty

    def _drain(self) -> None:
        refused = self._commands.refused()
        if refused:
            were = "command was" if refused == 1 else "commands were"
            text = f"{refused} {were} left out: more than {MOST_WAITING} came at once. Give them more slowly."
            self._run.say(text, "error")
        prepared = self._preparation.take()
        if prepared is not None:
            self._try(prepared.group, prepared.future.result, prepared.attempt)
            later, self._preparation.later = self._preparation.later, []
            if later:
                self._try(tuple(later))
        current, loads = self._preparation.current, self._commands.has_load
        if current is not None and not current.is_change and not loads:
            return
        free = loads or current is None
        groups = self._commands.take(new_runs=free and self._run.new_run_allowed)
        while groups:
            self._try(groups.pop(0))
            if groups and self._preparation.must_wait(groups[0][0]):
                self._commands.put_back(groups)
                return

    def _try(self, group: tuple[Command, ...], derived: Callable[[], Assembly] | None = None, attempt: int = 0) -> None:
        """Carry out a group of `command_queue.grouped`; errors become events, what takes long is prepared first."""
        try:
            try:
                known = () if derived is None else (derived(),)
                self._carry_out(group, known, at_once=attempt < ATTEMPTS)
            except Unprepared as need:
                self._preparation.start(group, need.scenario, self._run.world.assembly, attempt + 1)
        except FlexlabError as error:
            self._run.say(" ".join(str(error).split("\n")), "error")
        except Exception as error:  # An unforeseen error must neither end the lab nor pass in silence.
            what = f"{type(group[0]).__name__} could not be carried out ({type(error).__name__}: {error})."
            self._run.say(f"{what} Nothing was changed by it.", "error")

    def _carry_out(self, group: tuple[Command, ...], known: tuple[Assembly, ...], at_once: bool) -> None:
        command = group[0]
        if isinstance(command, ChangeScenario):
            self._change_scenario([one for one in group if isinstance(one, ChangeScenario)], known, at_once)
        elif isinstance(command, (Pull, Tap)):
            self._change(command, known, at_once)
        elif isinstance(command, (Reset, LoadScenario)):
            self._load(command, known, at_once)
        elif isinstance(command, (Play, Pause)):
            self._run.play(isinstance(command, Play))
            self._run.note(command)
        elif isinstance(command, SetSpeed):
            self._run.set_speed(command.speed)
            self._run.note(command)
        else:
            self._run.ask_for_steps(command.ticks)
            self._run.note(command)
            self._run.work_off_steps()

    def _load(self, command: LoadScenario | Reset, known: tuple[Assembly, ...], at_once: bool) -> None:
        """Begin a run of another scenario, of an earlier run's state, or of the same scenario anew, and report it."""
        old, origin = self._run.world, None
        scenario, name = old.scenario, self._run.name
        if isinstance(command, LoadScenario):
            self._preparation.drop()
            scenario, name, origin = command.scenario, command.name, command.origin
        event = Event(old.time, command_text(command), command)
        world = _new_world(scenario, origin, (old.assembly, *known), at_once)
        self._run.report(event)
        self._run.end(self._run.final_status())
        self._run.begin(world, name)
        if origin is not None:
            self._run.report(replace(event, time=world.time))

    def _change_scenario(self, changes: Sequence[ChangeScenario], known: tuple[Assembly, ...], at_once: bool) -> None:
        """Apply changes to the world as one, or those that are valid if not all are."""
        preparation = self._preparation
        if preparation.touches(changes):
            preparation.later.extend(changes)
            return
        whole = changes[0] if len(changes) == 1 else ChangeScenario(merged_changes(one.changes for one in changes))
        try:
            self._change(whole, known, at_once)
        except Unprepared:
            if preparation.current is None:
                raise
            preparation.later.extend(changes)
        except ScenarioError:
            if len(changes) == 1:
                raise
            for one in changes:
                self._try((one,))

    def _change(self, command: ChangeScenario | Pull | Tap, known: tuple[Assembly, ...], at_once: bool) -> None:
        """Apply a change to the world; a restart or another mesh begins a new run."""
        world, time_before, final = self._run.world, self._run.world.time, self._run.final_status()
        begins_anew = world.apply(command, known, at_once)
        event = Event(time_before, command_text(command), command)
        if isinstance(command, ChangeScenario):  # A recording must not need a person's own code.
            complete = with_table(command.changes, world.scenario.trajectory)
            if complete != command.changes:
                event = replace(event, command=replace(command, changes=complete))
        self._run.report(event)
        if begins_anew:
            self._run.end(final)
            self._run.begin(world, self._run.name, time_before)
        else:
            self._run.take_on_change()

    def _publish(self, wall: float) -> None:
        come = self._commands.count
        if self._commands.is_empty and self._preparation.current is None:
            self._answered = come
        self.snapshot = self._run.snapshot(wall, self._answered)
