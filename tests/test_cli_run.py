"""`flexlab run`: simulates, records, sums up; refuses what it cannot do."""

import json
from pathlib import Path

import pytest
from lab_process import Command, refused
from own_law_text import PD

import flexlab
from flexlab.cli.headless_run import pace_warning
from flexlab.presets import save_scenario
from flexlab.recording.reader import read_recording
from flexlab.scenario import Scenario
from flexlab.sim.world import World


def test_a_run_is_recorded_and_summed_up(flexlab_process: Command, tmp_path: Path):
    (tmp_path / "mine.json").write_text("{}")
    done = flexlab_process("run", "mine.json", "--duration", "1.5", "--logs", "runs")
    assert done.returncode == 0, done.stderr
    (file,) = (tmp_path / "runs").glob("*-mine.rrd")
    assert read_recording(file).scenario.title == "", "the first run of a process needs no title"
    assert str(Path("runs") / file.name) in done.stdout
    assert "1501 samples" in done.stdout
    assert "Vibration below 1 % after 0.439 s." in done.stdout
    rows = {line.split(", ")[0].strip(): line.split()[-2:] for line in done.stdout.splitlines() if ", " in line}
    assert [float(value) for value in rows["tracking error x"]] == pytest.approx([16.74, 0.16], rel=0.01)
    assert float(rows["mid-span deflection"][0]) == pytest.approx(1.770, rel=0.01)


def test_a_scenario_file_runs_with_another_sample_period(flexlab_command: Command, tmp_path: Path):
    save_scenario(Scenario(title="Mine [bold]", gravity=1.0), tmp_path / "mine.json")
    done = flexlab_command("run", "mine.json", "--duration", "0.5", "--sample-period", "0.01")
    assert done.returncode == 0, done.stderr
    assert "Mine [bold]" in done.stdout
    assert "51 samples" in done.stdout
    assert list((tmp_path / "logs").glob("*-mine.rrd"))


def test_a_run_that_its_samples_make_slow_says_so():
    paper = Scenario()
    said = (
        "as there is a sample every 1 µs. To keep up, choose a longer sample period, such as 0.001 s (--sample-period)."
    )
    assert said in pace_warning(World(paper, 1e-6))
    own_step = paper.replace({"simulation.step": 1e-6})
    assert "simulation.step" in pace_warning(World(own_step, 1e-6)), "longer samples would not help"
    assert pace_warning(World(paper)) == ""


def test_an_unreachable_path_ends_in_a_sentence(flexlab_command: Command, tmp_path: Path):
    far = Scenario().replace({"trajectory.center": [0.0, 1.6, 0.0]})
    save_scenario(far, tmp_path / "far.json")
    done = flexlab_command("run", "far.json", "--duration", "0.1")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "arm" in done.stderr
    assert "reach" in done.stderr


def test_several_scenarios_with_settings_give_the_digits_and_hash_of_python(flexlab_command: Command, tmp_path: Path):
    words = ("--set", "controller.position_gain=5000", "--law", "pd", "--seed", "3", "--duration", "0.2", "--json")
    done = flexlab_command("run", "paper", "soft-beam", *words)
    assert done.returncode == 0, done.stderr
    first, second = json.loads(done.stdout)
    assert (first["name"], second["name"]) == ("paper", "soft-beam")
    scenario = flexlab.load_preset("soft-beam").replace(
        {"controller.kind": "pd", "controller.position_gain": 5000, "controller.sensor_noise.seed": 3}
    )
    run = flexlab.simulate(scenario, 0.2)
    assert second["result_hash"] == run.result_hash != first["result_hash"]
    assert second["metrics"]["peak_error"] == list(run.metrics.peak_error)
    assert second["metrics"]["settling_time"] is None
    assert flexlab.parse_scenario(second["scenario"]) == scenario
    assert flexlab.read(tmp_path / second["file"]).result_hash == run.result_hash


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_forces_beyond_all_bounds_are_one_sentence_and_no_warning(flexlab_command: Command, tmp_path: Path):
    text = PD.replace("common[0]\n", "common[0] * 1e300\n").replace("shared(common)", "shared(common * 1e300)")
    (tmp_path / "huge.py").write_text(text)
    done = flexlab_command("run", "paper", "--law", "huge.py", "--duration", "0.1")
    assert done.returncode == 1
    assert "ran away" in done.stderr
    assert "huge.py:" not in done.stderr


def test_a_run_that_fails_sets_the_exit_code_and_says_why_in_json(flexlab_command: Command, tmp_path: Path):
    save_scenario(Scenario().replace({"trajectory.center": [0.0, 1.6, 0.0]}), tmp_path / "far.json")
    done = flexlab_command("run", "paper", "far.json", "soft-beam", "--json", "--duration", "0.1")
    assert done.returncode == 1
    runs = json.loads(done.stdout)
    assert [(run["name"], run["status"]) for run in runs] == [
        ("paper", "finished"), ("far", "unreachable"), ("soft-beam", "finished"),
    ]  # fmt: skip
    assert runs[1]["text"] in done.stderr.strip()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["run", "papr"], "did you mean paper?"),
        (["run"], "Say what to simulate"),
        (["run", "paper", "papr"], "did you mean paper?"),
        (["run", "paper", "--set", "feedback_gain=1"], "did you mean controller.feedback_gain"),
        (["run", "paper", "--set", "gravity"], "write PATH=VALUE"),
        (["run", "paper", "--law", "pid"], "is not one of 'adaptive-sliding-mode'"),
        (["run", "paper", "--seed", "-1"], "controller.sensor_noise.seed = -1"),
        (["run", "nothing.json"], "no scenario file nothing.json"),
        (["run", "broken.json"], "line 1"),
        (["run", "wrong.json"], "payload.bending_stiffness = -1"),
        (["run", "nan.json"], "finite"),
        (["run", "paper", "--duration", "0"], "--duration 0"),
        (["run", "paper", "--duration", "nan"], "--duration nan"),
        (["run", "paper", "--duration", "-3"], "--duration -3"),
        (["run", "paper", "--sample-period", "1e-9"], "--sample-period 1e-09"),
        (["run", "paper", "--logs", "file/logs"], "file/logs"),
        (["run", "paper", "--logs", "/proc/logs"], "/proc/logs"),
    ],
)
def test_bad_input_is_one_sentence(flexlab_command: Command, tmp_path: Path, words: list[str], says: str):
    (tmp_path / "broken.json").write_text("{")
    (tmp_path / "wrong.json").write_text(json.dumps({"payload": {"bending_stiffness": -1}}))
    (tmp_path / "nan.json").write_text('{"payload": {"bending_stiffness": NaN}}')
    (tmp_path / "file").write_text("not a folder")
    assert says in refused(flexlab_command(*words))
