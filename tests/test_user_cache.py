"""Where machine code and the viewer are kept, for users with a home and without."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from flexlab.assets import user_cache


def test_xdg_cache_home_chooses_the_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache() == tmp_path
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert user_cache() == Path.home() / ".cache"


def test_a_user_without_a_home_gets_a_private_folder(monkeypatch: pytest.MonkeyPatch):
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setattr(Path, "home", nowhere)
    folder = user_cache()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert user_cache() == folder, "for this process, and those that it starts"


# Root may write into every folder.
@pytest.mark.parametrize("place", ["a file", *(["a folder that cannot be written"] if os.getuid() else [])])
def test_a_home_that_cannot_be_written_does_not_keep_flexlab_from_running(tmp_path: Path, place: str):
    """Services and containers have such homes; the answer was that numba is broken: "install numba again"."""
    home = tmp_path / "home"
    if place == "a file":
        home.write_text("")
    else:
        home.mkdir(mode=0o555)
    environment = {
        name: value for name, value in os.environ.items() if name not in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR")
    }
    done = subprocess.run(
        [sys.executable, "-c", "import flexlab.sim.simulate"],
        env={**environment, "HOME": str(home)}, cwd="/", capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr == (
        f"{home}/.cache cannot be written: each start compiles the equations of motion anew. "
        "Set XDG_CACHE_HOME to a folder that you may write to.\n"
    )
