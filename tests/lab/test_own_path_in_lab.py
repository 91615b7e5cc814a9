"""A path in a Python file in a running lab: chosen, changed by an option, saved again, broken, repaired."""

from pathlib import Path

import pytest
from lab_page import wait_until
from own_path_text import ROUND

from flexlab.lab.panel.sections import changes_for
from flexlab.lab.session import Session
from flexlab.own.files import PATH_FILES
from flexlab.presets import load_preset


def test_an_own_path_follows_its_options_and_its_file_and_a_broken_file_changes_nothing(tmp_path: Path):
    file = tmp_path / "mine.py"
    file.write_text(ROUND)
    path = PATH_FILES.add(file)
    with Session(load_preset("paper"), shadows=False) as lab:
        state, runner = lab.lab_state, lab.runner
        wait_until(lambda: runner.snapshot.latest.time[0] > 0.05, "the lab runs")
        state.change(changes_for("trajectory.kind", path.kind))
        wait_until(lambda: runner.snapshot.scenario.trajectory.kind == "round-trip", "the path is taken up")
        for radius in (0.11, 0.12, 0.13):
            state.change({"trajectory.radius": radius})
        wait_until(lambda: runner.snapshot.scenario.trajectory.reach[0] == pytest.approx(0.13, 1e-3), "the last option")
        state.change({"trajectory.radius": 2.0})
        wait_until(lambda: "cannot reach the desired pose" in state.notice.text, "the sentence about its reach")
        assert state.intended.trajectory.radius == 0.13

        file.write_text(ROUND.replace("0.5 * self.radius", "0.25 * self.radius"))
        wait_until(lambda: runner.snapshot.scenario.trajectory.reach[1] == pytest.approx(0.0325, 1e-3), "the new text")
        good = runner.snapshot.scenario.trajectory
        for wrong, said in (
            ("while True: pass", "mine.py, line 19: position took longer than 1 s"),
            ("1 / 0", "mine.py, line 19: ZeroDivisionError"),
        ):
            file.write_text(ROUND.replace("turn = 2 *", f"{wrong}\n        turn = 2 *"))
            wait_until(lambda said=said: said in state.notice.text, said)
        file.write_text("class RoundTrip(OwnPath:\n")
        wait_until(lambda: "line 1: this is not valid Python" in state.notice.text, "the sentence about the text")
        assert runner.snapshot.scenario.trajectory == good
        file.write_text(ROUND.replace("high=2, symbol", "high=1, symbol"))  # changes the declaration
        wait_until(lambda: runner.snapshot.scenario.trajectory.source != good.source, "the mended text")
        assert runner.snapshot.scenario.trajectory.radius == 0.13
        state.undo()
        wait_until(lambda: runner.snapshot.scenario.trajectory.reach[1] == pytest.approx(0.0325, 1e-3), "the way back")
        assert runner.snapshot.run_number == 1
        assert not runner.snapshot.status.failed


def test_a_path_that_is_still_being_computed_does_not_get_into_a_preset_that_is_opened_meanwhile(tmp_path: Path):
    file = tmp_path / "mine.py"
    file.write_text(ROUND.replace("turn = 2 *", "for _ in range(60_000): pass\n        turn = 2 *"))
    path = PATH_FILES.add(file)
    with Session(load_preset("paper"), "paper", shadows=False) as lab:
        state = lab.lab_state
        state.change({**changes_for("trajectory.kind", path.kind), "trajectory.radius": 0.12})
        computing = state._slow
        state.load(load_preset("gravity"), "gravity")  # On a busy machine, the path may be there before.
        state.change({"gravity": 5.0})
        wait_until(lambda: not computing.is_busy, "the path is computed")
        assert state.intended == load_preset("gravity").replace({"gravity": 5.0})
        wait_until(lambda: lab.runner.snapshot.scenario == state.intended, "the engine has taken up the change")
        assert state.notice.text == ""
