"""Computes the table that the page Leaderboard shows until somebody presses Compute: `python web_assets/make/leaderboard.py`."""

from pathlib import Path
from tempfile import TemporaryDirectory

from flexlab.analysis.leaderboard.board import make_tasks, run_board
from flexlab.analysis.leaderboard.case import chosen_cases
from flexlab.analysis.leaderboard.entry import chosen_entrants
from flexlab.analysis.leaderboard.store import RowStore, ship

if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        ship(run_board(make_tasks(chosen_cases(None, long=False), chosen_entrants(None)), RowStore(Path(folder))).rows)
