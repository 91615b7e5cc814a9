"""`flexlab sweep`: a table, figures, a question before very many cells, a sentence for bad input."""

from pathlib import Path

import pyarrow.parquet as parquet
import pytest
from lab_process import Command, refused

import flexlab


def test_a_sweep_writes_the_same_table_as_python(flexlab_command: Command, tmp_path: Path):
    words = ("--vary", "payload.bending_stiffness=10:100:log:3", "--duration", "0.2", "--set", "gravity=1", "--to", "a")
    done = flexlab_command(
        "sweep", "paper", *words, "--vary", "trajectory.center=[0,0.75,0],[0,1.6,0]", "--show", "force"
    )
    assert done.returncode == 0, done.stderr
    assert [Path(line).name for line in done.stdout.split()] == ["cells.parquet", "force.svg", "pareto.svg"]
    assert "3 of 6 cells failed; the table says why." in done.stderr
    sweep = flexlab.sweep(
        flexlab.load_preset("paper").replace({"gravity": 1}),
        {"payload.bending_stiffness": "10:100:log:3", "trajectory.center": "[0,0.75,0],[0,1.6,0]"},
        0.2,
        folder=tmp_path / "b",
    )
    assert (tmp_path / "a" / "cells.parquet").read_bytes() == (tmp_path / "b" / "cells.parquet").read_bytes()
    assert parquet.read_table(tmp_path / "a" / "cells.parquet").num_rows == len(sweep) == 6


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "Nothing is varied"),
        (("--vary", "gravty=0:1"), "did you mean gravity?"),
        (("--vary", "gravity=1:0"), "is empty or reversed"),
        (("--vary", "gravity=0:1:10000", "--vary", "payload.bending_stiffness=1:2:1000"), "so nothing was done"),
        (("--vary", "gravity=0:1:100000", "--vary", "payload.bending_stiffness=1:2:100000"), "are too many"),
        (("--vary", "gravity=0:1:2", "--show", "forc"), "'forc' is not a metric"),
        (("--vary", "gravity=0:1:2", "--pareto", "force"), "does not name two metrics"),
        (("--vary", "gravity=0:1:2", "--design", "sobol"), "samples says how many"),
        (("--vary", "gravity=0:1:2", "--to", "file/a"), "file/a cannot be written"),
        (("--vary", "gravity=0:1:2", "--set", "gravty=1"), "did you mean gravity?"),
    ],
)
def test_bad_input_is_one_sentence(flexlab_command: Command, tmp_path: Path, words: tuple[str, ...], says: str):
    (tmp_path / "file").write_text("no folder")
    assert says in refused(flexlab_command("sweep", "paper", *words), lines=2)
    assert not (tmp_path / "sweeps").exists()
