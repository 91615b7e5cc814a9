"""The memory of a live engine stays constant; that of a headless run is the size of its samples."""

import gc
import tracemalloc

import numpy as np

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


def test_a_live_runners_memory_stays_flat(live, monkeypatch):
    """Once the history is full, ten more simulated seconds with slider moves leave hardly any further memory allocated."""
    monkeypatch.setattr("flexlab.sim.history.HISTORY_SECONDS", 5.0)
    stage = live()
    stage.keeper.blocks = Forgetful()
    stage.play(1.0)
    tracemalloc.start()
    try:
        levels = []
        for _ in range(4):
            for k in range(300):
                stage.frame(1 / 60, *([ChangeScenario({"controller.feedback_gain": 200.0 + k})] if k % 30 == 0 else []))
            stage.keeper.events.clear()
            gc.collect()  # Otherwise reference cycles are freed at a moment that depends on earlier tests.
            levels.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert levels[-1] - levels[1] < 200_000, levels


class Forgetful(list):
    """A list that keeps nothing."""

    def append(self, item) -> None:
        pass


def test_the_peak_memory_of_a_run_is_that_of_its_samples():
    """Twice the samples take twice the memory: the peak is that of the kept rows, to a few per cent and a constant."""
    world = World(load_preset("paper"))
    row_bytes = 8 * world.row_length
    simulate(load_preset("paper"), 0.1)
    peaks = []
    counts = (20_000, 40_000)
    for count in counts:
        tracemalloc.start()
        try:
            run = simulate(load_preset("smooth-start"), count * 0.0001, 0.0001)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
        assert len(run) == count + 1
        assert np.isfinite(run.pose).all()
    assert peaks[1] - peaks[0] < 1.05 * row_bytes * (counts[1] - counts[0])
    assert peaks[0] < 1.05 * row_bytes * counts[0] + 5_000_000
