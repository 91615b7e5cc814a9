"""The benchmark measures what it says; no test depends on how fast this machine is."""

import io
import json
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from flexlab import benchmarks
from flexlab.benchmarks import live_costs, many_worlds, precision
from flexlab.benchmarks import report as report_of_bench
from flexlab.benchmarks.fresh_process import Memory, run_probe
from flexlab.benchmarks.many_worlds import (
    Round,
    ThreadWatch,
    WorkerScaling,
    locked_share,
    time_in_queue,
    worker_scaling,
)
from flexlab.benchmarks.measure import largest_difference, this_machine, try_out, version_of
from flexlab.benchmarks.precision import (
    ASKED_ERROR,
    GOALS,
    MESHES,
    WorkPoint,
    fitted_exponent,
    mesh_precision,
    paper_costs,
    variant,
)
from flexlab.benchmarks.report import Goal, memory_table, plain, precision_table
from flexlab.cli import bench_command
from flexlab.errors import StudyError
from flexlab.sim.simulate import simulate


@pytest.mark.parametrize("slope", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_law_is_found(slope):
    sizes = np.array([8, 16, 32, 64])
    assert fitted_exponent(list(sizes), list(3e-6 * sizes**slope)) == pytest.approx(slope, abs=1e-12)


def test_a_trial_gives_the_motion_of_a_run_and_its_cost():
    trial = try_out(variant(2, "etdrk4", 5e-4), 0.02, 2)
    run = simulate(variant(2, "etdrk4", 5e-4), 0.02)
    assert trial.completed
    assert np.array_equal(trial.samples.pose, run.pose[1:])
    assert trial.step == 5e-4
    assert trial.ms_per_second == pytest.approx(trial.us_per_step * 1e-3 / trial.step)
    assert trial.real_time_factor == pytest.approx(1e3 / trial.ms_per_second)


def test_a_run_that_stops_is_not_timed_for_ever():
    far = variant(2).replace({"trajectory.center": (0.0, 5.0, 0.0)})
    trial = try_out(far, 0.02, 2, least_time=1.0)
    assert not trial.completed
    assert len(trial.samples) == 0


def test_errors_are_the_largest_differences():
    fine, coarse = (try_out(variant(2, "etdrk4", step), 0.05, 1).samples for step in (1e-4, 1e-3))
    assert largest_difference(fine.pose, fine.pose) == 0
    assert largest_difference(coarse.pose, fine.pose) == np.max(np.abs(coarse.pose - fine.pose)) > 0
    assert largest_difference(coarse.pose[:20], fine.pose) == np.max(np.abs((coarse.pose - fine.pose)[:20])) > 0


def test_every_setting_computes_the_papers_run_to_the_required_accuracy():
    costs = paper_costs(0.1, 1)
    assert [cost.step for cost in costs][:2] == [1e-3, 2e-3]
    assert [cost.samples_at_1_khz for cost in costs] == [True, False, True]
    for cost in costs:
        assert 0 < cost.pose_error <= ASKED_ERROR
        assert cost.ms_per_second > 0


@pytest.fixture(scope="module")
def coarse_mesh():
    return mesh_precision(2, 0.1, 1)


def rows(mesh, integrator: str) -> list[WorkPoint]:
    return [point for point in mesh.points if point.integrator == integrator]


def test_the_reference_is_converged(coarse_mesh):
    smallest = min(point.pose_error for point in coarse_mesh.points if point.pose_error is not None)
    assert coarse_mesh.reference_uncertainty < 1e-11
    assert coarse_mesh.reference_uncertainty < 0.1 * smallest


def test_the_table_shows_each_methods_order(coarse_mesh):
    fourth = [point.pose_error or 0.0 for point in rows(coarse_mesh, "etdrk4")]
    second = [point.pose_error or 0.0 for point in rows(coarse_mesh, "generalized-alpha")]
    assert 8 < fourth[0] / fourth[1] < 24
    assert all(3 < longer / shorter < 5 for longer, shorter in zip(second, second[1:], strict=False))
    assert 1e-10 < fourth[0] < 1e-7 < second[0] < 1e-4


def test_an_unstable_step_gives_a_row_instead_of_a_crash(coarse_mesh):
    outcomes = [point.outcome for point in rows(coarse_mesh, "rk4")]
    assert outcomes == ["unstable", "unstable", "measured"]
    assert rows(coarse_mesh, "rk4")[0].ms_per_second is None


@pytest.mark.parametrize(("elements", "shown"), [(32, "0.48"), (64, "< 0.1 µs")])
def test_a_step_so_short_that_it_takes_too_long_is_shown_and_not_run(monkeypatch, elements: int, shown: str):
    monkeypatch.setattr(precision, "STEPS", {"rk4": (1e-3,)})
    mesh = mesh_precision(elements, 0.05, 1)
    assert [point.outcome for point in mesh.points] == ["unstable", "too slow"]
    assert not mesh.points[-1].exact_enough
    table = io.StringIO()
    Console(file=table, width=160).print(precision_table(mesh))
    assert shown in table.getvalue()


def test_the_fastest_row_is_exact_enough(coarse_mesh):
    fastest = coarse_mesh.fastest
    assert fastest.exact_enough
    assert all(fastest.ms_per_second <= point.ms_per_second for point in coarse_mesh.points if point.exact_enough)
    vague = replace(coarse_mesh, points=[point for point in coarse_mesh.points if not point.exact_enough])
    assert vague.fastest is None


@pytest.mark.parametrize(("at_least", "met"), [(True, [False, True, True]), (False, [True, True, False])])
def test_a_goal_is_met_up_to_its_limit(at_least, met):
    assert [Goal("figure", value, "", 2.0, at_least).met for value in (1.0, 2.0, 3.0)] == met


def test_results_become_plain_data_with_their_computed_properties():
    assert plain({"goals": [Goal("a", 1.0, "s", 2.0, False)]}) == {
        "goals": [{"what": "a", "value": 1.0, "unit": "s", "limit": 2.0, "at_least": False, "met": True}]
    }


def test_the_speed_up_leaves_out_the_time_spent_waiting_for_a_core():
    one = [Round(wall=2.0, cpu=1.0, undisturbed=1.0), Round(wall=1.0, cpu=1.0, undisturbed=1.0)]
    two = [Round(wall=2.0, cpu=1.0, undisturbed=0.5), Round(wall=1.0, cpu=1.0, undisturbed=0.5)]
    measured = WorkerScaling(80, one, two, 0.2)
    assert (measured.wall_speed_up, measured.cores_received, measured.speed_up) == (1.0, 0.75, 2.0)
    blind = [replace(each, undisturbed=None) for each in one], [replace(each, undisturbed=None) for each in two]
    assert WorkerScaling(80, *blind, 0.2).speed_up == 1.0


def test_a_run_spends_most_of_its_time_in_kernels_which_hold_no_lock():
    assert 0 <= locked_share() < 0.5


def test_a_thread_that_was_seen_only_once_has_no_measured_time():
    watch = ThreadWatch("watched")
    watch._look(threading.get_native_id())
    assert watch.undisturbed is None


def test_a_watched_thread_is_seen_and_never_lives_longer_than_the_clock_says():
    def stay() -> None:
        time.sleep(0.1)
        while watch.undisturbed is None and time_in_queue(threading.get_native_id()) is not None:
            time.sleep(0.01)  # On a busy machine the watcher may be late.

    start = time.perf_counter()
    with ThreadWatch("watched") as watch:
        thread = threading.Thread(target=stay, name="watched-1")
        thread.start()
        thread.join()
    if time_in_queue(threading.get_native_id()) is None:
        assert watch.undisturbed is None
    else:
        assert watch.undisturbed is not None
        assert 0 <= watch.undisturbed <= time.perf_counter() - start
    assert time_in_queue(0) is None


def test_the_workers_of_a_batch_are_watched_where_the_system_allows_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(many_worlds, "ROUND", 10)
    measured = worker_scaling(1)
    seen = time_in_queue(threading.get_native_id()) is not None
    assert [each.undisturbed is not None for each in (*measured.one, *measured.two)] == [seen, seen]


def test_a_probe_that_fails_says_what_happened():
    with pytest.raises(StudyError, match="no such thing"):
        run_probe("raise SystemExit('no such thing')", {})


def test_the_machine_is_described_in_one_line():
    machine = this_machine()
    assert machine.cores >= 1
    assert "numba" in machine.text
    assert "\n" not in machine.text
    assert version_of("a-library-that-nobody-wrote") is None


@pytest.fixture(scope="module")
def measured() -> tuple[dict[str, Any], str]:
    """The shortest benchmark that still runs every part, and its printed tables."""
    tables = io.StringIO()
    plan = benchmarks.Plan(meshes=(2,), duration=0.05, repeats=1, rounds=1, cold=False)
    with pytest.MonkeyPatch.context() as smaller:
        smaller.setattr(many_worlds, "ROUND", 4)
        smaller.setattr(many_worlds, "DURATION", 0.2)
        smaller.setattr(precision, "LEAST_TIME", 0.0)
        smaller.setattr(many_worlds, "STEPS", 20)
        for module in (live_costs, report_of_bench):  # A change on 64 elements takes a second.
            smaller.setattr(module, "MESHES", (2, 8))
        few = ("controller.feedback_gain", "payload.bending_stiffness")  # One field of the law, and one of the beam.
        smaller.setattr(live_costs, "CHANGES", {path: live_costs.CHANGES[path] for path in few})
        report = benchmarks.measure(plan, False, Console(file=tables, width=160, highlight=False))
    return report, tables.getvalue()


def test_everything_is_measured_and_printed_as_json(
    measured: tuple[dict[str, Any], str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    asked = []
    monkeypatch.setattr(benchmarks, "measure", lambda *words: asked.append(words) or measured[0])
    benchmarks.run_bench(as_json=True, quick=True)
    assert asked == [(benchmarks.QUICK, None, None)]
    report = json.loads(capsys.readouterr().out)
    assert set(report) == {
        "machine", "paper", "precision", "scaling", "changes", "workers", "environment", "round_trip", "start",
        "memory", "peers", "chain", "exact_beam", "goals",
    }  # fmt: skip
    assert [mesh["elements"] for mesh in report["scaling"]["meshes"]] == list(MESHES)
    assert report["precision"][0]["goal"] == GOALS[2]
    assert report["precision"][0]["fastest"]["pose_error"] <= ASKED_ERROR
    assert report["start"]["cold"] is None
    assert report["peers"] is None
    assert {"speed-up of two workers", "2 elements"} <= {goal["what"] for goal in report["goals"]}
    assert report["chain"] is None
    if report["environment"] is not None:
        assert report["environment"]["worlds"] == 64
        assert report["environment"]["one_core"] > 0
        assert "vector environment, 64 worlds" in {goal["what"] for goal in report["goals"]}
    if report["round_trip"] is not None:
        assert 0 < report["round_trip"]["p50_ms"] <= report["round_trip"]["p99_ms"]
    if report["memory"] is not None:
        assert 0.9 < report["memory"]["overhead"] < 1.5
        assert report["memory"]["live_growth"] < 2e6


def test_the_benchmark_prints_its_tables_unless_json_is_asked_for(
    measured: tuple[dict[str, Any], str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    for words in (
        "ms per s",
        "etdrk4",
        "unstable",
        "speed-up",
        "warm",
        "Vector environment",
        "another program",
        "Goals",
    ):
        assert words in measured[1]
    monkeypatch.setattr(benchmarks, "measure", lambda plan, peers, show: show.print("a table"))
    benchmarks.run_bench(as_json=False)
    assert capsys.readouterr().out == "a table\n"
    text = io.StringIO()
    Console(file=text).print(memory_table(Memory(10_000_000, 11_000_000, 0)))
    assert "1.10" in text.getvalue()


def test_other_engines_are_refused_in_a_sentence_outside_a_checkout(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(bench_command, "__file__", str(tmp_path / "flexlab" / "cli" / "bench_command.py"))
    with pytest.raises(StudyError, match="--peers needs a checkout of flexlab"):
        bench_command.command(peers=True)
