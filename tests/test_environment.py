"""If libraries refuse the environment, flexlab says in a sentence what to mend, or works without them."""

import importlib
import os
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from lab_process import PATIENCE, Command, refused

from flexlab.cli import refusal
from flexlab.recording.reader import read_recording
from flexlab.recording.store.run_index import read_row


def done(*words: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run `flexlab` with these words and these further environment variables."""
    return subprocess.run(
        [sys.executable, "-m", "flexlab", *words], cwd=folder, env=os.environ | environment, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, encoding="utf-8", timeout=PATIENCE, check=False,
    )  # fmt: skip


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="Windows has no TZ")
@pytest.mark.parametrize("zone", ["UTC+99", "UTC-24"])
def test_a_run_in_an_impossible_time_zone_is_recorded_in_utc(
    tmp_path: Path, flexlab_command: Command, monkeypatch: pytest.MonkeyPatch, zone: str
):
    before = datetime.now(UTC).replace(microsecond=0)
    with monkeypatch.context() as here:
        here.setenv("TZ", zone)
        time.tzset()
        said = flexlab_command("run", "paper", "--duration", "0.01", "--logs", "here")
    time.tzset()
    assert said.returncode == 0, said.stderr
    (path,) = tmp_path.glob("here/*.rrd")
    started = read_recording(path).started
    assert started.utcoffset() == timedelta(0)
    assert before <= started <= datetime.now(UTC)


@pytest.mark.parametrize(
    ("variable", "value", "says"),
    [
        ("NUMBA_NUM_THREADS", "0", "numba cannot be loaded ("),
        ("MPLBACKEND", "nope", "matplotlib cannot be loaded ("),
        ("SOURCE_DATE_EPOCH", "x", "numpy cannot be loaded ("),
        ("SOURCE_DATE_EPOCH", "999999999999", "matplotlib cannot draw with "),
    ],
)
def test_a_variable_that_a_library_refuses_is_one_sentence(tmp_path: Path, variable: str, value: str, says: str):
    said = refused(
        done("sweep", "paper", "--vary", "gravity=1,2", "--to", "here", folder=tmp_path, **{variable: value})
    )
    assert said.startswith(says)
    assert f"{variable} = {value}" in said


def test_a_folder_of_machine_code_that_cannot_be_written_is_named(monkeypatch: pytest.MonkeyPatch):
    """Where the package cannot be written either, the answer was that numba cannot be loaded: "install numba again"."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/code")
    error = RuntimeError("cannot cache function 'reduced': no locator available for file 'elementary.py'")
    assert refusal(error) == (
        "Machine code cannot be kept in /code: set NUMBA_CACHE_DIR to a folder that you may write to."
    )


def test_a_broken_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "segno.py").write_text("from os import nothing_of_this_name\n")
    said = refused(done("lab", "--port", "0", "--no-browser", folder=tmp_path))
    assert said.startswith("segno cannot be loaded (cannot import name 'nothing_of_this_name'")
    (tmp_path / "broken_library.py").write_text("import no_such_library\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError) as broken:
        importlib.import_module("broken_library")
    said = refusal(broken.value)
    assert said is not None
    assert said.startswith("broken_library cannot be loaded (No module named 'no_such_library')")


def test_a_variable_that_numba_cannot_read_is_one_line_without_traceback(tmp_path: Path):
    said = done("presets", folder=tmp_path, NUMBA_NUM_THREADS="many")
    assert said.returncode == 0
    assert "'NUMBA_NUM_THREADS' is defined but its associated value 'many' could not be parsed" in said.stderr
    assert "Traceback" not in said.stderr
    assert said.stderr.count("\n") == 1


def test_recording_is_refused_while_rerun_is_switched_off(flexlab_command: Command):
    said = refused(flexlab_command("run", "smooth-start", "--duration", "0.01", RERUN="off"))
    assert "RERUN = off" in said
    assert flexlab_command("run", "smooth-start", "--duration", "0.01").returncode == 0
    assert flexlab_command("export", "newest", "--to", "table.csv").returncode == 0
    assert "RERUN = off" in refused(flexlab_command("import", "table.csv", RERUN="off"))


OPEN_A_LAB = """
import sys
import flexlab
try:
    with flexlab.Lab():
        pass
except flexlab.FlexlabError as error:
    sys.exit(str(error))
"""


@pytest.mark.parametrize(
    ("handles", "words", "says"),
    [
        (10, ("-m", "flexlab", "run", "paper", "--duration", "0.01"), "Too many open files: close other programs"),
        (14, ("-m", "flexlab", "--no-browser", "--port", "0"), "and a lab needs 64: allow more (ulimit -n 64)"),
        (14, ("-c", OPEN_A_LAB), "may have 14 files and connections open at once, and a lab needs 64"),
    ],
)
def test_too_few_file_handles_give_one_sentence(tmp_path: Path, handles: int, words: tuple[str, ...], says: str):
    """With so few handles a lab hung at its start."""
    said = subprocess.run(
        ["sh", "-c", f'ulimit -n {handles}; exec "$@"', "sh", sys.executable, *words], cwd=tmp_path, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, encoding="utf-8", timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert says in said.stderr
    assert said.stderr.count("\n") == 1
    assert said.returncode


def test_a_run_that_was_deleted_in_another_terminal_is_one_sentence(tmp_path: Path):
    with pytest.raises(FileNotFoundError) as gone:
        read_row(tmp_path / "a-run.rrd")
    assert refusal(gone.value) == "a-run is not there any more: somebody has deleted or moved it."


@pytest.mark.parametrize(
    "error", ["MemoryError", "ImportError('failed to map segment')", "SystemError('no exception set')"]
)
def test_a_sentence_is_printed_although_the_library_that_colours_it_cannot_be_loaded(tmp_path: Path, error: str):
    """Without memory (`ulimit -v 300000`), the sentence that none is left ended in a traceback."""
    (tmp_path / "rich.py").write_text(f"raise {error}\n")
    assert refused(done("prests", folder=tmp_path)).startswith("There is no command 'prests'")


def test_a_lack_of_memory_is_one_sentence():
    for error in (MemoryError(), ImportError("libarrow.so.2600: failed to map segment from shared object")):
        assert refusal(error) == "No memory is left: close other programs, or allow more (ulimit -v)."
