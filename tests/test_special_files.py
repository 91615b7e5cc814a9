"""Pipes, folders and devices in place of a file are refused in one sentence, without waiting."""

import contextlib
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from lab_process import Command, refused

READS: dict[str, tuple[str, ...]] = {
    "a scenario": ("run", "./{}.json"),
    "a path": ("run", "paper", "--path", "{}.csv"),
    "a path in Python": ("run", "paper", "--path", "{}.py"),
    "a law": ("run", "paper", "--law", "{}.py"),
    "a unit": ("run", "paper", "--law", "{}.fmu"),
    "a measurement": ("fit", "{}.csv"),
    "a table": ("import", "{}.csv"),
    "a packed table": ("import", "{}.parquet"),
    "an archive of arrays": ("import", "{}.npz"),
    "a recording": ("import", "{}.rrd"),
    "an archive of a run": ("replay", "{}.zip"),
    "runs to compare": ("compare", "{}.rrd", "{}.rrd"),
}


@pytest.fixture
def pipe(tmp_path: Path) -> Iterator[Callable[[str], None]]:
    """A function that makes pipes; a reader of one gets nothing and does not wait."""
    made: list[Path] = []

    def give_nothing(path: Path) -> None:
        with contextlib.suppress(OSError):
            path.open("wb").close()

    def make(name: str) -> None:
        path = tmp_path / name
        os.mkfifo(path)
        made.append(path)
        threading.Thread(target=give_nothing, args=(path,), daemon=True).start()

    yield make
    for path in made:
        os.close(os.open(path, os.O_RDONLY | os.O_NONBLOCK))


@pytest.mark.parametrize("what", READS)
def test_a_pipe_or_a_folder_is_one_sentence(
    what: str, flexlab_command: Command, pipe: Callable[[str], None], tmp_path: Path
):
    words = READS[what]
    ending = next(word for word in words if "{}" in word).rpartition(".")[2]
    pipe(f"pipe.{ending}")
    (tmp_path / f"folder.{ending}").mkdir()
    for name in ("pipe", "folder"):
        said = refused(flexlab_command(*(word.format(name) for word in words)))
        assert f"{name}.{ending}" in said
        assert "not an ordinary file" in said or "it is a pipe" in said or "it is a folder" in said


def test_an_export_does_not_replace_a_pipe(flexlab_command: Command, pipe: Callable[[str], None], tmp_path: Path):
    """Nor of a device: an export by root to /dev/null would replace it."""
    pipe("unit.fmu")
    said = refused(flexlab_command("export", "paper", "--to", "unit.fmu"))
    assert "unit.fmu cannot be written (it is not an ordinary file)" in said
    assert (tmp_path / "unit.fmu").is_fifo()
