"""The metrics of a run, computed from its samples by their definitions, and what a change during a run preserves."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from flexlab.analysis.leaderboard.case import cases
from flexlab.analysis.leaderboard.cases.standard import BoundDrift
from flexlab.analysis.lesson_measures import bound_terms
from flexlab.analysis.metrics.run_metrics import MetricCollection, run_metrics
from flexlab.analysis.metrics.vibration import LATER, SettlingTime, settling_time
from flexlab.analysis.result import number_column
from flexlab.analysis.sweep.axes import parse_axes
from flexlab.analysis.sweep.figures import draw_metric, pareto_front
from flexlab.analysis.sweep.plan import make_plan, run_part
from flexlab.analysis.sweep.result import to_table
from flexlab.analysis.tuning import Candidate, Cost, Tuning, tried_in
from flexlab.analysis.validation.check import PERIOD, Check, Runs, alike, below, close, run_of, subject, true
from flexlab.analysis.validation.mass_points import GAUSS_POINTS, MassPoints
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

STOP = 0.2
"""Duration of a motion of 0.2 m after which a soft beam rings, s."""
HEAVIER = {"right_arm.link_mass": (12.0, 12.0, 6.0)}
"""Masses of a heavier right arm, kg."""
BEFORE = 0.02
"""Time of a change, s, at which the beam still rings."""


PIECES = 13
"""Pieces in which the metrics of a whole run are gathered."""
CELLS = 8
"""Number of cells of a sampled sweep."""
WINDOW = 300, 901
"""First sample and first one after a window of the paper's run."""


@subject("Numbers that sum up a run", 16)
def summary(runs: Runs) -> Iterator[Check]:
    """Metrics of the paper's run and of one that stops; a change to a finer mesh during a run."""
    run = runs.paper
    found, e = run_metrics(run, own=False), run.tracking_error
    force, moment = run.internal_force[:, 0, :2], run.internal_force[:, 0, 2]
    wanted = {
        "duration": [run.time[-1] - run.time[0]],
        "rms_error": np.sqrt((e**2).mean(axis=0)),
        "peak_error": np.abs(e).max(axis=0),
        "peak_vibration": [np.abs(run.midspan_deflection - run.quasi_static_deflection).max()],
        "peak_torque": [np.abs(run.joint_torque).max()],
        "peak_axial_load": [np.max(run.axial_load_share)],
        "rms_internal_force": [np.sqrt((force**2).sum(axis=1).mean())],
        "rms_internal_moment": [np.sqrt((moment**2).mean())],
    }
    for name, exact in wanted.items():
        yield alike(f"{name.replace('_', ' ')}, from all samples: relative error", 1e-12, getattr(found, name), exact)
    rows = slice(*WINDOW)
    within = run_metrics(run, (run.time[rows.start] + 1e-15, run.time[rows.stop - 1] - 1e-15), own=False).rms_error
    statement = "rms error within a window, with its first sample and its last: relative error"
    yield alike(statement, 1e-12, within, np.sqrt((e[rows] ** 2).mean(axis=0)))
    yield from _settling()
    yield from _studies()
    path = {"kind": "rest-to-rest", "duration": STOP}
    stopped = run_of(
        "the run that stops",
        {"trajectory": path, "payload.bending_stiffness": 5.0, "payload.mode_count": 3, **HEAVIER},
        0.7,
        PERIOD,
    )
    left = [np.abs(stopped.vibration[stopped.time > t - PERIOD / 2]).max() for t in (STOP, STOP + LATER)]
    told = run_metrics(stopped, own=False).residual_vibration
    yield alike("residual vibration after the stop: relative error", 1e-12, told, left)
    statement = "peak torque of a run whose right arm is the heavier one: relative error"
    exact = np.abs(stopped.joint_torque[:, 1]).max()
    yield alike(statement, 1e-12, run_metrics(stopped, own=False).peak_torque, exact)
    for words, whole in (("the paper's run", run), ("a run that stops", stopped)):
        gathered, edges = MetricCollection(own=False), np.linspace(0, len(whole), PIECES + 1).astype(int)
        for first, last in pairwise(edges):
            gathered.update(whole.slice(first, last))
        statement = f"{words} in {PIECES} pieces: every metric is that of the whole: relative error"
        told, exact = (
            np.nan_to_num(each.numbers, nan=-1.0) for each in (gathered.compute(), run_metrics(whole, own=False))
        )
        yield below(statement, 1e-12, told / exact - 1)
    found, limit = run_metrics(run, own=False), float(np.abs(run.joint_torque).max() / 2)
    cost = Cost({"rms_error.y": 2.0, "peak_torque": 3.0}, {"peak_torque": limit})
    told, exact = [cost.of(found), cost.excess(found)], [2 * found.rms_error.y + 3 * found.peak_torque, 1.0]
    yield alike("tuning: cost, and excess over a limit of half the peak: relative error", 1e-12, told, exact)
    drift, bound = BoundDrift(), np.sum(run.bound_estimates * bound_terms(run.pose, run.pose_rate), axis=1)
    drift.update(run)
    exact = float(np.polyfit(run.time, bound, 1)[0])
    yield close("leaderboard: drift of the learnt bound", exact, drift.compute()[0], "N/s", relative=1e-8)
    soft = load_preset("paper").replace({"payload.bending_stiffness": 10.0, "payload.element_count": 8})
    path = next(each for each in cases()["B6"].variants if each.name == "1 f1").changes
    exact = np.array([MassPoints(soft).softest() ** 0.5, 2.0])
    omega = 2 * np.pi * path["trajectory.frequency"][1]
    told = np.array([omega, path["trajectory.amplitude"][1] * omega**2])
    statement = "leaderboard: B6 swings with the first mode, 1/s, and 2 m/s²: relative error"
    yield below(statement, 1e-3, told / exact - 1)
    # Two elements become eight: a cubic on an element is a cubic on each of its parts, so the motion must not change.
    world = World(load_preset("paper"), PERIOD)
    world.run(round(BEFORE / PERIOD))
    coarse = world.observe()
    world.apply(ChangeScenario({"payload.element_count": 8}))
    fine = world.observe()
    for name in ("pose_rate", "midspan_deflection", "elastic_energy", "kinetic_energy"):
        statement = f"four elements instead of one keep the {name.replace('_', ' ')}: relative change"
        yield alike(statement, 1e-9, fine[name], coarse[name])
    yield from _loosened()
    yield from _clocked()
    # Three elements cannot take the shape that eight have.
    points, before = MassPoints(world.scenario), world.observe()
    world.apply(ChangeScenario({"payload.element_count": 3}))
    after, fewer = world.observe(), MassPoints(world.scenario)
    for name in ("beam_coordinates", "beam_rates"):
        exact = _closest(points, fewer, before[name][0])
        statement = f"three elements get the closest {name.replace('_', ' ')} with the same mid-span: relative error"
        yield alike(statement, 1e-9, after[name][0], exact)


def _studies() -> Iterator[Check]:
    """Cells of a sweep, each as a run of its own, in its table and its map; samples of a range; fronts; worst scenarios."""
    paper, (stiffness, damping) = load_preset("paper"), ("payload.bending_stiffness", "payload.damping.coefficient")
    axes = parse_axes([f"{stiffness}=10:1000:log:3", f"{damping}=0.1,0.4"], paper)
    plan = make_plan(paper, axes, 0.05, PERIOD, accuracy=None)
    table = to_table(plan, run_part(plan, range(plan.cell_count)))
    varied = np.array([(EI, c) for EI in (10.0, 100.0, 1000.0) for c in (0.1, 0.4)])
    runs = [
        run_metrics(simulate(paper.replace(dict(zip((stiffness, damping), each, strict=True))), 0.05, PERIOD))
        for each in varied.tolist()
    ]
    exact = np.column_stack([varied, [run.numbers for run in runs]])
    told = np.array([number_column(table, name) for name in (stiffness, damping, *runs[0].by_name())]).T
    statement = "sweep: its table has the metrics of single runs with the values of its cells: relative error"
    yield alike(statement, 1e-12, np.nan_to_num(told, nan=-1.0), np.nan_to_num(exact, nan=-1.0))
    drawn: Any = draw_metric(plan, table, "rms_error.y").axes[0].collections[0]
    x, y = np.moveaxis(drawn.get_coordinates(), 2, 0)
    places = np.column_stack([np.tile(np.sqrt(x[0, 1:] * x[0, :-1]), 2), np.repeat((y[1:, 0] + y[:-1, 0]) / 2, 3)])
    told = np.column_stack([places, drawn.get_array().ravel() / 1e3])
    exact = np.column_stack([varied, [run.rms_error.y for run in runs]])[[0, 2, 4, 1, 3, 5]]
    yield below(
        "and its map, whose x is logarithmic, shows them at those values: relative error", 1e-12, told / exact - 1
    )
    sampled = make_plan(paper, axes[:1], 0.05, PERIOD, "latin-hypercube", CELLS)
    part = [CELLS * np.log10(sampled.values(cell)[0] / 10) / 2 for cell in range(CELLS)]
    held = sorted(np.floor(part).astype(int)) == list(range(CELLS))
    yield true(f"a Latin hypercube of {CELLS} cells has one in each of as many equal ratios", held)
    x, y = np.random.default_rng(6).random((2, 200))
    front = [k for k in np.argsort(x) if not np.any((x < x[k]) & (y < y[k]))]
    yield true("front of two numbers: those that no other one beats in both", list(pareto_front(x, y)) == front)
    cost = Cost({"rms_error.y": 1.0}, {})
    told = tried_in([paper.replace({stiffness: EI, damping: 0.1}) for EI in (10.0, 1000.0)], cost, 0.05, {}).cost
    yield close(
        "tuning: of several scenarios the worst one counts",
        max(runs[0].rms_error.y, runs[4].rms_error.y),
        told,
        "m",
        1e-12,
    )
    of = [Candidate({}, *each, None, "") for each in ((3.0, 0.0), (1.0, 0.5), (np.nan, np.nan), (2.0, 0.0), (4.0, 0.4))]
    ordered = sorted(of, key=lambda each: each.rank) == [of[place] for place in (3, 0, 4, 1, 2)]
    yield true(
        "least costs within the limits, then least excess, then failures",
        ordered and Tuning(paper, cost, tuple(of)).best is of[3],
    )


def _loosened() -> Iterator[Check]:
    """Grips that begin to give way, and motors that begin to lag, in motion."""
    world = World(load_preset("paper"), PERIOD)
    world.run(round(BEFORE / PERIOD))
    before = world.observe()
    world.apply(ChangeScenario({"grips.model": "compliant", "joints.motor.time_constant": 0.01}))
    after = world.observe()
    for name in ("pose_rate", "kinetic_energy", "joint_torque"):
        statement = (
            f"grips give way and motors lag from now on: that keeps the {name.replace('_', ' ')}: relative change"
        )
        yield alike(statement, 1e-9, after[name], before[name])


def _clocked() -> Iterator[Check]:
    """A clock that begins in motion, and a delay that grows."""
    world = World(load_preset("paper"), PERIOD)
    world.run(round(BEFORE / PERIOD))
    last = world.observe().joint_torque[0]
    world.apply(ChangeScenario({"controller.control_period": PERIOD, "controller.input_delay": 2}))
    held = [world.observe().joint_torque[0], world.advance(1).joint_torque[0]]
    statement = (
        "a clock begins, with two samples of delay: until they are over, motors hold the last torques: relative change"
    )
    yield alike(statement, 1e-9, held, [last, last])
    world.advance(5)
    world.apply(ChangeScenario({"controller.input_delay": 4}))
    later = world.advance(4).joint_torque
    world = World(load_preset("paper"), PERIOD)
    world.run(round(BEFORE / PERIOD))
    world.apply(ChangeScenario({"controller.control_period": PERIOD, "controller.input_delay": 2}))
    due = world.advance(8).joint_torque[-2:]
    statement = "two more samples of delay: torques under way come two samples later: relative difference"
    yield alike(statement, 1e-9, later[2:], due)
    torques = []
    for counts in (1e9, 0.0):
        fast = {"controller.control_period": PERIOD, "joints.encoders.counts": (counts,) * 3}
        world = World(load_preset("paper").replace(fast), PERIOD)
        world.run(round(BEFORE / PERIOD) + 1)
        world.apply(ChangeScenario({"controller.control_period": 4 * PERIOD}))
        torques.append(world.advance(4).joint_torque[-1])
    statement = (
        "a slower clock: encoders' first rate lags by half its period: torques beside those by exact rates: change"
    )
    yield alike(statement, 0.3, *torques)


def _settling() -> Iterator[Check]:
    """The settling time of rings, which last so long that the metric joins its pieces of time, and which come in pieces."""
    t = 0.5 + np.arange(14_000) * PERIOD

    def gone(signal: np.ndarray) -> float:
        return float(t[np.flatnonzero(np.abs(signal) > 0.01 * np.abs(signal).max())[-1]] - t[0])

    ring = np.exp(-3 * t) * np.cos(50 * t)
    yield close("settling time of a decaying cosine", gone(ring), settling_time(t, ring), "s", absolute=1e-12)
    # A tap 8 s after the first ring: the pause before it is longer than the time after the second ring, and does not count.
    tapped = ring + np.where(t > 9, 0.3 * np.exp(-np.abs(t - 9)) * (1 - np.cos(60 * (t - 9))), 0.0)
    yield close("and of one that is tapped later", gone(tapped), settling_time(t, tapped), "s", absolute=1e-12)
    metric = SettlingTime()
    for part in np.array_split(np.arange(len(t)), 23):
        metric.add(t[part], tapped[part])
    yield close("the same in 23 pieces", gone(tapped), metric.compute()[0], "s", absolute=1e-12)
    # A beat is below 1 % for 0.128 s at each of its nodes, t = 0, 2, 4 … s.
    beat = np.sin(np.pi * t / 2) ** 2 * np.cos(400 * t)
    for words, quiet, settles in (("less", 1.7, False), ("more", 2.3, True)):
        end = np.searchsorted(t, 7.936 + 0.128 * quiet)
        part = np.where(t < 7.936, beat, 0.0)[:end]
        settled = bool(np.isfinite(settling_time(t[:end], part)))
        yield true(f"a beat followed by {words} than twice its longest pause: settled or not", settled == settles)


def _closest(old: MassPoints, new: MassPoints, q: np.ndarray) -> np.ndarray:
    """Coordinates on a new mesh that minimise ∫(w' - w)²ds, at the same mid-span deflection, by a Lagrange multiplier."""
    edges = np.union1d(old.shapes.x, new.shapes.x)
    x, weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges)[:, None] / 2
    s, weight = (middle[:, None] + half * x).ravel(), (half * weight).ravel()
    N, fixed = new.shapes(s), new.shapes(0.0)[None, :]
    whole = np.block([[N.T @ (weight[:, None] * N), fixed.T], [fixed, np.zeros((1, 1))]])
    wanted = np.concatenate([N.T @ (weight * (old.shapes(s) @ q)), [old.shapes(0.0) @ q]])
    return np.linalg.solve(whole, wanted)[:-1]
