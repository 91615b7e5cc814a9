"""Tuning finds what costs least within bounds and limits, robustly if asked, the same with the same seed."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from own_law_text import at_work

import flexlab
from flexlab.analysis.sweep.axes import parse_axes
from flexlab.analysis.tuning import FAILED, numbers_of, parse_cost, tune
from flexlab.errors import StudyError

PAPER = flexlab.load_preset("paper").replace({"simulation.accuracy": 1e-7})
EI = "payload.bending_stiffness"
GAIN = parse_axes(["controller.feedback_gain=50:800:log"], PAPER)


def test_the_best_of_a_monotone_cost_lies_at_the_bound_and_a_limit_moves_it():
    """More gain means less error and more internal force."""
    free = tune(PAPER, GAIN, parse_cost("rms-y"), duration=0.3, candidates=40)
    assert free.best.changes["controller.feedback_gain"] > 780
    assert free.best.cost < free.before.cost
    assert free.tuned.controller.feedback_gain == free.best.changes["controller.feedback_gain"]
    force = numbers_of(flexlab.simulate(PAPER, 0.3).metrics)["force"]
    limited = tune(PAPER, GAIN, parse_cost("rms-y", f"force={force}"), duration=0.3, candidates=40)
    assert limited.cost.holds(limited.best.metrics)
    assert limited.best.changes.get("controller.feedback_gain", 200) <= 200 * (1 + 1e-9)
    again = tune(PAPER, GAIN, parse_cost("rms-y", f"force={force}"), duration=0.3, candidates=40)
    assert [item.changes for item in again.candidates] == [item.changes for item in limited.candidates]


def test_a_robust_cost_is_that_of_the_worst_scenario():
    heavy = parse_axes({"payload.linear_density": [2.0, 8.0]}, PAPER)
    found = tune(PAPER, GAIN, parse_cost("rms-y=2"), heavy, duration=0.2, candidates=8)
    runs = [flexlab.simulate(PAPER.replace({"payload.linear_density": density}), 0.2) for density in (2.0, 8.0)]
    assert found.before.cost == max(2 * numbers_of(run.metrics)["rms-y"] for run in runs)


def test_a_run_that_fails_costs_most_and_says_why():
    far = parse_axes(["trajectory.center=[0,1.6,0]"], PAPER)
    with pytest.raises(StudyError, match="a range is searched, not a list"):
        tune(PAPER, far, parse_cost("rms-y"))
    out_of_reach, stiffness = PAPER.replace({"trajectory.center": (0, 1.6, 0)}), parse_axes([f"{EI}=50:100"], PAPER)
    with pytest.raises(StudyError, match=r"The scenario fails as it is: .*reach"):
        tune(out_of_reach, stiffness, parse_cost("rms-y"), duration=0.1)
    assert parse_cost("rms-y").of(None) == FAILED
    unsettled = flexlab.simulate(PAPER, 0.1).metrics
    assert numbers_of(unsettled)["settled"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "Nothing is varied"),
        (("--change", "gravty=0:1"), "did you mean gravity?"),
        (("--change", "gravity=0:1", "--cost", "rms"), "cost: 'rms' is no metric: choose one of duration, rms_error.x"),
        (("--change", "gravity=0:1", "--cost", "rms-x=-1"), "give a number above 0"),
        (("--change", "gravity=0:1", "--cost", "rms-x,rms-x"), "is named twice"),
        (("--change", "gravity=0:1", "--cost", ""), "names no metric"),
        (("--change", "gravity=0:1", "--limit", "torque"), "give a number above 0"),
        (("--change", "gravity=0:1", "--candidates", "3"), "candidates = 3 is not usable"),
        (("--change", "gravity=0,1",), "a range is searched, not a list"),
        (("--change", "gravity=0:1", "--save", "no/such/t.json"), "there is no folder no/such"),
        (("--change", "gravity=0:1", "--figure", "t.bmp"), "let it end in .svg or .png"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(
    flexlab_command: Callable[..., subprocess.CompletedProcess[str]], words: tuple[str, ...], says: str
):
    done = flexlab_command("tune", "paper", *words)
    assert done.returncode == 2, done.stderr
    assert says in done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr


def test_the_command_writes_a_preset_and_the_trade_off(
    flexlab_command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
):
    words = ("--change", "controller.feedback_gain=100:400:log", "--cost", "rms-y=1,force=0.01", "--duration", "0.2")
    done = flexlab_command("tune", "paper", *words, "--candidates", "12", "--save", "t.json", "--figure", "t.svg")
    assert done.returncode == 0, done.stderr
    tuned = flexlab.simulate(tmp_path / "t.json", 0.01).scenario
    assert 100 <= tuned.controller.feedback_gain <= 400
    assert "RMS error y (mm)" in (tmp_path / "t.svg").read_text(encoding="utf-8")
    impossible = flexlab_command("tune", "paper", *words, "--candidates", "12", "--limit", "torque=1")
    assert impossible.returncode == 1
    assert "Nothing that was tried keeps within the limits" in impossible.stderr


def test_the_command_says_why_every_run_fails(
    flexlab_command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
):
    (tmp_path / "ends.py").write_text(at_work("if at.time > 0.02: os._exit(0)"))
    words = ("--law", "ends.py", "--change", "controller.velocity_gain=100:900", "--duration", "0.05")
    done = flexlab_command("tune", "paper", *words, "--candidates", "8")
    assert done.returncode == 1
    assert "Every run that was tried fails: The control law own-pd stopped" in done.stderr
    assert "it ended its own process with os._exit" in done.stderr
