"""A law that fails at its first instant: every command and study shows the law's own error."""

import re
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from own_law_text import PD

import flexlab
from flexlab.errors import FlexlabError
from flexlab.own import endless_calls, hosts
from flexlab.own.files import law_kind
from flexlab.sim.world import World

FAILS = PD.replace("        e, e_dot", '        raise RuntimeError("no such gain")\n        e, e_dot')
LINE = 1 + next(number for number, line in enumerate(FAILS.split("\n")) if "raise" in line)
SAID = f"fails.py, line {LINE}: RuntimeError: no such gain."


@pytest.fixture
def law(tmp_path: Path) -> Path:
    (tmp_path / "fails.py").write_text(FAILS, encoding="utf-8")
    return tmp_path / "fails.py"


def test_the_run_command_shows_the_laws_own_error(law: Path, flexlab_command: Callable[..., CompletedProcess[str]]):
    done = flexlab_command("run", "paper", "--law", str(law), "--duration", "0.1")
    assert done.returncode == 1
    assert SAID in done.stderr
    assert "Traceback" not in done.stderr


def test_a_law_in_an_endless_loop_ends_the_command_with_a_sentence(
    tmp_path: Path, flexlab_command: Callable[..., CompletedProcess[str]], capfd: pytest.CaptureFixture[str]
):
    endless = PD.replace(
        "        e, e_dot", '        print("here")\n        while at.time > 0.002: pass\n        e, e_dot'
    )
    (tmp_path / "endless.py").write_text(endless, encoding="utf-8")
    done = flexlab_command("run", "paper", "--law", str(tmp_path / "endless.py"), "--duration", "0.1")
    assert done.returncode == 1
    line = 1 + next(number for number, line in enumerate(endless.split("\n")) if "while" in line)
    assert f"endless.py, line {line}: act did not answer within" in done.stderr
    assert "here\n" in capfd.readouterr().err


def test_a_checked_run_that_stops_is_an_error(law: Path):
    run = flexlab.simulate("paper", 0.01, law=law)
    assert repr(run).startswith("<Run of paper: did not finish")
    assert SAID in repr(run)
    with pytest.raises(FlexlabError, match=r"The run of paper did not finish: .*no such gain"):
        flexlab.simulate("paper", 0.01, law=law, check=True)
    assert flexlab.simulate("paper", 0.01, check=True).status == "finished"


def test_modes_and_linearize_show_the_laws_own_error(law: Path):
    run = flexlab.simulate("paper", 0.1, law=law)
    assert SAID in run.status.text
    assert SAID in flexlab.modes(run.scenario).note
    with pytest.raises(FlexlabError, match=re.escape(SAID)):
        flexlab.linearize(run.scenario)
    assert run.explanations == (), "a run without samples has nothing to explain"


def test_metrics_of_a_run_that_stopped_are_not_numbers(law: Path):
    run = flexlab.simulate("paper", 0.1, law=law)
    assert run.metrics.duration == 0.0
    rows = [row for row in run.metrics.rows if row.column.field != "window"]
    assert all(row.value != row.value for row in rows)
    assert {row.text for row in rows} == {"did not finish"}
    assert flexlab.simulate("paper", 0.1).metrics.peak_torque > 0


FAILS_LATER = PD.replace(
    "        e, e_dot", "        if at.gravity > 5 and at.time > 0.01:\n            FAIL\n        e, e_dot"
)


@pytest.mark.parametrize("apart", [False, True], ids=["here", "apart"])
def test_a_law_that_failed_runs_again_after_a_reset(tmp_path: Path, apart: bool):
    (tmp_path / "later.py").write_text(FAILS_LATER.replace("FAIL", "1 / 0"), encoding="utf-8")
    hosts.run_apart(apart)
    scenario = flexlab.load_preset("gravity").replace({"controller.kind": law_kind(tmp_path / "later.py")})
    world = World(scenario, 0.001)
    world.advance(30)
    again = World(scenario, 0.001, (world.assembly,))  # As a reset does, which derives nothing anew.
    again.advance(5)
    assert not again.status.failed
    again.advance(25)
    assert again.status.text == world.status.text
    assert "stopped just after t = 0.011 s. later.py, line" in again.status.text


@pytest.mark.parametrize(
    ("fails", "apart"),
    [('raise RuntimeError("too heavy")', False), ('raise RuntimeError("too heavy")', True), ("while True: pass", True)],
    ids=["here", "apart", "endless"],
)
def test_a_law_that_fails_in_some_cells_of_a_sweep_runs_in_all_others(tmp_path: Path, fails: str, apart: bool):
    text = PD.replace(
        "        e, e_dot", f"        if at.gravity > 5 and at.time > 0.01:\n            {fails}\n        e, e_dot"
    )
    (tmp_path / "some.py").write_text(text, encoding="utf-8")
    hosts.run_apart(apart)
    swept = flexlab.sweep(
        "paper", {"gravity": [9.0, 0.0, 9.1, 1.0]}, 0.03, law=tmp_path / "some.py",
        folder=tmp_path / "sweep", workers=2, progress=False,
    )  # fmt: skip
    assert swept.table["status"].to_pylist() == ["law failed", "finished"] * 2
    assert all("stopped just after t = 0.011 s. some.py, line" in said for said in swept.failed.values())


def test_a_study_gives_an_endless_law_its_full_time_only_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name, limit in (("LONGEST_CALL", 0.5), ("NEXT_CALL", 0.1)):
        monkeypatch.setattr(endless_calls, name, limit)
    (tmp_path / "endless.py").write_text(PD.replace("        e, e_dot", "        while True: pass\n        e, e_dot"))
    swept = flexlab.sweep(
        "paper", {"gravity": [9.0, 1.0, 2.0]}, 0.03, law=tmp_path / "endless.py", folder=tmp_path / "sweep",
        workers=1, progress=False,
    )  # fmt: skip
    first, *others = (said.partition("one call took ")[2] for said in swept.failed.values())
    assert first.startswith("more than 0.5 s of processor time.")
    for said in others:
        assert said.startswith("more than 0.1 s of processor time, and one before it more than 0.5 s.")
    assert len(others) == 2
    run = flexlab.simulate("paper", 0.03, law=tmp_path / "endless.py")
    assert "one call took more than 0.5 s of processor time." in run.status.text, (
        "outside of a study it has its full time"
    )
