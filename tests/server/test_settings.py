"""The settings of a server, and how it deletes old runs over their limits."""

import os
import shutil
import time
from pathlib import Path

import pytest

from flexlab.errors import LabError
from flexlab.recording.store.notes import write_notes
from flexlab.recording.store.run_files import list_runs
from flexlab.server.front_server import delete_over_limits
from flexlab.server.settings import KEPT_FREE, LAB_MEMORY, Capacity, Settings


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("idle_time", 0.5, "idle-time = 0.5 s is outside 1 to 604800 s: choose within it."),
        ("idle_time", 1e9, "idle-time = 1000000000.0 s is outside 1 to 604800 s"),
        ("idle_time", float("nan"), "idle-time = nan s is outside"),
        ("max_sessions", 0, "max-sessions = 0 is outside 1 to 1000: choose within it."),
        ("max_sessions", 10**400, "max-sessions = 1(0{59}) is outside 1 to 1000: choose within it."),
        ("token", "fifteen-letters", "--token has 15 characters, too few to keep anybody out: give at least 16."),
        ("teacher_token", "", "--teacher-token has 0 characters, too few"),
        ("teacher_token", "with spaces in the middle", "--teacher-token has ' ', which"),
        ("token", "with spaces in the middle", "--token has ' ', which an address cannot hold as it stands"),
        ("token", "hash#hash#hash#hash", "--token has '#'"),
        ("token", "ümlautümlautümlaut", "--token has '.xfc'"),
        ("max_size", -2.0, "max-size = -2 GB is not a limit: give a number above 0, or leave it out."),
        ("max_age", 0.0, "max-age = 0 days is not a limit"),
    ],
)
def test_a_setting_out_of_range_is_refused_in_a_sentence(field: str, value: object, says: str) -> None:
    with pytest.raises(LabError, match=says.replace("+", r"\+")):
        Settings(**{field: value})


def test_the_address_for_others_is_one_of_this_machine() -> None:
    assert Settings().public_host() == "127.0.0.1"
    assert Settings(host="0.0.0.0").public_host() not in ("0.0.0.0", "")


def test_by_default_one_private_lab_is_left_to_other_addresses() -> None:
    assert [Settings(max_sessions=labs).labs_per_address for labs in (1, 2, 40)] == [1, 1, 39]


def test_cores_and_free_memory_bound_the_labs_of_a_machine() -> None:
    several = KEPT_FREE + 3.5 * LAB_MEMORY
    assert [Capacity(2, memory).labs for memory in (None, 1e12, several, 0.0)] == [12, 12, 3, 1]


def test_runs_over_the_limits_are_deleted_oldest_first_and_kept_ones_stay(recorded: Path, tmp_path: Path) -> None:
    for day in (1, 2, 3, 4):
        run = tmp_path / f"2026-01-0{day}T00-00-00-paper.rrd"
        shutil.copy2(recorded, run)
        shutil.copy2(recorded.with_suffix(".json"), run.with_suffix(".json"))
        at = time.time() - (10 - day) * 86400
        os.utime(run, (at, at))
    write_notes(tmp_path / "2026-01-01T00-00-00-paper.rrd", keep=True)
    delete_over_limits(Settings(logs=tmp_path))
    assert len(list_runs(tmp_path)) == 4, "without limits nothing goes"
    delete_over_limits(Settings(logs=tmp_path, max_size=2.5e-9 * recorded.stat().st_size))
    assert [run.name[:10] for run in list_runs(tmp_path)] == ["2026-01-04", "2026-01-01"]
    delete_over_limits(Settings(logs=tmp_path, max_age=1.0))
    assert [run.name[:10] for run in list_runs(tmp_path)] == ["2026-01-01"]
    assert len(list(tmp_path.iterdir())) == 2, "notes go with their runs"
