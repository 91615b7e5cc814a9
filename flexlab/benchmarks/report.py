"""All results of a benchmark, their goals, and their plain form for JSON."""

from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from flexlab.benchmarks.changes import BEAM_GOAL, FRAME_GOAL, LIGHT_GOAL, MESHES, ChangeCost
from flexlab.benchmarks.environment_rate import RATE_GOAL, EnvironmentRate
from flexlab.benchmarks.machine import Machine
from flexlab.benchmarks.memory import Memory
from flexlab.benchmarks.peers.chain_comparison import ChainComparison
from flexlab.benchmarks.peers.peer_comparison import RATIO_GOAL, PeerComparison
from flexlab.benchmarks.precision import ASKED_ERROR, PAPER_AIM, PAPER_LIMIT, MeshPrecision, PaperCost
from flexlab.benchmarks.scaling import EXPONENT_GOAL, Scaling
from flexlab.benchmarks.startup import StartTimes
from flexlab.benchmarks.workers import SPEED_UP_GOAL, WorkerScaling


@dataclass(frozen=True)
class Goal:
    """One figure that the engine is held to."""

    what: str
    value: float
    unit: str
    limit: float
    at_least: bool
    """Whether the value must reach the limit; otherwise it must stay under it."""

    @property
    def met(self) -> bool:
        """Whether the figure keeps its limit."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit


@dataclass(frozen=True)
class Report:
    """Everything that was measured."""

    machine: Machine
    paper: list[PaperCost]
    precision: list[MeshPrecision]
    scaling: Scaling
    changes: list[ChangeCost]
    workers: WorkerScaling
    environment: EnvironmentRate | None
    """None where Gymnasium is not installed."""
    start: StartTimes
    memory: Memory | None
    """None where the system does not tell."""
    peers: PeerComparison | None
    """None if not asked for."""
    chain: ChainComparison | None
    """None if not asked for."""

    @property
    def goals(self) -> list[Goal]:
        """The goals that could be judged."""
        goals = _paper_goals(self.paper)
        for mesh in self.precision:
            if mesh.fastest is not None and mesh.fastest.ms_per_second is not None:
                what = f"{mesh.elements} elements"
                goals.append(Goal(what, mesh.fastest.ms_per_second, "ms/s", mesh.goal, False))
        goals.append(Goal("cost ~ elements to the power of", self.scaling.exponent, "", EXPONENT_GOAL, False))
        goals += _change_goals(self.changes)
        goals.append(Goal("speed-up of two workers", self.workers.speed_up, "", SPEED_UP_GOAL, True))
        if self.environment is not None:
            what, unit = f"vector environment, {self.environment.worlds} worlds", "thousand steps/s"
            goals.append(Goal(what, self.environment.all_cores / 1e3, unit, RATE_GOAL / 1e3, True))
        if self.peers is not None and self.peers.ratio is not None:
            goals.append(Goal("times faster than the fastest peer", self.peers.ratio, "", RATIO_GOAL, True))
        return goals


def _change_goals(costs: list[ChangeCost]) -> list[Goal]:
    coarse, fine = MESHES[0], MESHES[-1]
    judged = (
        ("a live gain, path or gravity", LIGHT_GOAL, [c.ms for c in costs if c.elements == coarse and c.is_light]),
        ("a live change of the beam", BEAM_GOAL, [c.ms for c in costs if c.elements == coarse and not c.is_light]),
        (f"any live change, {fine} elements", FRAME_GOAL, [c.ms for c in costs if c.elements == fine]),
    )
    return [Goal(what, max(ms), "ms", limit, False) for what, limit, ms in judged if ms]


def _paper_goals(costs: list[PaperCost]) -> list[Goal]:
    good = [cost for cost in costs if cost.pose_error <= ASKED_ERROR and cost.samples_at_1_khz]
    if not good:
        return []
    best = min(cost.ms_per_second for cost in good)
    what = "the paper's run, 1 kHz samples"
    return [Goal(what, best, "ms/s", PAPER_LIMIT, False), Goal(f"{what}: aim", best, "ms/s", PAPER_AIM, False)]


def plain(value: Any) -> Any:
    """A result as dicts, lists, numbers and strings: the fields of each dataclass and its computed properties."""
    if is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in fields(value)]
        names += [name for name, member in vars(type(value)).items() if isinstance(member, property)]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value
