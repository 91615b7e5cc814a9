"""One result has one hash: in Python, in the lab and in its recording."""

from pathlib import Path

import numpy as np

import flexlab
from flexlab.analysis.result import ResultHash, result_hash, scenario_hash
from flexlab.presets import load_preset
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.run_files import list_runs
from flexlab.sim.runner import Runner


def test_the_hash_depends_on_every_bit_of_the_samples_but_not_on_their_blocks():
    run = flexlab.simulate("paper", 0.05)
    gathered = ResultHash()
    for start, stop in ((0, 7), (7, 7), (7, 50), (50, 51)):
        gathered.update(run.slice(start, stop))
    assert gathered.text() == run.result_hash
    assert len(run.result_hash) == 16
    torque = np.array(run.joint_torque)
    torque[20, 1, 2] = np.nextafter(torque[20, 1, 2], np.inf)
    assert result_hash(run.having(joint_torque=torque)) != run.result_hash
    assert flexlab.simulate("soft-beam", 0.05).result_hash != run.result_hash


def test_the_hash_of_a_scenario_depends_on_all_but_its_texts():
    paper = load_preset("paper")
    assert scenario_hash(paper.replace({"title": "Mine", "watch": "Watch."})) == scenario_hash(paper)
    assert scenario_hash(paper.replace({"controller.sensor_noise.seed": 1})) != scenario_hash(paper)


def test_a_run_of_the_lab_and_its_recording_have_the_hash_of_a_run_without_a_screen(tmp_path: Path):
    recorder = Recorder(tmp_path)
    now = [0.0]
    runner = Runner(load_preset("paper"), "paper", [recorder], clock=lambda: now[0])
    for _ in range(20):
        now[0] += 0.02
        runner.frame()
    runner.stop()
    recorder.close(finishing_time=60)
    (path,) = list_runs(tmp_path)
    samples = read_recording(path).samples
    assert len(samples) > 100
    alone = flexlab.simulate("paper", float(samples.time[-1]))
    assert result_hash(samples) == flexlab.read(path).result_hash == alone.result_hash
    assert flexlab.read(flexlab.simulate("paper", 0.1).save(tmp_path)).result_hash == result_hash(alone.slice(0, 101))
