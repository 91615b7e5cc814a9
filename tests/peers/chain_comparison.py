"""What the same pose error costs with the environment's setting and with MuJoCo's chain of segments.

The reference is the engine on a fine mesh with a short step. Two things differ from `peer_comparison`, so that only the
beam's discretisation and the step matter: damping is proportional to the stiffness, which does not depend on the mesh, and
the law is a PD law of the joints, because the paper's law uses the inertia of the mesh's own modes. It acts at 1 kHz with
held torques, as in the environment.

With more segments the chain's pose error falls only to a limit: rods keep their length, so a bent chain is shorter, which
the model leaves out. This part grows with the square of the amplitude and is no error of the chain.
"""

import time
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World
from peers.bodies import Motion

CONTROL_PERIOD = 1e-3
"""s."""

BETA = 2e-4
"""s; gives the first mode the damping ratio of the paper's beam, 0.028."""

OWN_STEP, REFERENCE_STEP = 1e-3, 5e-5
"""s. The first is the environment's own, chosen for its accuracy."""

OWN_MESHES, REFERENCE_MESH = (2, 4, 8), 32
"""Numbers of elements; the first is the environment's."""

DURATION = 0.1
"""s; contains the jerk at the start, where errors are largest."""

OWN_TICKS = 500
"""Control periods over which the engine's cost is measured: a run of `DURATION` is over in half a millisecond."""

REPEATS = 3
"""Number of timings of each row; the shortest counts."""

CHAINS = (
    (2, "RK4", 1), (4, "RK4", 1), (6, "RK4", 3), (8, "RK4", 10), (16, "RK4", 200),
    (4, "implicitfast", 5), (8, "implicitfast", 50), (16, "implicitfast", 50), (32, "implicitfast", 50),
)  # fmt: skip
"""Segments, integrator, steps per control period. RK4's steps are about the longest stable ones, as its damping is explicit;
implicitfast is of first order, so that its step determines its error."""


@dataclass(frozen=True)
class ChainRow:
    """One discretisation of the beam with one step."""

    engine: str
    parts: int
    """Elements, or segments of the chain."""
    integrator: str
    step: float
    """s."""
    pose_error: float
    """m or rad."""
    deflection_error: float
    """At mid-span, m."""
    ms_per_second: float
    """Processor time per simulated second."""

    @property
    def environment_rate(self) -> float:
        """Steps/s of an environment with this row's cost at 1 kHz, on one core, if nothing else took time."""
        return 1e3 / CONTROL_PERIOD / self.ms_per_second


@dataclass(frozen=True)
class ChainComparison:
    """Results of the engine's meshes, the environment's first, and of the chains."""

    own: list[ChainRow]
    chains: list[ChainRow]
    missing: str | None
    """Why there are no chains; None if there are."""

    @property
    def equal(self) -> ChainRow | None:
        """The cheapest chain whose pose error is at most the environment's."""
        return self._cheapest([row for row in self.chains if row.pose_error <= self.own[0].pose_error])

    @property
    def equal_in_both(self) -> ChainRow | None:
        """The cheapest chain whose errors are both at most the environment's."""
        good = [row for row in self.chains if row.pose_error <= self.own[0].pose_error]
        return self._cheapest([row for row in good if row.deflection_error <= self.own[0].deflection_error])

    @property
    def ratio(self) -> float | None:
        """Cost of `equal` over that of the environment's setting."""
        return None if self.equal is None else self.equal.ms_per_second / self.own[0].ms_per_second

    @property
    def ratio_in_both(self) -> float | None:
        """Cost of `equal_in_both` over that of the environment's setting."""
        return None if self.equal_in_both is None else self.equal_in_both.ms_per_second / self.own[0].ms_per_second

    def _cheapest(self, rows: list[ChainRow]) -> ChainRow | None:
        return min(rows, key=lambda row: row.ms_per_second, default=None)


def compare_chains() -> ChainComparison:
    """Run and time the engine's meshes and, where MuJoCo is installed, the chains."""
    exact = simulate(chain_scenario(REFERENCE_MESH, REFERENCE_STEP), DURATION)
    chains: list[ChainRow] = []
    missing = None if find_spec("mujoco") else "not installed: pip install 'flexlab[peers]'"
    if missing is None:
        world = World(chain_scenario(OWN_MESHES[0], OWN_STEP))
        chains = [_chain_row(world, exact, *chain) for chain in CHAINS]
    return ChainComparison([_own_row(mesh, exact) for mesh in OWN_MESHES], chains, missing)


def chain_scenario(elements: int, step: float) -> Scenario:
    """The paper's system and path with a law and damping that do not depend on the mesh."""
    changes = {
        "controller.control_period": CONTROL_PERIOD,
        "payload.element_count": elements,
        "payload.damping": {"kind": "stiffness", "coefficient": BETA},
        "simulation.step": step,
        "simulation.integrator": "etdrk4",
    }
    return load_preset("paper").replace({"controller.kind": "joint-pd"}).replace(changes)


def motion_errors(motion: Motion, exact: Samples) -> tuple[float, float]:
    """Largest differences of pose (m or rad) and mid-span deflection (m) from `exact`, whose first sample is at t = 0."""
    pose = float(np.max(np.abs(motion.pose - exact.pose[1:])))
    return pose, float(np.max(np.abs(motion.deflection - exact.midspan_deflection[1:])))


def _own_row(elements: int, exact: Samples) -> ChainRow:
    scenario = chain_scenario(elements, OWN_STEP)
    run, world, costs = simulate(scenario, DURATION), World(scenario, CONTROL_PERIOD), []
    errors = motion_errors(Motion(run.pose[1:], run.midspan_deflection[1:], 0.0), exact)
    # The first call checks the types of a hundred arrays; an environment does so only once.
    world.advance(1)
    for _ in range(REPEATS):
        began = time.thread_time()
        world.advance(OWN_TICKS)
        costs.append((time.thread_time() - began) / (OWN_TICKS * CONTROL_PERIOD))
    return ChainRow("flexlab", elements, "etdrk4", OWN_STEP, *errors, 1e3 * min(costs))


def _chain_row(world: World, exact: Samples, segments: int, integrator: str, steps: int) -> ChainRow:
    from peers.mujoco_model import simulate_chain

    ticks = len(exact) - 1
    motions = [simulate_chain(world, segments, integrator, steps, ticks) for _ in range(REPEATS)]
    cost = 1e3 * min(motion.cpu for motion in motions) / DURATION
    return ChainRow("MuJoCo", segments, integrator, CONTROL_PERIOD / steps, *motion_errors(motions[0], exact), cost)
