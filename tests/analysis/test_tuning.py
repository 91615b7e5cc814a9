"""Tuning finds the least cost within bounds and limits, robustly if asked, and gives the same result again."""

import math
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from own_law_text import at_work

import flexlab
from flexlab.analysis.metrics.metric import forget
from flexlab.analysis.sweep.axes import parse_axes
from flexlab.analysis.tuning import numbers_of, parse_cost, tune
from flexlab.errors import StudyError

PAPER = flexlab.load_preset("paper").replace({"simulation.accuracy": 1e-7})
EI = "payload.bending_stiffness"
GAIN = parse_axes(["controller.feedback_gain=50:800:log"], PAPER)


def test_the_best_of_a_monotone_cost_lies_at_the_bound_and_a_limit_moves_it():
    """A larger gain means less error and more internal force."""
    free = tune(PAPER, GAIN, parse_cost("rms-y"), duration=0.3, candidates=40)
    assert free.best.changes["controller.feedback_gain"] > 780
    assert free.best.cost < free.before.cost
    assert free.tuned.controller.feedback_gain == free.best.changes["controller.feedback_gain"]
    force = numbers_of(flexlab.simulate(PAPER, 0.3).metrics)["force"]
    limited = tune(PAPER, GAIN, parse_cost("rms-y", f"force={force}"), duration=0.3, candidates=40)
    assert limited.holds
    assert limited.cost.holds(limited.best.metrics)
    assert not limited.cost.holds(free.best.metrics)
    assert limited.best.changes.get("controller.feedback_gain", 200) <= 200 * (1 + 1e-9)
    again = tune(PAPER, GAIN, parse_cost("rms-y=1e-9"), duration=0.3, candidates=40)
    assert [item.changes for item in again.candidates] == [item.changes for item in free.candidates], "in any unit"


@pytest.mark.parametrize("weight", [1.0, 1e16])
def test_a_cost_is_metrics_times_weights_and_limits_count_before_it(weight: float):
    """The cost in the table had a penalty, 10⁷ for 6 % too much torque, and a large weight could outweigh a limit."""
    kept = {"limits": {"peak_torque": 600.0, "rms_internal_force": 130.0}}
    cost = parse_cost({"rms_error.y": weight}, **kept)
    found = tune(PAPER, GAIN, cost, duration=0.3, candidates=30)
    table = found.table.to_pylist()
    assert [row["cost"] for row in table] == [weight * row["rms_error.y"] for row in table]
    over = [max(row["peak_torque"] / 600 - 1, 0) + max(row["rms_internal_force"] / 130 - 1, 0) for row in table]
    assert [row["excess"] for row in table] == pytest.approx(over, abs=1e-12)
    assert 0 < table[0]["excess"] < 0.5, "the scenario as it was is beyond the limits"
    assert found.holds
    within = [cost for cost, row in zip((row["cost"] for row in table), table, strict=True) if row["excess"] == 0]
    assert found.best.cost == min(within)
    assert [row["excess"] for row in table[1:]] == sorted(row["excess"] for row in table[1:])
    assert "beyond the limits → " in repr(found)


def test_a_robust_cost_is_that_of_the_worst_scenario():
    heavy = parse_axes({"payload.linear_density": [8.0, 2.0]}, PAPER)
    found = tune(PAPER, GAIN, parse_cost("rms-y=2"), heavy, duration=0.2, candidates=8)
    assert len(found.candidates) == 8, "with the scenario as it was"
    runs = [flexlab.simulate(PAPER.replace({"payload.linear_density": density}), 0.2) for density in (2.0, 8.0)]
    assert found.before.cost == max(2 * numbers_of(run.metrics)["rms-y"] for run in runs)


def test_a_field_that_is_searched_and_also_varied_is_refused():
    """The searched value replaced the others, so that the tuning was not robust at all."""
    both = parse_axes([f"{GAIN[0].path}=100,200"], PAPER)
    with pytest.raises(StudyError, match=f"^{GAIN[0].path} is both searched and varied by robust"):
        tune(PAPER, GAIN, parse_cost("rms-y"), both, duration=0.1, candidates=8)


def test_a_scenario_that_fails_as_it_is_and_a_list_to_search_are_refused():
    far = parse_axes(["trajectory.center=[0,1.6,0]"], PAPER)
    with pytest.raises(StudyError, match="a range is searched, not a list"):
        tune(PAPER, far, parse_cost("rms-y"))
    out_of_reach, stiffness = PAPER.replace({"trajectory.center": (0, 1.6, 0)}), parse_axes([f"{EI}=50:100"], PAPER)
    with pytest.raises(StudyError, match=r"The scenario fails as it is: .*reach"):
        tune(out_of_reach, stiffness, parse_cost("rms-y"), duration=0.1)
    titled = parse_cost({"RMS error y [mm]": 2.0, "Peak vibration (mm)": 1.0})  # A tuning with one raised KeyError.
    assert titled == parse_cost("rms-y=2,vibration")
    with pytest.raises(StudyError, match="cost: rms-y=0 is not usable: give a number above 0"):
        parse_cost({"rms-y": 0})
    assert math.isnan(parse_cost("rms-y").of(None))
    unsettled = flexlab.simulate(PAPER, 0.1).metrics
    assert numbers_of(unsettled)["settled"] == numbers_of(unsettled)["settling_time"] == pytest.approx(1.0)


def test_a_metric_without_a_value_has_no_cost():
    """Its cost was ten times the run's length, in metres or joules, which may be the least of all."""

    @flexlab.metric("J")
    def worth(samples: flexlab.Samples) -> float:
        return 500.0 if len(samples) and samples.bound_estimates[-1, 0] < 0.006 else missing

    missing = math.nan
    try:
        found = tune(PAPER, GAIN, parse_cost("worth"), duration=0.05, candidates=12)
        missing = -math.inf  # Infinity was a cost, -inf the least of all.
        assert tune(PAPER, GAIN, parse_cost("worth"), duration=0.05, candidates=12).table == found.table
        values = set(found.table.column("cost").to_pylist())
        assert values == {500.0, None}, "some gains have a value, and others have none"
        assert (found.best.cost, found.problem) == (500.0, "")
        assert {row["sentence"] for row in found.table.to_pylist()} == {
            "", "The metric worth has no value in this run."
        }  # fmt: skip
    finally:
        forget("worth")
    never = tune(PAPER, GAIN, parse_cost("residual_vibration.stop"), duration=0.05, candidates=8)
    says = "Every run that was tried fails: The metric residual_vibration.stop has no value in this run."
    assert (never.problem, repr(never)) == (says, f"<Tuning of {len(never.candidates)} candidates: {says}>")
    assert not math.isnan(never.plot().axes[0].get_xlim()[0])


def test_a_metric_called_cost_leaves_the_column_of_the_cost_alone():
    @flexlab.metric("J")
    def cost(samples: flexlab.Samples) -> float:
        return 3.0

    try:
        found = tune(PAPER, GAIN, parse_cost("cost=2"), duration=0.02, candidates=8)
        assert set(found.table.column("cost").to_pylist()) == {6.0}
    finally:
        forget("cost")


@pytest.mark.parametrize(
    ("cost", "limits", "traded"),
    [
        ("rms-y", (), ["rms-y", "rms_internal_force"]),
        ("force", (), ["force", "rms_error.y"]),
        ("rms-y", "torque=600", ["rms-y", "torque"]),
    ],
)
def test_the_trade_off_is_between_two_metrics(cost: str, limits: str, traded: list[str]):
    """By its earlier name a metric was drawn over itself, and the page Studies left out the limited one."""
    assert parse_cost(cost, limits).traded() == traded


def test_the_trade_off_has_no_settling_time_of_a_run_that_has_not_settled():
    """Those runs stood at ten times their length."""
    drawn = tune(PAPER, GAIN, parse_cost("settling_time"), duration=0.05, candidates=8).plot(
        "settling_time", "rms_error.y"
    )
    assert all(np.isnan(line.get_xdata()).all() for line in drawn.axes[0].lines)


def test_a_run_that_has_not_settled_exceeds_any_limit_of_its_settling_time():
    unsettled = flexlab.simulate(PAPER, 0.1).metrics
    cost = parse_cost("rms_error.y", "settling_time=2")
    assert cost.excess(unsettled) > 0
    settled = flexlab.simulate(PAPER, 0.6).metrics
    strict = parse_cost("rms_error.y", "settling_time=0.01")
    assert 40 < strict.excess(settled) < strict.excess(unsettled), "not settled counted as 10"
    found = tune(PAPER, GAIN, cost, duration=0.05, candidates=8)
    assert not found.holds
    assert "Nothing that was tried keeps within the limits" in repr(found)


def test_a_field_of_several_numbers_is_tuned_if_it_accepts_one_number_for_all():
    kept = {"cost": parse_cost("rms_error.y"), "duration": 0.02, "candidates": 8}
    found = tune(PAPER, parse_axes(["trajectory.amplitude=0.1:0.2"], PAPER), **kept)
    column = found.table.column("trajectory.amplitude").to_pylist()
    assert column[0] == 0.2
    assert column[1:] == [candidate.changes["trajectory.amplitude"] for candidate in found.candidates[1:]]
    never = tune(PAPER, parse_axes(["controller.torque_limit=100:300"], PAPER), **kept)
    assert never.problem.startswith("Every run that was tried fails: controller.torque_limit = ")
    assert "needs a list of numbers" in never.problem
    rows = never.table.to_pylist()
    assert rows[0]["scenario"] is not None
    assert {row["scenario"] for row in rows[1:]} == {None}
    assert {row["controller.torque_limit"] for row in rows[:1]} == {None}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "Nothing is varied"),
        (("--change", "gravty=0:1"), "did you mean gravity?"),
        (("--change", "gravity=0:1", "--cost", "rms"), "cost: 'rms' is not a metric: choose one of duration, rms_error.x"),
        (("--change", "gravity=0:1", "--cost", "rms-x=-1"), "give a number above 0"),
        (("--change", "gravity=0:1", "--cost", "rms-x,rms-x"), "is named twice"),
        (("--change", "gravity=0:1", "--cost", "rms-x,rms_error.x=2"), "cost: rms_error.x is named twice, also as rms-x"),
        (("--change", "gravity=0:1", "--cost", ""), "names no metric"),
        (("--change", "gravity=0:1", "--limit", "torque"), "give a number above 0"),
        (("--change", "gravity=0:1", "--candidates", "3"), "candidates = 3 is not usable"),
        (("--change", "gravity=0,1",), "a range is searched, not a list"),
        (("--change", "gravity=0:1", "--save", "no/such/t.json"), "there is no folder no/such"),
        (("--change", "gravity=0:1", "--save", "."), ". cannot be written (Is a directory)"),
        (("--change", "gravity=0:1", "--save", "run.rrd"), "run.rrd cannot be written: let its name end in .json"),
        (("--change", "gravity=0:1", "--figure", "taken.svg"), "taken.svg cannot be written (Is a directory)"),
        (("--change", "gravity=0:1", "--figure", "t.bmp"), "let it end in .svg or .png"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(
    flexlab_command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path, words: tuple[str, ...], says: str
):
    (tmp_path / "taken.svg").mkdir()
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
    impossible = flexlab_command("tune", "paper", *words, "--candidates", "12", "--limit", "torque=1,settled=1")
    assert impossible.returncode == 1
    assert re.search(r"settled, at most 1 +not settled +not settled\n", impossible.stdout), "no run settles in 0.2 s"
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
