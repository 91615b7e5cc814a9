"""The engine compared with MuJoCo and Exudyn on the same system and law; only settings with the same motion are timed."""

from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib.util import find_spec
from io import StringIO

import numpy as np

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World
from peers.bodies import Motion

SAME_POSE = 1e-6
"""Largest pose difference that counts as the same motion, m and rad."""

SAME_DEFLECTION = 2e-5
"""Largest mid-span difference that counts as the same motion, m: a hundredth of the ringing that the paper's start excites."""

OWN_STEP, REFERENCE_STEP = 1e-3, 2.5e-5
"""Steps of the timed run and of the reference motion, s."""

REPEATS = 3
"""Number of timings of each verified setting; the shortest counts."""

Simulator = Callable[[World, int], Motion]
"""Simulates a number of ticks of a world that is at rest."""


@dataclass(frozen=True)
class Setting:
    """A method and step with which a peer is run."""

    engine: str
    """Name of the engine; in lower case, that of its module."""
    text: str
    steps_per_tick: int
    simulate: Simulator


@dataclass(frozen=True)
class PeerRow:
    """One setting: its errors, and its cost if the motion is the same."""

    engine: str
    setting: str
    step: float
    """s."""
    pose_error: float
    """Largest pose difference from the reference motion, m or rad."""
    deflection_error: float
    """Largest mid-span difference from the reference motion, m."""
    ms_per_second: float | None
    """Processor time per simulated second; None if the motion differs."""

    @property
    def same_motion(self) -> bool:
        """Whether both errors are within the tolerances."""
        return self.pose_error <= SAME_POSE and self.deflection_error <= SAME_DEFLECTION


@dataclass(frozen=True)
class PeerComparison:
    """Results of the engine and its peers in the same run."""

    own: PeerRow
    rows: list[PeerRow]
    missing: dict[str, str]
    """Peers that are not installed or failed, with the reason."""

    @property
    def fastest(self) -> PeerRow | None:
        """The cheapest peer setting with the same motion."""
        timed = [row for row in self.rows if row.ms_per_second is not None]
        return min(timed, key=lambda row: row.ms_per_second or 0.0, default=None)

    @property
    def ratio(self) -> float | None:
        """Cost of the fastest peer setting divided by the engine's own; None without peers."""
        if self.fastest is None or not self.fastest.ms_per_second or not self.own.ms_per_second:
            return None
        return self.fastest.ms_per_second / self.own.ms_per_second


def compare_peers(duration: float) -> PeerComparison:
    """Verify and time every setting of the installed peers on the paper's run of `duration` s."""
    world = World(_paper(OWN_STEP))
    ticks = round(duration / world.tick_period)
    exact = simulate(_paper(REFERENCE_STEP), ticks * world.tick_period)
    own = _own_row(world, exact)
    rows: list[PeerRow] = []
    missing: dict[str, str] = {}
    for setting in peer_settings():
        if find_spec(setting.engine.lower()) is None:
            missing[setting.engine] = "not installed: pip install 'flexlab[peers]'"
        elif setting.engine not in missing:
            try:
                rows.append(row_of(setting, world, exact))
            except Exception as error:  # Another engine may raise anything; the benchmark goes on.
                missing[setting.engine] = f"failed: {_first_line(error)}"
    # The engine is timed again after the peers, so that a change in the machine's load affects both.
    own = min(own, _own_row(world, exact), key=lambda row: row.ms_per_second or np.inf)
    return PeerComparison(own, rows, missing)


def peer_settings() -> list[Setting]:
    """Settings to try: each method with its longest usable step (rk4 is unstable above it), some with a shorter one too."""

    def mujoco(integrator: str, steps: int) -> Setting:
        from peers.mujoco_model import simulate_mujoco

        return Setting(
            "MuJoCo", integrator, steps, lambda world, ticks: simulate_mujoco(world, integrator, steps, ticks)
        )

    def exudyn(tolerance: float, steps: int) -> Setting:
        from peers.exudyn_model import simulate_exudyn

        text = f"generalized-alpha, tolerance {tolerance:g}"
        return Setting("Exudyn", text, steps, lambda world, ticks: simulate_exudyn(world, steps, ticks, tolerance))

    return [
        *(mujoco("rk4", steps) for steps in (2, 3)),
        *(mujoco(integrator, 20) for integrator in ("Euler", "implicitfast", "discrete")),
        *(exudyn(tolerance, steps) for tolerance, steps in ((1e-4, 2), (1e-4, 3), (1e-6, 3))),
    ]


def row_of(setting: Setting, world: World, exact: Samples) -> PeerRow:
    """Run a setting, and time it if its motion is that of `exact`, whose first sample is at t = 0."""
    ticks = len(exact) - 1

    def run() -> Motion:
        # Exudyn announces itself on standard output, which belongs to the results.
        with redirect_stdout(StringIO()):
            return setting.simulate(world, ticks)

    motion = run()
    pose = float(np.max(np.abs(motion.pose - exact.pose[1:])))
    deflection = float(np.max(np.abs(motion.deflection - exact.midspan_deflection[1:])))
    step = world.tick_period / setting.steps_per_tick
    row = PeerRow(setting.engine, setting.text, step, pose, deflection, None)
    if not row.same_motion:
        return row
    cpu = min([motion.cpu, *(run().cpu for _ in range(REPEATS - 1))])
    return PeerRow(setting.engine, setting.text, step, pose, deflection, 1e3 * cpu / (ticks * world.tick_period))


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def _own_row(world: World, exact: Samples) -> PeerRow:
    return row_of(Setting("flexlab", "etdrk4", 1, _simulate_own), world, exact)


def _paper(step: float) -> Scenario:
    return load_preset("paper").replace({"simulation.step": step, "simulation.integrator": "etdrk4"})


def _simulate_own(world: World, ticks: int) -> Motion:
    """Run the engine itself in a new world; it computes all its samples, not only pose and deflection."""
    from flexlab.benchmarks.measure import try_out

    trial = try_out(world.scenario, ticks * world.tick_period)
    return Motion(trial.samples.pose, trial.samples.midspan_deflection, trial.cpu)
