"""What commands say about compiling, and which machine code they remove; `test_same_bits` covers a first start."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from lab_process import Command

from flexlab import compiled
from flexlab.cli.warmup import remove_unused


def test_a_command_that_finds_everything_compiled_says_nothing(
    flexlab_command: Command, monkeypatch: pytest.MonkeyPatch
):
    words = "run", "paper", "soft-beam", "--duration", "0.01", "--json"
    flexlab_command(*words)  # Compiles them if that was not done for all tests.
    monkeypatch.setattr(compiled, "A_MOMENT", 0.0)
    monkeypatch.setattr(compiled.COMPILATION, "told", False)
    done = flexlab_command(*words)
    assert (done.returncode, done.stderr) == (0, "")


def machine_code(folder: Path, read: float, written: float) -> Path:
    """Make a folder of machine code that was read and written so many days ago."""
    file = folder / "flexlab.sim" / "advance.nbc"
    file.parent.mkdir(parents=True)
    file.touch()
    os.utime(file, tuple(time.time() - 86400.0 * days for days in (read, written)))
    return folder


def test_only_machine_code_that_nobody_uses_is_removed(tmp_path: Path):
    own = machine_code(tmp_path / "kernels-00112233445566aa", 100, 100)
    used = machine_code(tmp_path / "kernels-00112233445566bb", 1, 100)
    new = machine_code(tmp_path / "kernels-00112233445566cc", 100, 1)
    unused = machine_code(tmp_path / "kernels-00112233445566dd", 31, 100)
    unit = machine_code(tmp_path / f"unit-{32 * 'a'}", 1, 100)
    unused_unit = machine_code(tmp_path / f"unit-{32 * 'b'}", 31, 100)
    begun = machine_code(tmp_path / "unit-draft-x1", 31, 31)
    text = machine_code(tmp_path / "own-texts" / f"{32 * 'a'}", 1, 100)
    unused_text = machine_code(tmp_path / "own-texts" / f"{32 * 'b'}", 31, 100)
    others = machine_code(tmp_path / "kernels-of-mine", 100, 100)
    link = tmp_path / "kernels-00112233445566ee"
    link.symlink_to(others)
    remove_unused(own)
    assert set(tmp_path.iterdir()) == {own, used, new, unit, text.parent, others, link}
    assert text.exists()
    assert not any(folder.exists() for folder in (unused, unused_unit, begun, unused_text))


def test_machine_code_that_finds_no_room_is_answered_in_a_sentence(tmp_path: Path):
    # Python would cut off the bytecode that it writes beside the sources, and fail at all later starts.
    room = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "COLUMNS": "200", "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        ["sh", "-c", 'ulimit -f 1; exec "$@"', "sh", sys.executable, "-m", "flexlab", "run", "paper"],
        cwd=tmp_path,
        env=os.environ | room,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "(File too large): make room, or set XDG_CACHE_HOME to another folder." in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("words", [("run", "paper", "--duration", "0.01"), ("--no-browser", "--port", "0")])
def test_ctrl_c_while_compiling_is_answered_in_a_sentence(tmp_path: Path, words: tuple[str, ...]):
    unused = machine_code(tmp_path / "cache" / "flexlab" / "kernels-0123456789abcdef", read=31, written=31)
    process = subprocess.Popen(
        [sys.executable, "-m", "flexlab", *words],
        cwd=tmp_path,
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "NO_COLOR": "1", "COLUMNS": "200"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    with process:
        assert process.stderr.readline().startswith("flexlab is compiling the equations of motion")
        assert not unused.exists()
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
    assert (process.returncode, said) == (130, "Interrupted: the next start compiles what is missing.\n")
