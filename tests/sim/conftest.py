"""Fixtures: a live runner without thread or wall clock, driven by hand, and a consumer that keeps everything it gets."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import Command
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples, Status, WorldState
from flexlab.sim.snapshot import Event, Snapshot


@dataclass
class Keeper:
    """A consumer that keeps everything it gets and reports `drop` rows of every block as lost."""

    runs: list[tuple[int, str, Scenario, WorldState]] = field(default_factory=list)
    blocks: list[tuple[int, Samples]] = field(default_factory=list)
    events: list[tuple[int, Event]] = field(default_factory=list)
    ends: list[tuple[int, Status]] = field(default_factory=list)
    drop: int = 0
    on_block: Callable[[Samples], None] | None = None

    def begin_run(self, run_number: int, name: str, scenario: Scenario, start: WorldState) -> None:
        self.runs.append((run_number, name, scenario, start))

    def take_samples(self, run_number: int, samples: Samples, actual_speed: float) -> int:
        self.blocks.append((run_number, samples))
        if self.on_block is not None:
            self.on_block(samples)
        return self.drop

    def take_event(self, run_number: int, event: Event) -> None:
        self.events.append((run_number, event))

    def end_run(self, run_number: int, status: Status) -> None:
        self.ends.append((run_number, status))

    def signal(self, name: str, run_number: int = 1) -> np.ndarray:
        """All rows of one signal of a run."""
        return np.concatenate([getattr(block, name) for number, block in self.blocks if number == run_number])


class Live:
    """A runner with a clock set by hand and a keeper as its only consumer."""

    def __init__(self, scenario: Scenario, **options):
        self.now = 1000.0
        self.keeper = Keeper()
        self.runner = Runner(scenario, "test", [self.keeper], clock=lambda: self.now, sleep=lambda _: None, **options)

    def frame(self, later: float = 1 / 60, *commands: Command) -> Snapshot:
        """Let `later` seconds pass, submit the commands, and do one round of the runner."""
        self.now += later
        for command in commands:
            self.runner.submit(command)
        self.runner.frame()
        return self.runner.snapshot

    def play(self, seconds: float) -> Snapshot:
        """Do frames of 1/60 s for `seconds` of wall time."""
        for _ in range(round(seconds * 60)):
            self.frame()
        return self.runner.snapshot


@pytest.fixture
def live() -> Callable[..., Live]:
    """Return a function that makes live runners, with the paper's scenario unless another is given."""

    def make(scenario: Scenario | None = None, **options) -> Live:
        return Live(load_preset("paper") if scenario is None else scenario, **options)

    return make


def _same_bits(a: Samples, b: Samples) -> None:
    left, right = a.signals(), b.signals()
    assert left.keys() == right.keys()
    for name, values in left.items():
        assert np.array_equal(values, right[name]), name


@pytest.fixture
def same_bits() -> Callable[[Samples, Samples], None]:
    """Return a function that asserts that two blocks agree in every bit of every signal."""
    return _same_bits
