"""A server in which every page has something to show, for tests that look at all pages."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from person import TEACHER, TOKEN, open_server

from flexlab.analysis.leaderboard.board import make_tasks, run_board
from flexlab.analysis.leaderboard.case import cases
from flexlab.analysis.leaderboard.entry import chosen_entrants
from flexlab.analysis.leaderboard.store import RowStore
from flexlab.recording.store.notes import write_notes

RUNS = "2026-01-01T00-00-00-alpha", "2026-01-02T00-00-00-beta"
CHANGES = [
    "controller.kind: adaptive-sliding-mode → an-own-law",
    "t = 0.100 s: Text of the control law, 33 lines",
    "t = 0.200 s: Bending stiffness EI = 50 N·m²",
    "t = 0.300 s: Bending stiffness EI = 100 N·m²",
]
"""The changes in the notes of the first run."""
COMPARISON = f"/compare?run={RUNS[0]}&run={RUNS[1]}"
PAGES = "/", "/runs", f"/runs/{RUNS[0]}", COMPARISON, "/studies", "/leaderboard", "/teacher"


@contextmanager
def full_server(folder: Path, recorded: Path) -> Iterator[str]:
    """Open such a server and yield its address: private labs behind tokens, two runs and a leaderboard in a new folder."""
    logs = folder / "logs"
    logs.mkdir()
    for name in RUNS:
        shutil.copy(recorded, logs / f"{name}.rrd")
    write_notes(logs / f"{RUNS[0]}.rrd", changes=CHANGES)
    quick = [replace(cases()[name], duration=0.012) for name in ("B1", "B2")]
    run_board(make_tasks(quick, chosen_entrants(["pd", "lqr"])), RowStore(folder / "leaderboard"))
    with open_server(logs, token=TOKEN, teacher_token=TEACHER, private=True) as server:
        yield f"http://127.0.0.1:{server.port}"
