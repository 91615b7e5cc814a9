"""`flexlab export`, `import` and `replay`: a run that is exported and imported again is the same, bit for bit."""

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lab_process import Command, refused

from flexlab.presets import load_preset
from flexlab.recording.headless import HeadlessRecording, write_run
from flexlab.recording.reader import read_recording
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store.run_files import newest_run
from flexlab.sim.commands import Tap
from flexlab.sim.samples import Samples, Status
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import Event
from flexlab.sim.world import World


@pytest.fixture
def tapped(tmp_path: Path) -> Path:
    """A run with a tap in the middle."""
    world, tap = World(load_preset("paper")), Tap(0.1, (0.0, 0.05))
    with HeadlessRecording(tmp_path / "logs", RunInfo("paper", world.scenario)) as recording:
        recording.write(world.run(100))
        world.apply(tap)
        recording.note(Event(world.time, "Tap", tap))
        recording.write(world.advance(200))
        recording.end(Status("finished", "Finished.", world.time))
    return recording.path


def bits(samples: Samples) -> list[bytes]:
    return [getattr(samples, name).tobytes() for name in Samples.__dataclass_fields__]


def test_a_file_may_have_as_long_a_name_as_the_system_takes(flexlab_command: Command, tapped: Path, tmp_path: Path):
    """Its temporary draft had a longer name."""
    name = f"{'ü' * 125}y.csv"
    assert len(name.encode()) == 255
    out = flexlab_command("export", tapped.stem, "--to", name)
    assert out.returncode == 0, out.stderr
    assert (tmp_path / name).is_file()


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_an_exported_run_is_imported_bit_for_bit(flexlab_command: Command, tapped: Path, tmp_path: Path, suffix: str):
    out = flexlab_command("export", tapped.stem, "--to", f"out{suffix}")
    assert out.returncode == 0, out.stderr
    assert out.stdout.startswith(f"out{suffix}  ")
    back = flexlab_command("import", f"out{suffix}")
    assert back.returncode == 0, back.stderr
    found = newest_run(tmp_path / "logs")
    assert found != tapped
    assert found.name in back.stdout
    assert bits(read_recording(found).samples) == bits(read_recording(tapped).samples)
    again = flexlab_command("replay", "newest")
    assert (again.returncode, again.stdout) == (
        0,
        f"{found.stem}: All 301 samples came out again, bit for bit.\n",
    )


def test_part_of_a_run_and_its_figures_are_exported(flexlab_command: Command, tapped: Path, tmp_path: Path):
    done = flexlab_command("export", "--to", "part.csv", "--start", "0.1", "--end", "0.2", "--figures", "SVG")
    assert done.returncode == 0, done.stderr
    assert len((tmp_path / "part.csv").read_text().splitlines()) == 2 + 101
    figures = {f"{tapped.stem}-figure-{number}.svg" for number in (2, 3, 4, 5)}
    assert figures == {path.name for path in tmp_path.glob("*.svg")} == set(done.stdout.split()[-4:])


def test_a_preset_is_exported_as_a_unit(flexlab_command: Command, tmp_path: Path):
    done = flexlab_command("export", "paper", "--to", "paper.fmu", "--fmi", "2", "--part", "loop")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("paper.fmu  ")
    with zipfile.ZipFile(tmp_path / "paper.fmu") as archive:
        assert b'fmiVersion="2.0" modelName="paper (loop)"' in archive.read("modelDescription.xml")


def test_a_preset_is_exported_as_urdf_and_as_mujoco_xml(flexlab_command: Command, tmp_path: Path):
    for file, head in (("paper.urdf", '<robot name="paper">'), ("paper.xml", '<mujoco model="paper">')):
        done = flexlab_command("export", "paper", "--to", file)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(f"{file}  ")
        assert head in (tmp_path / file).read_text(encoding="utf-8")


def test_a_replay_that_differs_says_where_and_fails(flexlab_command: Command, tmp_path: Path):
    run = simulate(load_preset("paper"), duration=0.3)
    torque = run.joint_torque.copy()
    torque.view(np.int64)[123, 1, 2] ^= 1
    path = write_run(replace(run, joint_torque=torque), tmp_path / "logs", "paper")
    done = flexlab_command("replay", path.stem)
    assert done.returncode == 1, done.stderr
    assert done.stdout.startswith(f"{path.stem}: The replay differs first at t = 0.123 s in joint_torque: recorded ")
    assert "It was recorded by flexlab " in done.stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["export"], "Say what to write"),
        (["export", "--to", "x.xls"], "x.xls has no known format: let its name end in .csv"),
        (["export", "--to", "no/such/x.csv"], "cannot be written"),
        (["export", "--to", "x.npz", "--start", "7"], "there is no sample: choose times within 0 to 0.3 s"),
        (["export", "--figures", "pdf"], "choose png or svg"),
        (["export", "--to", "x.csv", "--figures", "pdf"], "choose png or svg"),
        (["export", "zzz", "--to", "x.csv"], "no recording zzz"),
        (["export", "--to", "x.fmu"], "x.fmu is made of a scenario alone: flexlab export PRESET --to x.fmu."),
        (["export", "--to", "x.xml"], "x.xml is made of a scenario alone"),
        (["export", "paper", "--to", "x.urdf", "--fmi", "2"], "--part and --fmi are for units"),
        (["export", "paper", "--to", "no/such/x.urdf"], "cannot be written"),
        (["export", "papr", "--to", "x.fmu"], "did you mean paper"),
        (["export", "--to", "x.csv", "--part", "loop"], "--part and --fmi are for units: write --to FILE.fmu."),
        (["import", "none.csv"], "There is no file none.csv"),
        (["import", "junk.csv"], "junk.csv is not a run exported by flexlab"),
        (
            ["import", "run.zip"],
            "run.zip has no known format: choose a file that ends in .rrd, .csv, .parquet, .npz. From an archive",
        ),
        (["import", "junk.txt"], "junk.txt has no known format"),
        (["import", "."], ". has no known format"),
        (["replay", "zzz"], "no recording zzz"),
        (["replay", "junk.rrd"], "not a rerun recording"),
    ],
)
def test_bad_input_is_one_sentence(flexlab_command: Command, tapped: Path, tmp_path: Path, words: list[str], says: str):
    for name in ("junk.csv", "junk.txt", "junk.rrd"):
        (tmp_path / name).write_bytes(b"junk" * 1000)
    assert says in refused(flexlab_command(*words))
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(("x.", "."))]
