"""Every command comes back from JSON unchanged."""

import json
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.codec import command_from_values, command_values, state_from_values, state_json
from flexlab.sim.commands import (
    ChangeScenario,
    Command,
    LoadScenario,
    Pause,
    Play,
    Pull,
    Reset,
    SetSpeed,
    StepOnce,
    Tap,
)
from flexlab.sim.samples import Origin, WorldState
from flexlab.sim.world import World

finite = st.floats(allow_nan=False, allow_infinity=False)
pair = st.tuples(finite, finite)
link = st.none() | st.tuples(st.integers(1, 2), st.integers(1, 3))


def through_json(command: Command) -> Command:
    """The command as a recording gives it back."""
    return command_from_values(json.loads(json.dumps(command_values(command))))


@given(st.builds(Pull, finite, pair, finite, link) | st.builds(Tap, finite, pair) | st.builds(SetSpeed, finite))
def test_every_bit_of_a_number_comes_back(command: Command) -> None:
    assert repr(through_json(command)) == repr(command)


@pytest.mark.parametrize(
    "command", [Reset(), Play(), Pause(), StepOnce(7), LoadScenario(load_preset("paper"), "paper")]
)
def test_the_other_commands_come_back(command: Command) -> None:
    assert through_json(command) == command


def test_an_origin_comes_back_with_every_bit() -> None:
    world = World(load_preset("fast-adaptation"))
    world.advance(7)
    origin = Origin("2026-01-01T00-00-00-paper", 0.007, world.state())
    found = through_json(LoadScenario(world.scenario, "fast-adaptation", origin))
    assert found == LoadScenario(world.scenario, "fast-adaptation", origin)
    assert isinstance(found, LoadScenario)
    assert found.origin is not None
    for field in fields(WorldState):
        one, other = getattr(found.origin.state, field.name), getattr(origin.state, field.name)
        assert np.asarray(one).tobytes() == np.asarray(other).tobytes()


def test_changes_keep_their_values() -> None:
    change = ChangeScenario({"payload.bending_stiffness": 0.1, "controller.adaptation": (1.0, 2.0, 3.0), "gravity": 0})
    assert through_json(change) == change


def test_numpy_numbers_become_plain_numbers() -> None:
    found = through_json(ChangeScenario({"gravity": np.float64(9.81), "a": np.array([1.0, 2.0])}))
    assert found == ChangeScenario({"gravity": 9.81, "a": (1.0, 2.0)})


def test_a_pull_of_the_first_recordings_is_one_of_the_beam() -> None:
    """As written on 21 November 2026, before a hand could hold a link."""
    text = '{"kind": "Pull", "beam_position": 0.02, "target": [0.1, 0.8], "stiffness": 30.0}'
    assert command_from_values(json.loads(text)) == Pull(0.02, (0.1, 0.8), 30.0)


def test_a_state_of_the_first_recordings_goes_on() -> None:
    world = World(load_preset("paper"))
    world.apply(Pull(0.02, (0.1, 0.8), 30.0))
    world.advance(7)
    written = json.loads(state_json(world.state()))
    written["pull"] = written["pull"][:4]  # Position, target and stiffness: only the beam could be held.
    other = World(load_preset("paper"))
    other.restore(state_from_values(written))
    assert world.advance(20).pose.tobytes() == other.advance(20).pose.tobytes()


@pytest.mark.parametrize("text", ["5", "[]", "{}", '{"kind": "Explode"}', '{"kind": "Tap"}', '{"kind": "Tap", "x": 1}'])
def test_what_is_no_command_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(RecordingError, match="a command that this version of flexlab cannot read"):
        command_from_values(json.loads(text))
