"""Where machine code and the viewer are kept, for users with a home and without."""

import stat
from pathlib import Path

import pytest

from flexlab.assets import user_cache


def test_the_user_says_where(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache() == tmp_path
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert user_cache() == Path.home() / ".cache"


def test_who_has_no_home_gets_a_folder_that_nobody_else_can_write(monkeypatch: pytest.MonkeyPatch):
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setattr(Path, "home", nowhere)
    folder = user_cache()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert user_cache() == folder, "for this process, and those that it starts"
