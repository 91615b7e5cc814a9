"""A recorded run replays bit for bit and can be continued, and a changed recording is detected."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import having
from recording_helpers import assert_same_bits
from rerun.chunk import RrdReader

import flexlab
from flexlab.analysis.replay import TOLERANCE, _Comparison, replay
from flexlab.analysis.resume import resume, state_at
from flexlab.analysis.run_summary import note_metrics
from flexlab.errors import StudyError
from flexlab.presets import load_preset, preset_names
from flexlab.recording.headless import write_run
from flexlab.recording.reader import Recording, read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.formats import ARITHMETIC
from flexlab.recording.store.run_files import list_runs
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Origin
from flexlab.sim.signals import TABLE
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World
from flexlab.text import number_text

OF_THE_PATH = (
    {"trajectory.frequency": (0.9, 0.8, 0.7)},
    {"trajectory.duration": 0.8},
    {"trajectory.pose": (0.01, 0.76, 0.02)},
    {"trajectory.start": 0.1},
)
"""Changes of a path; the first one whose field the path has is made."""


def live_recording(
    preset: str, logs: Path, scenario: Scenario | None = None, origin: Origin | None = None
) -> Recording:
    """A live run of half a second with changed sliders, a tap and pulls, as a person makes them."""
    now = [0.0]
    recorder = Recorder(logs)
    runner = Runner(scenario or load_preset(preset), preset, [recorder], clock=lambda: now[0], origin=origin)
    half = 0.4 * runner.snapshot.scenario.payload.length
    commands = [
        ChangeScenario({"payload.bending_stiffness": 61.0}),
        Tap(half, (0.02, 0.05)),
        Pull(0.1 * half, (0.1, 0.8), 30.0),
        ChangeScenario(next(change for change in OF_THE_PATH if runner.snapshot.scenario.has(next(iter(change))))),
        Pull(0.3, (-0.8, 0.5), 40.0, (1, 2)),
        ChangeScenario({"gravity": 1.0, "payload.damping.coefficient": 0.05})
        if runner.snapshot.scenario.payload.damping.kind == "nodal"
        else ChangeScenario({"gravity": 1.0}),
        Pull(0.0, (0.0, 0.0), 0.0),
    ]
    for command in commands:
        for _ in range(4):
            now[0] += 0.0173
            runner.frame()
        runner.submit(command)
    for _ in range(4):
        now[0] += 0.0173
        runner.frame()
    runner.stop()
    recorder.close()
    (path,) = list_runs(logs)
    return read_recording(path)


@pytest.mark.parametrize("preset", preset_names())
def test_every_preset_with_sliders_and_pokes_replays_bit_for_bit(preset: str, tmp_path: Path) -> None:
    recording = live_recording(preset, tmp_path)
    assert len(recording.samples) > 400
    assert not [event.text for event in recording.events if event.level == "error"]
    found = replay(recording)
    assert found.text == f"All {len(recording.samples)} samples came out again, bit for bit."
    assert found.identical


def test_noise_sampled_control_and_delay_replay_bit_for_bit(tmp_path: Path) -> None:
    noise = {"pose": (1e-4, 1e-4, 1e-4), "pose_rate": (1e-3, 1e-3, 1e-3), "strain": 1e-6, "seed": 7}
    controller = {"control_period": 0.002, "input_delay": 1, "sensor_noise": noise}
    scenario = load_preset("vibration-damping").replace({f"controller.{name}": controller[name] for name in controller})
    found = replay(live_recording("noisy", tmp_path, scenario))
    assert found.identical, found.text
    assert found.compared > 400


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    return live_recording("paper", tmp_path)


def test_a_single_flipped_bit_is_found_with_time_and_signal(recording: Recording) -> None:
    torque = recording.samples.joint_torque.copy()
    torque.view(np.int64)[123, 1, 2] ^= 1
    changed = having(recording, replace(recording.samples, joint_torque=torque))
    found = replay(changed)
    assert found.difference is not None
    assert (found.difference.time, found.difference.signal) == (0.123, "joint_torque")
    assert "differs first at t = 0.123 s in joint_torque" in found.text
    assert "recorded by flexlab" in found.text


def older(recording: Recording) -> Recording:
    """The recording as it would have been before results were the same on every machine."""
    properties = {
        name: value for name, value in recording.properties.items() if name not in ("arithmetic", "processor")
    }
    return replace(recording, properties=properties)


def test_a_recording_names_its_arithmetic_machine_and_versions(recording: Recording) -> None:
    assert recording.properties["arithmetic"] == ARITHMETIC
    names = ("processor", "machine", "flexlab_version", "numpy_version", "numba_version", "llvmlite_version")
    assert all(recording.properties[name] for name in names)


def test_an_older_recording_is_compared_with_a_stated_tolerance(recording: Recording) -> None:
    assert replay(older(recording)).identical
    last_bits = recording.samples.joint_torque * (1 + 1e-15)
    rounded = having(recording, recording.samples.having(joint_torque=last_bits))
    assert not replay(rounded).agrees, "a recording of today's rule is the same bit for bit"
    found = replay(having(older(rounded), rounded.samples))
    assert found.agrees
    assert not found.identical
    assert (
        f"within a tolerance of {number_text(TOLERANCE)} of each signal's largest value, by at most 10⁻¹⁵ of it"
        in found.text
    )
    assert "recorded before results were the same on every machine" in found.text
    assert "an unknown processor" in found.text
    # Sums of numbers of these sizes are not more exact: 35 J of kinetic energy, loads of a few ‰.
    for signal, value, agrees in (("axial_work", 3e-12, True), ("axial_work", 1e-9, False), ("saturated", 1e-13, True)):
        samples = recording.samples.having(**{signal: np.full(len(recording.samples), value)})
        assert replay(having(older(recording), samples)).agrees is agrees, signal


def test_an_older_recording_does_not_agree_with_a_slightly_different_gain(tmp_path: Path) -> None:
    for preset in ("paper", "weak-feedback"):
        scenario = load_preset(preset)
        gain = scenario.controller.feedback_gain
        made = read_recording(write_run(simulate(scenario, duration=0.5), tmp_path, preset))
        other = replace(older(made), scenario=scenario.replace({"controller.feedback_gain": gain * (1 + 1e-6)}))
        found = replay(other)
        assert not found.agrees
        assert found.difference is not None
        assert f"beyond a tolerance of {number_text(TOLERANCE)}" in found.text


def test_a_nan_in_an_older_recording_is_not_taken_for_rounding(recording: Recording) -> None:
    pose = recording.samples.pose.copy()
    pose[200, 1] = np.nan
    found = replay(having(older(recording), recording.samples.having(pose=pose)))
    assert found.difference is not None
    assert (found.difference.time, found.difference.signal) == (0.2, "pose")
    one = recording.samples.slice(200, 201)
    tolerant = _Comparison(frozenset(TABLE), tolerant=True)
    difference = tolerant.first_difference(one, one.having(pose=pose[200:201]))
    assert difference is not None
    assert difference.signal == "pose"
    assert np.isnan(difference.replayed)


def test_a_missing_command_is_found(recording: Recording) -> None:
    events = tuple(event for event in recording.events if not isinstance(event.command, Tap))
    found = replay(replace(recording, events=events))
    (tap,) = (event for event in recording.events if isinstance(event.command, Tap))
    assert found.difference is not None
    assert found.difference.time == pytest.approx(tap.time + 0.001, abs=1e-9)


def test_a_recording_without_samples_does_not_count_as_replayed(recording: Recording) -> None:
    """Replay once said of a recording that broke off before its first sample that all 0 samples came out again."""
    found = replay(having(recording, recording.samples.slice(0, 0)))
    assert found.text == "The recording has no samples: there was nothing to compare."
    assert not found.agrees
    assert not found.identical


def test_a_gap_in_the_samples_is_left_out(recording: Recording) -> None:
    keep = np.r_[0:100, 250 : len(recording.samples)]
    samples = replace(recording.samples, **{n: getattr(recording.samples, n)[keep] for n in vars(recording.samples)})
    found = replay(having(recording, samples))
    assert found.identical
    assert found.compared == len(keep)


@pytest.mark.parametrize(
    ("late", "says"),
    [
        (0.0, "differs first at t = 0 s in the number of values of beam_coordinates: recorded 1, now 4."),
        (0.0005, "The replay stopped at t = 0.0005 s, before the recording's end."),
    ],
)
def test_a_signal_of_another_size_is_a_difference(recording: Recording, late: float, says: str) -> None:
    """The time of the difference was that of the first common sample, also where there is none (IndexError)."""
    samples = recording.samples
    fewer = samples.having(time=samples.time + late, beam_coordinates=samples.beam_coordinates[:, :1])
    found = replay(having(recording, fewer))
    assert not found.agrees
    assert says in found.text


@pytest.mark.parametrize("time", [0.0, 0.1, 0.25, 0.4])
def test_continuing_from_any_time_gives_the_same_samples(recording: Recording, time: float) -> None:
    scenario, state = state_at(recording, time)
    world = World(scenario)
    world.restore(state)
    row = int(np.searchsorted(recording.samples.time, time - 1e-9))
    assert world.observe().pose.tobytes() == recording.samples.pose[row].tobytes()
    later = [event.time for event in recording.events if event.command is not None and event.time > time]
    until = min([*later, float(recording.samples.time[-1])])
    ticks = round(until / 0.001) - world.tick
    assert_same_bits(world.advance(ticks), recording.samples.slice(row + 1, row + 1 + ticks))


def test_continuing_at_the_instant_of_a_command_carries_it_out(recording: Recording) -> None:
    event = next(event for event in recording.events if isinstance(event.command, ChangeScenario))
    scenario, state = state_at(recording, event.time)
    assert scenario.payload.bending_stiffness == 61.0
    world, row = World(scenario), round(event.time / 0.001)
    world.restore(state)
    assert_same_bits(world.advance(9), recording.samples.slice(row + 1, row + 10))


@pytest.mark.parametrize("preset", ["paper", "fast-adaptation"])
def test_a_run_continued_live_is_recorded_and_replays_bit_for_bit(preset: str, tmp_path: Path) -> None:
    earlier = live_recording(preset, tmp_path / "earlier")
    scenario, origin = resume(earlier, 0.2)
    later = live_recording(preset, tmp_path / "later", scenario=scenario, origin=origin)
    assert (origin.run, origin.time) == (earlier.path.stem, 0.2)
    assert later.samples.time[0] == 0.2
    assert later.samples.pose[0].tobytes() == earlier.samples.pose[200].tobytes()
    assert replay(later).identical
    assert note_metrics(later.path)["changes"][0] == f"Go on from {earlier.path.stem} at t = 0.200 s"
    batches = [chunk.to_record_batch() for chunk in RrdReader(later.path).stream() if not chunk.is_static]
    times = [
        batch.column("sim_time").cast("int64").to_pylist() for batch in batches if "sim_time" in batch.schema.names
    ]
    assert min(map(min, times)) == 200_000_000, "a viewer's time begins with the run"
    # Continue once more, from the end of the continued run.
    scenario, origin = resume(later)
    assert origin.time == later.samples.time[-1]
    assert World(scenario).observe().pose.tobytes() != later.samples.pose[-1].tobytes()
    world = World(scenario)
    world.restore(origin.state)
    assert world.observe().pose.tobytes() == later.samples.pose[-1].tobytes()


def test_a_run_is_continued_only_at_an_instant_of_the_lab(tmp_path: Path) -> None:
    scenario = load_preset("paper")
    run = simulate(scenario, duration=0.05, sample_period=0.0004)
    recording = read_recording(write_run(run, tmp_path, "paper"))
    _, origin = resume(recording, 0.02)
    assert origin.state.tick == 20
    with pytest.raises(StudyError, match=r"t = 0.0204 s is not an instant of a lab, .* every 1 ms"):
        resume(recording, 0.0204)


def test_a_time_that_was_not_recorded_is_refused(recording: Recording) -> None:
    for time in ("-1", "99"):
        with pytest.raises(StudyError, match=f"t = {time.replace('-', '−')} s was not recorded: choose 0 to "):
            state_at(recording, float(time))


def test_messages_about_a_run_of_one_sample_use_the_singular(tmp_path: Path) -> None:
    run = simulate(load_preset("paper"), duration=0.0)
    recording = read_recording(write_run(run, tmp_path, "paper"))
    assert replay(recording).text == "The only sample came out again, bit for bit."
    with pytest.raises(StudyError, match=r"t = 1 s was not recorded: choose 0 s\.$"):
        state_at(recording, 1.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"controller.kind": "disturbance-observer"},
        {"joints.friction.coulomb": [2.0, 2.0, 2.0]},
        {"controller.control_period": 0.002},
    ],
)
def test_a_run_whose_law_changes_in_motion_replays_and_continues(changes: dict[str, Any], tmp_path: Path) -> None:
    """In a lab such a change begins a new run, in `simulate` it does not; replay once called its recording broken."""
    run = flexlab.simulate("paper", duration=0.1, commands=[(0.05, ChangeScenario(changes))])
    recording = read_recording(run.save(tmp_path))
    assert replay(recording).text == "All 101 samples came out again, bit for bit."
    scenario, state = state_at(recording, 0.08)
    world = World(scenario)
    world.restore(state)
    world.advance(20)
    assert world.observe().pose.tobytes() == run.pose[-1:].tobytes()
