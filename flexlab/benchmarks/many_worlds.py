"""Many worlds at once: the speed-up by a second worker, and the steps per second of the vector environment.

The two sides alternate, so that the machine's load affects both. On a busy machine two threads may share one core, and wall time
then says nothing about the engine; on Linux the time that threads waited for a core is therefore subtracted as well.
"""

import statistics
import threading
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.workers import THREADS, simulate_many
from flexlab.lapack import one_blas_thread
from flexlab.machine import cores
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

LOOK_EVERY = 0.005
"""Interval between two observations, s; the last one counts as a thread's end."""


class ThreadWatch:
    """Watches this process's threads with a name prefix while a `with` block runs."""

    def __init__(self, prefix: str):
        self._prefix = prefix
        self._lives: dict[int, tuple[float, float]] = {}
        """Thread → instants at which it was first and last seen, s, minus its time in the queue for a core until then."""
        self._ended = threading.Event()
        self._watcher = threading.Thread(target=self._watch, name="thread-watch", daemon=True)

    def __enter__(self) -> "ThreadWatch":
        self._watcher.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._watcher.join()

    @property
    def undisturbed(self) -> float | None:
        """Wall time that the slowest thread would have needed with a core of its own, s; None if it is not known.

        A thread that was seen only once does not count. One that waits for a lock whose owner waits for a core counts as waiting
        for the lock.
        """
        return max((last - first for first, last in self._lives.values() if last > first), default=None)

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_EVERY):
            for thread in threading.enumerate():
                if thread.name.startswith(self._prefix) and thread.native_id is not None:
                    self._look(thread.native_id)

    def _look(self, thread: int) -> None:
        now, waited = time.perf_counter(), time_in_queue(thread)
        if waited is not None:
            first, _ = self._lives.get(thread, (now - waited, 0.0))
            self._lives[thread] = first, now - waited


def time_in_queue(thread: int) -> float | None:
    """Time for which a thread of this process was ready but had no core, s; None on systems other than Linux."""
    try:
        return int(Path(f"/proc/self/task/{thread}/schedstat").read_text(encoding="ascii").split()[1]) * 1e-9
    except (OSError, ValueError, IndexError):
        return None


SPEED_UP_GOAL = 1.7
"""Goal for the ratio of one worker's time to that of two."""
WORKERS = 2
DURATION = 3.0
"""Simulated time of each scenario, s."""
ROUND = 40
"""Scenarios per round, about a second of work."""


@dataclass(frozen=True)
class Round:
    """One batch."""

    wall: float
    """s."""
    cpu: float
    """Processor time of all threads, s."""
    undisturbed: float | None
    """Wall time without the slowest thread's time in the queue for a core, s; None if it is not known."""


@dataclass(frozen=True)
class WorkerScaling:
    """The same batches on one worker and on two."""

    scenarios: int
    """Number of scenarios in all rounds."""
    one: list[Round]
    two: list[Round]
    locked_share: float
    """Share of a run's processor time outside the kernels, where only one thread at a time can run."""

    @property
    def wall_speed_up(self) -> float:
        """Ratio of the best round of one worker to the best round of two, by wall time, under the machine's load."""
        return min(r.wall for r in self.one) / min(r.wall for r in self.two)

    @property
    def cores_received(self) -> float:
        """Processor time over wall time of two workers, median: near 2 on an idle machine."""
        return statistics.median(r.cpu / r.wall for r in self.two)

    @property
    def speed_up(self) -> float:
        """Ratio of the best round of one worker to the best of two, without the time in the queue for a core if known."""
        one = [r.undisturbed for r in self.one if r.undisturbed is not None]
        two = [r.undisturbed for r in self.two if r.undisturbed is not None]
        return min(one) / min(two) if one and two else self.wall_speed_up


def worker_scaling(rounds: int) -> WorkerScaling:
    """Simulate `rounds` different batches on one worker and on two, in turn."""
    one, two = [], []
    for number in range(rounds):
        batch = [_scenario(number * ROUND + k) for k in range(ROUND)]
        one.append(_round(batch, 1))
        two.append(_round(batch, WORKERS))
    return WorkerScaling(rounds * ROUND, one, two, locked_share())


def locked_share() -> float:
    """Share of a run's processor time that goes into building the world and packing the samples."""
    scenario, ticks = _scenario(0), round(DURATION / 1e-3)
    kernels, whole = [], []
    with one_blas_thread():
        for _ in range(3):
            start = time.thread_time()
            simulate(scenario, DURATION)
            whole.append(time.thread_time() - start)
            world = World(scenario)
            rows = world.new_rows(ticks)
            start = time.thread_time()
            world.fill(rows)
            kernels.append(time.thread_time() - start)
    return max(0.0, 1 - min(kernels) / min(whole))


def _scenario(number: int) -> Scenario:
    return load_preset("paper").replace({"payload.bending_stiffness": 50.0 + number})


def _round(batch: list[Scenario], workers: int) -> Round:
    wall, cpu = time.perf_counter(), time.process_time()
    with ThreadWatch(THREADS) as watch:
        simulate_many(batch, DURATION, workers=workers, progress=False)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return Round(wall, cpu, watch.undisturbed)


if TYPE_CHECKING:
    from flexlab.gym_environment import TwoArmsVector

RATE_GOAL = 4e5
"""Goal for the steps per second on two cores."""
WORLDS = 64
STEPS = 500
"""Control periods of a round, 0.5 s, within which no episode ends."""
PUSH = 0.2
"""Largest action; under such random pushes no world fails."""


@dataclass(frozen=True)
class EnvironmentRate:
    """World steps per second at 1 kHz control, the paper's scenario."""

    worlds: int
    cores: int
    """Number of cores of this machine."""
    one_core: float
    """Per second of processor time, on one thread."""
    all_cores: float
    """Per second of wall time, under the machine's load."""


def measure_environment(rounds: int) -> EnvironmentRate | None:
    """The best of `rounds` rounds on one core and on all, in turn; None if Gymnasium is not installed."""
    if find_spec("gymnasium") is None:
        return None
    from flexlab.gym_environment import TwoArmsVector

    one, every = TwoArmsVector(WORLDS, threads=1), TwoArmsVector(WORLDS)
    try:
        actions = np.random.default_rng(0).uniform(-PUSH, PUSH, (STEPS, WORLDS, 3))
        times = np.array([[_steps(one, actions)[1], _steps(every, actions)[0]] for _ in range(rounds)])
    finally:
        one.close()
        every.close()
    best = WORLDS * STEPS / times.min(axis=0)
    return EnvironmentRate(WORLDS, cores(), float(best[0]), float(best[1]))


def _steps(envs: "TwoArmsVector", actions: np.ndarray) -> tuple[float, float]:
    """Wall time, and this thread's processor time, s."""
    envs.reset(seed=0)
    wall, cpu = time.perf_counter(), time.thread_time()
    for action in actions:
        envs.step(action)
    return time.perf_counter() - wall, time.thread_time() - cpu
