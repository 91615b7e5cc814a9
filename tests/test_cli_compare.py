"""`flexlab compare` says what differs and overlays the runs, in a file or in the viewer."""

import json
import shlex
import urllib.request
from pathlib import Path

import pytest
from lab_process import Command, refused
from test_cli_review import showing

from flexlab.analysis.metrics import run_metrics
from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.recording.viewer import review
from flexlab.sim.simulate import simulate


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Two runs; the newer one is shorter and has a softer beam."""
    paper = load_preset("paper")
    write_run(simulate(paper, duration=0.3), tmp_path / "logs", "stiff")
    softer = paper.replace({"payload.bending_stiffness": 60.0})
    write_run(simulate(softer, duration=0.2), tmp_path / "logs", "soft")
    return tmp_path / "logs"


def test_tables_are_printed_and_the_overlay_is_saved_and_opens_again(
    flexlab_command: Command, logs: Path, tmp_path: Path
):
    (stiff,) = logs.glob("*stiff.rrd")
    done = flexlab_command("compare", stiff.stem, "newest", "--save", "both.rrd")
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    assert ["A", stiff.stem, "0.3", "The", "paper's", "experiment"] in rows
    assert "Metrics of the first 0.2 s of each run:" in done.stdout
    assert ["Duration", "(s)", "0.2", "0.2", "0"] in rows
    assert ["Vibration", "below", "1", "%", "after", "(s)", "not", "settled", "not", "settled", "–"] in rows
    assert ["payload.bending_stiffness", "100", "60"] in rows
    assert flexlab_command("compare", "newest", "newest", "--save", "both.rrd").returncode == 0, (
        "a comparison is replaced"
    )
    before = stiff.read_bytes()
    said = refused(flexlab_command("compare", stiff.stem, "newest", "--save", str(stiff)))
    assert "exists already and is no comparison: give another name, as it would be lost." in said
    assert stiff.read_bytes() == before
    with review(tmp_path / "both.rrd") as address, urllib.request.urlopen(address) as page:
        assert page.status == 200


def test_the_command_that_opens_the_overlay_can_be_typed_as_it_is_printed(
    flexlab_command: Command, logs: Path, tmp_path: Path
):
    done = flexlab_command("compare", "newest", "newest", "--save", "Ann's runs.rrd")
    command = shlex.split(done.stdout.split("Look at it with: ")[1])
    assert command == ["flexlab", "review", "Ann's runs.rrd"]


def test_a_missing_folder_for_temporary_files_is_named(
    flexlab_command: Command, logs: Path, monkeypatch: pytest.MonkeyPatch
):
    """Python takes another folder; rerun's server does not."""
    monkeypatch.setenv("TMPDIR", "/no/such/folder")
    done = flexlab_command("compare", "newest", "newest", "--no-browser")
    assert done.returncode == 2
    assert "TMPDIR = /no/such/folder is not a folder that can be written" in done.stderr
    assert "set TMPDIR to another folder, or unset it" in done.stderr


def test_without_a_file_the_viewer_shows_the_overlay(logs: Path, tmp_path: Path):
    lines = showing(tmp_path, "compare", "newest", "newest")
    assert "No setting differs.\n" in lines
    assert "The overlay is open at\n" in lines


def test_a_run_is_compared_with_itself_under_other_settings(flexlab_command: Command, logs: Path):
    done = flexlab_command("compare", "newest", "--set", "payload.bending_stiffness=30", "--json")
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert data["settings"] == {"payload.bending_stiffness": ["60", "30"]}
    changed = load_preset("paper").replace({"payload.bending_stiffness": 30.0})
    peak = run_metrics(simulate(changed, duration=0.2)).peak_vibration
    assert data["metrics"]["Peak vibration [mm]"][1] == 1e3 * peak
    assert data["metrics"]["Vibration below 1 % after [s]"] == [None, None]
    assert len(list(logs.glob("*.rrd"))) == 3


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["newest"], "needs two runs at least"),
        (["newest", "--set", "gravty=1"], "did you mean gravity?"),
        (["newest", "zzz"], "no recording zzz"),
        (["newest"] * 7, "Choose 2 to 6 runs to compare, not 7."),
        (["newest", "newest", "--save", "both.png"], "give a name that ends in .rrd"),
        (["newest", "newest", "--save", "no/such/both.rrd"], "cannot be written to no/such/both.rrd"),
        (["newest", "newest", "--json", "--save", "both.rrd"], "give one of --json and --save"),
        (["newest", "junk.rrd"], "not a rerun recording"),
    ],
)
def test_bad_input_is_one_sentence(flexlab_command: Command, logs: Path, tmp_path: Path, words: list[str], says: str):
    (tmp_path / "junk.rrd").write_bytes(b"junk" * 1000)
    assert says in refused(flexlab_command("compare", "--no-browser", *words))
