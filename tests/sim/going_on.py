"""Checks that every extension's tests share: a run in blocks, continued from a state, or live has the same bits."""

import numpy as np

from flexlab.scenario import Scenario
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

ROWS, CUT = 200, 77
"""Number of samples of a run, and of those before it is cut in two."""


def whole_run_as_in_blocks(scenario: Scenario, equal_nan: bool = False) -> Run:
    """Return a whole run; assert that cutting it in two, or going on in a new world from the state between, changes no bit."""
    whole, world, again = simulate(scenario, 0.001 * ROWS), World(scenario), World(scenario)
    world.advance(CUT)
    again.restore(world.state())
    for block in (world.advance(ROWS - CUT), again.advance(ROWS - CUT)):
        for name, values in block.signals().items():
            assert np.array_equal(values, whole[name][CUT + 1 :], equal_nan=equal_nan), name
    return whole


def check_live(stage, whole: Run, *names: str) -> None:
    """Assert that a live run of the same scenario has the same bits in these signals, for 150 samples."""
    stage.play(0.2)
    for name in names:
        seen = np.concatenate([block[name] for _, block in stage.keeper.blocks])
        assert np.array_equal(seen[:150], whole[name][:150]), name
