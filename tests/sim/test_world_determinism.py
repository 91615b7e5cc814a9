"""The same scenario with the same commands at the same ticks gives the same bits, in any blocks, live or headless."""

import copy
import pickle
from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest

from flexlab.control.law import laws
from flexlab.errors import StudyError
from flexlab.presets import load_preset
from flexlab.scenario.settings import change_settings, with_period_if_needed
from flexlab.sim.closed_loop import scratch_workspace
from flexlab.sim.commands import ChangeScenario, Pull, Tap, WorldCommand
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

COMMANDS: list[tuple[int, WorldCommand]] = [
    (40, ChangeScenario({"payload.bending_stiffness": 35.0})),
    (70, ChangeScenario({"controller.feedback_gain": (150.0, 260.0, 80.0), "controller.sliding_slope": 40.0})),
    (100, ChangeScenario({"payload.damping": {"kind": "modal", "ratio": 0.02}})),
    (101, ChangeScenario({"trajectory.amplitude": (0.15, 0.1, 0.25)})),
    (150, ChangeScenario({"trajectory.frequency": (1.5, 1.5, 0.8)})),
    (180, Tap(0.1, (0.05, -0.1))),
    (200, Pull(-0.05, (0.1, 0.9), 300.0)),
    (230, Pull(0.2, (-0.9, 0.6), 250.0, (1, 2))),
    (260, Pull(0.2, (-0.9, 0.6), 0.0, (1, 2))),
    (261, ChangeScenario({"gravity": 4.0, "controller.adaptation": (1.0, 1.0, 1.0)})),
]
TICKS = 320

SETTINGS = {
    "etdrk4": {},
    "rk4": {"simulation.integrator": "rk4"},
    "generalized-alpha": {"simulation.integrator": "generalized-alpha", "simulation.step": 2.5e-4},
    "sampled, delayed, noisy": {
        "controller.control_period": 0.002,
        "controller.input_delay": 2,
        "controller.sensor_noise": {"pose": [1e-5] * 3, "pose_rate": [1e-3] * 3, "strain": 1e-4, "seed": 5},
        "controller.torque_limit": (400.0, 400.0, 400.0),
        "initial.pose_rate": None,
    },
}


def joined(blocks: list[Samples]) -> Samples:
    return Samples(**{f.name: np.concatenate([getattr(block, f.name) for block in blocks]) for f in fields(Samples)})


def in_blocks(changes: dict, sizes: list[int]) -> Samples:
    """The run with all commands, in blocks of the given sizes, over and over; blocks also end at commands."""
    world = World(load_preset("paper").replace(changes))
    blocks, pending, turn = [world.observe()], list(COMMANDS), 0
    while world.tick < TICKS:
        while pending and pending[0][0] == world.tick:
            assert world.apply(pending.pop(0)[1]) is False
        stop = min(world.tick + sizes[turn % len(sizes)], pending[0][0] if pending else TICKS, TICKS)
        blocks.append(world.advance(stop - world.tick))
        assert world.status == "running", world.status.text
        turn += 1
    return joined(blocks)


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
def test_block_sizes_change_no_bit(changes: dict, same_bits):
    """Blocks are of one tick, of varying numbers of ticks, or as long as possible."""
    whole = in_blocks(changes, [TICKS])
    same_bits(whole, in_blocks(changes, [1]))
    same_bits(whole, in_blocks(changes, [7, 64, 3]))


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
def test_a_live_run_and_its_headless_replay_are_the_same_bits(changes: dict, live, same_bits):
    """Commands act where frames happen to be; replayed at the ticks of their events, every bit is the same."""
    scenario = load_preset("paper").replace(changes)
    stage, pending = live(scenario), [command for _, command in COMMANDS]
    rng = np.random.default_rng(3)
    while pending or stage.runner.snapshot.latest.time[0] < 0.35:
        now = [pending.pop(0)] if pending and rng.random() < 0.6 else []
        stage.frame(float(rng.uniform(0.001, 0.05)), *now)

    assert stage.runner.snapshot.status == "running"
    world = World(scenario)
    blocks, warnings = [world.observe()], [""]
    for _, event in stage.keeper.events:
        if event.level == "warning":  # A warning about the run, repeated when errors have grown; it changes nothing.
            warnings.append(event.text)
            continue
        assert event.level == "info"
        blocks.append(world.advance(round(event.time / 0.001) - world.tick))
        world.apply(event.command)
    blocks.append(world.advance(len(stage.keeper.signal("time")) - 1 - world.tick))
    same_bits(joined([block for _, block in stage.keeper.blocks]), joined(blocks))
    assert warnings[-1] == stage.runner.snapshot.accuracy_warning == world.accuracy_warning


def test_looking_at_a_world_does_not_change_it(same_bits):
    """`observe` and `state` between blocks leave no trace."""
    looked = World(load_preset("paper"))
    blocks = [looked.observe()]
    for _ in range(50):
        looked.observe()
        looked.state()
        blocks.append(looked.advance(2))
    same_bits(joined(blocks), World(load_preset("paper")).run(100))


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
def test_observe_returns_the_last_sample_of_the_run(changes: dict, same_bits):
    world = World(load_preset("paper").replace(changes))
    for ticks in (1, 2, 30):
        block, look = world.advance(ticks), world.observe()
        last = Samples(**{f.name: getattr(block, f.name)[-1:] for f in fields(Samples)})
        same_bits(last, look)


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
def test_a_restored_state_goes_on_bit_for_bit(changes: dict, same_bits):
    """`state()` after commands is restored in a fresh world with the scenario of that moment."""
    world = World(load_preset("paper").replace(changes))
    world.apply(Pull(0.1, (0.1, 0.9), 200.0))
    world.advance(123)
    world.apply(ChangeScenario({"payload.bending_stiffness": 50.0, "trajectory.frequency": (1.2, 1.2, 1.2)}))
    world.advance(7)
    state = world.state()
    again = World(world.scenario)
    again.advance(31)
    again.restore(state)
    same_bits(again.run(100), world.run(100))


@pytest.mark.parametrize("preset", ["stiff-beam", "vibration-damping"])
def test_a_state_in_the_transition_to_another_path_goes_on_bit_for_bit(preset: str, same_bits):
    """A world that was built in the transition tried its step at t = 0 on a path that jumps there: 64 times as many steps."""
    world = World(load_preset(preset))
    world.advance(20)
    world.apply(ChangeScenario({"trajectory.kind": "figure-eight"}))
    world.advance(5)
    again = World(world.scenario)
    assert again.assembly.steps == world.assembly.steps
    again.restore(world.state())
    same_bits(again.run(40), world.run(40))


@pytest.mark.parametrize("kind", [kind for kind in laws() if kind != "none"])
def test_the_step_depends_on_no_world_before(kind: str):
    """The rates of `regressor-adaptive` followed the acceleration that another world had left in the shared workspace."""
    scenario = load_preset("single-arm")
    scenario = change_settings(scenario, with_period_if_needed(scenario, {"controller.kind": kind}))
    found = World(scenario).assembly
    left_over = scratch_workspace(found.system).truth[0]
    left_over.desired[:], left_over.v[:], left_over.x[:] = 40.0, 3.0, 1.0
    again = World(scenario).assembly
    assert (again.steps, again.asked, again.instability) == (found.steps, found.asked, found.instability)


def test_a_state_is_a_copy(same_bits):
    """Going on does not change a state taken before; it can be restored twice."""
    world = World(load_preset("paper"))
    world.advance(20)
    state = world.state()
    first = world.run(30)
    for _ in range(2):
        world.restore(state)
        same_bits(world.run(30), first)


def test_thousands_of_samples_lie_exactly_on_their_instants():
    """time[k] = k · sample_period to the last bit, from t = 0, also for periods that are not binary fractions."""
    for period in (0.001, 0.0007, 1 / 3000):
        samples = World(load_preset("smooth-start"), period).run(3000)
        assert np.array_equal(samples.time, np.arange(3001) * period)


def test_samples_are_read_only():
    """Nobody can change what others see."""
    samples = World(load_preset("paper")).run(5)
    for signal in fields(Samples):
        with pytest.raises(ValueError, match="read-only"):
            getattr(samples, signal.name)[...] = 0


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_world_refuses_to_be_copied(duplicate: Callable[[World], object]) -> None:
    """A copy moved its original, or answered from memory that both shared."""
    with pytest.raises(StudyError, match="cannot be copied or pickled: build one of the same scenario"):
        duplicate(World(load_preset("paper")))
