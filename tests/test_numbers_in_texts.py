"""Every number with a unit in README, documentation, presets, guide and lessons is computed here or listed as a setting.

A number must agree to its last digit. One that nothing here accounts for fails the test: add its pattern and how it is
computed.
"""

import os
import re
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from preset_run import run
from units_in_fmpy import apart

import flexlab
from flexlab.analysis.lesson_measures import ring_frequency, torque_jump, torque_turns
from flexlab.analysis.metrics import RunMetrics, run_metrics
from flexlab.analysis.metrics.run_metrics import between
from flexlab.analysis.modes import PoleRow, modes
from flexlab.analysis.sweep.plan import DEFAULT_ACCURACY
from flexlab.analysis.validation import beam as buckling
from flexlab.assets import presets_folder, web_assets_folder
from flexlab.control.laws.adaptive_sliding_mode import AdaptiveSlidingMode
from flexlab.own.path import AGREED, TOLERATED
from flexlab.physics.axial_load import buckling_load
from flexlab.physics.beam import beam_matrices
from flexlab.presets import load_preset, preset_names
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate
from flexlab.sim.target import shaper_impulses

EI, K, EPSILON = "payload.bending_stiffness", "controller.feedback_gain", "controller.boundary_layer"

Number = Callable[[], float]


def metrics(preset: str, first: float = 0.0, last: float = 3.0) -> RunMetrics:
    return run_metrics(run(preset), (first, last))


def peak(of: Run, signal: str, first: float, last: float, axes: slice = slice(None)) -> float:
    """Return the largest magnitude of a signal between two times, SI."""
    values = getattr(between(of, first, last), signal)
    return float(np.abs(values if values.ndim == 1 else values[:, axes]).max())


def first_mode(preset: str, **changes: float) -> float:
    scenario = load_preset(preset).replace({path.replace("__", "."): value for path, value in changes.items()})
    return float(modes(scenario).frequency[0])


def ring(preset: str) -> float:
    return ring_frequency(between(run(preset), 0.0, 0.3))


def pinned(k: int) -> float:
    """Frequency of mode k of the paper's beam on two pins, Hz."""
    beam = load_preset("paper").payload
    return np.pi * k**2 / (2 * beam.length**2) * np.sqrt(beam.bending_stiffness / beam.linear_density)


def softened(stiffness: float, signal: str) -> float:
    """Return the peak of a signal in the fifth second of the preset paper with a stiffness changed at t = 2 s, mm."""
    return 1e3 * peak(run("paper", (2.0, EI, stiffness), duration=5.0), signal, 4, 5, slice(2))


def thinner(signal: str, number: int, axes: slice = slice(None)) -> float:
    """Return the peak of a signal in fast-adaptation with ε = 0.1, 0.01, 0.001 (`number` 0, 1, 2), SI."""
    return peak(_thinned(), signal, 1 + 2 * number, 2 + 2 * number, axes)


def _thinned() -> Run:
    return run("fast-adaptation", (2.0, EPSILON, 0.01), (4.0, EPSILON, 0.001), duration=6.0)


def chatter(number: int) -> float:
    return torque_jump(torque_turns(between(_thinned(), 1 + 2 * number, 2 + 2 * number), 0.001))


def squeeze(of: Run, first: float, last: float) -> float:
    force = between(of, first, last).internal_force[:, 0, :2]
    return float(np.linalg.norm(force, axis=1).max())


def wrist() -> float:
    """Return the largest distance of a wrist from the base of its arm in large-swing, m."""
    swing = run("large-swing")
    scenario, pose = swing.scenario, swing.pose
    offset = scenario.payload.length / 2 + scenario.left_arm.link_length[2]
    along = np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=1)
    return max(
        float(np.linalg.norm(pose[:, :2] + side * offset * along - arm.base, axis=1).max())
        for side, arm in zip((-1, 1), scenario.arms, strict=True)
    )


def reach() -> float:
    return sum(load_preset("large-swing").left_arm.link_length[:2])


def sag() -> float:
    beam, gravity = load_preset("gravity").payload, load_preset("gravity").gravity
    return 5 * beam.linear_density * gravity * beam.length**4 / (384 * beam.bending_stiffness)


def tip(first: float, last: float) -> float:
    return peak(run("single-arm"), "beam_coordinates", first, last, slice(-2, -1))


def growth(preset: str, other: str) -> float:
    """Return the ratio of the bound estimates of two presets after three seconds."""
    return float((run(preset).bound_estimates[-1] / run(other).bound_estimates[-1]).mean())


def strays(first: float, last: float) -> float:
    alone = between(run("weak-feedback", duration=10.0), first, last)
    return float(np.sqrt(np.mean(np.sum(alone.tracking_error[:, :2] ** 2, axis=1))))


def path_rate(preset: str) -> float:
    return float(np.hypot(*(np.diff(run(preset).desired_pose[:2, :2], axis=0)[0] / 0.001)))


def worse(preset: str, first: float, last: float) -> float:
    """Return by how much the peak error of the worst axis grows against the preset paper, %."""
    ratio = [
        peak(run(preset), "tracking_error", first, last, slice(a, a + 1))
        / peak(run("paper"), "tracking_error", first, last, slice(a, a + 1))
        for a in range(3)
    ]
    return 100 * (max(ratio) - 1)


def moment(preset: str) -> float:
    return float(np.abs(run(preset).internal_force[:, 0, 2]).max())


def bends(preset: str) -> float:
    """Return the peak mid-span deflection in steady motion, mm."""
    return 1e3 * peak(run(preset), "midspan_deflection", 1, 3)


def error_left(kind: str, factor: float) -> float:
    """Return the largest error from t = 2 s on in the preset paper, if a law takes the beam to be `factor` times as heavy, mm."""
    changes = {"controller.kind": kind, "controller.model.linear_density_factor": factor}
    rival = simulate(load_preset("paper").replace(changes), 3.0)
    return 1e3 * peak(rival, "tracking_error", 2, 3, slice(2))


Changes = tuple[tuple[str, float | str], ...]
CLOCK: Changes = (("controller.control_period", 0.001), ("controller.input_delay", 1))
ESTIMATED: Changes = (("controller.kind", "composite"), ("controller.observer.kind", "kalman"))
MEASURED: Changes = (*CLOCK, ("controller.sensor_noise.strain", 1e-6))
OBSERVED: Changes = (*MEASURED, *ESTIMATED)
UNDAMPED: Changes = (
    *CLOCK,
    ("payload.element_count", 8),
    ("payload.damping.kind", "modal"),
    ("payload.damping.ratio", 0.0),
)
UNDAMPED_OBSERVED: Changes = (*UNDAMPED, *ESTIMATED)


@cache
def real(changes: Changes) -> Run:
    """Simulate the preset vibration-damping with changes: a clock, a delay, noisy strain gauges."""
    return simulate(load_preset("vibration-damping").replace(dict(changes)), 3.0)


@cache
def grows(changes: Changes) -> PoleRow:
    """Return the fastest growing pole of the preset vibration-damping with changes."""
    return modes(load_preset("vibration-damping").replace(dict(changes))).pole_rows()[0]


def late() -> float:
    """Return the input delay and half a control period, s: torques are held, and so act late by half a period on average."""
    law = load_preset("vibration-damping").replace(dict(UNDAMPED)).controller
    return law.control_period * (law.input_delay + 0.5)


@cache
def shaped(shaper: str, frequency: float | None = None) -> Run:
    """Simulate the preset sudden-stop with an input shaper."""
    path = {"trajectory.shaper": shaper, "trajectory.shaper_frequency": frequency}
    return simulate(load_preset("sudden-stop").replace(path), 2.0)


def left_after(shaper: str, frequency: float | None = None) -> float:
    """Return the residual vibration after the stop, mm."""
    return 1e3 * run_metrics(shaped(shaper, frequency)).residual_vibration[0]


def jumps(of: Run) -> float:
    """Return the RMS change of the joint torques from one millisecond to the next, N·m."""
    return torque_jump(torque_turns(between(of, 0.5, 1.0), 0.001))


def settling(preset: str) -> float:
    return metrics(preset).settling_time


@cache
def spun() -> Run:
    """Simulate the preset spin-up until it spins down."""
    return simulate(load_preset("spin-up"), 5.0, 0.01)


def crossings(of: Run) -> float:
    """Return the frequency of the mid-span deflection, from its upward zero crossings, Hz."""
    w = of.midspan_deflection
    upwards = np.flatnonzero((w[:-1] < 0) & (w[1:] >= 0))
    return float((len(upwards) - 1) / (of.time[upwards[-1]] - of.time[upwards[0]]))


def share_that_buckles() -> float:
    """Return the compression at which the beam's matrices lose all stiffness, in % of the stated buckling load."""
    return (
        100 * buckling.critical_load(16, "pinned-pinned") / buckling_load(buckling.LENGTH, buckling.EI, "pinned-pinned")
    )


def coupled_apart() -> float:
    """Return how far plant and law of `paper`, units that exchange values each millisecond, are off `simulate`, mm and mrad."""
    if shutil.which("cc") is None and not os.environ.get("CI"):
        pytest.skip("no C compiler (cc): units cannot be made")
    with TemporaryDirectory() as name:
        files = [flexlab.export_fmu("paper", Path(name, f"{part}.fmu"), part) for part in ("plant", "law")]
        return 1e3 * apart(load_preset("paper"), (files[0], files[1]), 0.001, 3.0, Path(name))


CLAIMS: dict[str, tuple[tuple[str, Number], ...]] = {
    "README": (
        (r"by at most (\S+) mm and mrad", coupled_apart),
        (r"pose accuracy of (\S+) µm", lambda: 1e6 * DEFAULT_ACCURACY),
        (r"which is within (\S+) nm", lambda: 1e9 * AGREED),
        (r"\((\S+) µm where its acceleration jumps", lambda: 1e6 * TOLERATED),
        (r"beam bends by (\S+) mm at its start", lambda: 1e3 * peak(run("paper"), "midspan_deflection", 0, 0.1)),
        (r"and by (\S+) mm in steady motion", lambda: bends("paper")),
        (r"the beam's (\S+) Hz with the naked eye", lambda: ring("paper")),
        (r"first mode at (\S+) Hz", lambda: first_mode("soft-beam")),
        (r"bends by (\S+) mm \|", lambda: bends("soft-beam")),
        (r"figure of eight (\S+) m wide", lambda: float(np.ptp(run("large-swing").pose[:, 0]))),
    ),
    "paper": (
        (r"at (\S+) Hz", lambda: ring("paper")),
        (r"peak after (\S+) s\.", lambda: settling("paper")),
        (r"bending by (\S+) mm at most", lambda: bends("paper")),
    ),
    "smooth-start": (
        (r"reaches (\S+) mm", lambda: 1e3 * metrics("paper").peak_vibration),
    ),
    "sudden-stop": (
        (r"moves by (\S+) m in half", lambda: shaped("none").desired_pose[-1, 1] - shaped("none").desired_pose[0, 1]),
        (r"beam does not: (\S+) mm", lambda: left_after("none")),
        (r"stop, at (\S+) Hz", lambda: first_mode("sudden-stop")),
        (r"zv leaves (\S+) mm", lambda: left_after("zv")),
    ),
    "soft-beam": (
        (r"mode is at (\S+) Hz", lambda: first_mode("soft-beam")),
        (r"instead of (\S+) Hz", lambda: first_mode("paper")),
        (r"bends it by (\S+) mm", lambda: bends("soft-beam")),
        (r"of which (\S+) mm", lambda: 1e3 * peak(run("soft-beam"), "vibration", 1, 3)),
    ),
    "squeeze-until-it-buckles": (
        (r"beam with (\S+) N", lambda: -float(run("squeeze-until-it-buckles").axial_load.mean())),
        (r"N, (\S+) % of", lambda: 100 * float(run("squeeze-until-it-buckles").axial_load_share[-1])),
        (r"rings at (\S+) Hz", lambda: crossings(run("squeeze-until-it-buckles"))),
        (r"instead of (\S+) Hz", lambda: first_mode("squeeze-until-it-buckles")),
        (r"bent by (\S+) mm", lambda: 1e3 * float(run("squeeze-until-it-buckles").midspan_deflection[0])),
    ),
    "spin-up": (
        (r"within (\S+) s:", lambda: float(spun().time[np.argmax(spun().pose_rate[:, 2] > 13.999)])),
        (r"up to (\S+) mm", lambda: 1e3 * float(np.abs(spun().beam_coordinates[:, -2]).max())),
    ),
    "stiff-beam": (
        (r"rings at (\S+) Hz", lambda: ring("stiff-beam")),
        (r"bends by (\S+) micrometres", lambda: 1e3 * bends("stiff-beam")),
    ),
    "large-swing": (
        (r"eight (\S+) m wide", lambda: float(np.ptp(run("large-swing").pose[:, 0]))),
        (r"by (\S+) rad", lambda: float(np.abs(run("large-swing").pose[:, 2]).max())),
        (r"as far as (\S+) m", wrist),
        (r"of the (\S+) m", reach),
    ),
    "vibration-damping": (
        (r"within (\S+) s", lambda: settling("vibration-damping")),
        (r"instead of (\S+) s", lambda: settling("paper")),
        (r"bending of (\S+) mm", lambda: bends("vibration-damping")),
    ),
    "composite": (
        (r"within (\S+) s", lambda: settling("composite")),
        (r"no more than without damping, (\S+) N·m \(RMS\)", lambda: jumps(run("composite"))),
        (r"make them jump by (\S+) N·m", lambda: jumps(real(MEASURED))),
    ),
    "lqr": (
        (r"path by (\S+) mm", lambda: 1e3 * peak(run("lqr"), "tracking_error", 0, 3, slice(2))),
        (r"instead of (\S+) mm", lambda: 1e3 * peak(run("paper"), "tracking_error", 0, 3, slice(2))),
        (r"within (\S+) s", lambda: settling("lqr")),
        (r"s instead of (\S+) s", lambda: settling("paper")),
        (r"up to (\S+) N·m", lambda: float(np.abs(run("lqr").joint_torque).max())),
        (r"N·m instead of (\S+) N·m", lambda: float(np.abs(run("paper").joint_torque).max())),
    ),
    "gravity": (
        (r"sag of (\S+) mm", lambda: 1e3 * sag()),
        (r"rings at (\S+) Hz", lambda: ring("gravity")),
    ),
    "single-arm": (
        (r"up to (\S+) mm", lambda: 1e3 * tip(0, 0.5)),
        (r"mm at (\S+) Hz", lambda: ring("single-arm")),
        (r"motion by (\S+) mm", lambda: 1e3 * tip(1, 3)),
    ),
    "weak-feedback": (
        (r"by (\S+) mm", lambda: 1e3 * peak(run("weak-feedback", duration=8.0), "tracking_error", 1, 8, slice(2))),
    ),
    "fast-adaptation": (
        (r"grow (\S+) times faster", lambda: growth("fast-adaptation", "paper")),
    ),
    "1-what-you-see": (
        (r"by (\S+) mm in steady motion", lambda: bends("paper")),
        (r"rings at (\S+) Hz", lambda: ring("paper")),
    ),
    "2-the-equations": (
        (r"(\S+) Hz, \S+ Hz, \S+ Hz at the paper's", lambda: pinned(1)),
        (r"\S+ Hz, (\S+) Hz, \S+ Hz at the paper's", lambda: pinned(2)),
        (r"\S+ Hz, \S+ Hz, (\S+) Hz at the paper's", lambda: pinned(3)),
        (r"elements give (\S+) Hz", lambda: first_mode("paper")),
        (r"it rings at (\S+) Hz", lambda: ring("paper")),
    ),
    "3-the-controller": (
        (r"to (\S+) % every 20 ms", lambda: 100 * float(np.exp(-0.02 * AdaptiveSlidingMode().sliding_slope))),
        (r"every (\S+) ms", lambda: 1e3 / AdaptiveSlidingMode().sliding_slope),
    ),
    "3-the-rivals": tuple(
        (rf"\| \*{kind}\* \| {before}(\S+) mm", lambda kind=kind, factor=factor: error_left(kind, factor))
        for kind in re.findall(
            r"^\| \*([\w-]+)\* \|", (web_assets_folder() / "guide/3-the-rivals.md").read_text(encoding="utf-8"), re.MULTILINE
        )
        for before, factor in (("", 1.0), (r"\S+ mm \| ", 3.0))
    ),
    "8-reading-the-plots": (
        (r"`paper`: (\S+) mm after the start", lambda: 1e3 * max(metrics("paper").peak_error[:2])),
        (r"at most (\S+) mm from t", lambda: 1e3 * max(metrics("paper", 1.0).peak_error[:2])),
        (r"the first at (\S+) Hz", lambda: first_mode("paper")),
        (r"linear beam; at (\S+) % it buckles", share_that_buckles),
    ),
    "1-ring": (
        (r"moves at (\S+) m/s", lambda: path_rate("paper")),
        (r"behind by (\S+) mm", lambda: 1e3 * metrics("paper").peak_vibration),
        (r"rings at (\S+) Hz", lambda: ring("paper")),
        (r"f₁ = (\S+) Hz", lambda: first_mode("paper")),
        (r"per cent in (\S+) s", lambda: settling("paper")),
    ),
    "2-soft-beam": (
        (r"from (\S+) Hz", lambda: first_mode("paper")),
        (r"Hz to (\S+) Hz", lambda: first_mode("paper", payload__bending_stiffness=10.0)),
        (r"and to (\S+) Hz", lambda: first_mode("paper", payload__bending_stiffness=1.27)),
        (r"from (\S+) mm", lambda: softened(100.0, "quasi_static_deflection")),
        (r"mm to (\S+) mm", lambda: softened(10.0, "quasi_static_deflection")),
        (r"and to (\S+) mm", lambda: softened(1.27, "quasi_static_deflection")),
        (r"which is (\S+) %", lambda: softened(1.27, "quasi_static_deflection") / 5),
        (r"another (\S+) mm", lambda: softened(1.27, "vibration")),
        (r"between (\S+) and", lambda: min(softened(ei, "tracking_error") for ei in (100.0, 10.0, 1.27))),
        (r"between \S+ and (\S+) mm", lambda: max(softened(ei, "tracking_error") for ei in (100.0, 10.0, 1.27))),
        (r"arms weigh (\S+) kg", lambda: sum(sum(arm.link_mass) for arm in load_preset("paper").arms)),
        (r"beam (\S+) kg", lambda: beam_matrices(0.5, 2.0, 100.0, 2, "pinned-pinned").m),
    ),
    "3-boundary-layer": (
        (r"falls from (\S+) mm", lambda: 1e3 * thinner("tracking_error", 0, slice(2))),
        (r"to (\S+) mm at its peak", lambda: 1e3 * thinner("tracking_error", 1, slice(2))),
        (r"hardly better, (\S+) mm", lambda: 1e3 * thinner("tracking_error", 2, slice(2))),
        (r"change by (\S+) N·m \(RMS\) per", lambda: chatter(1)),
        (r"vibration from (\S+) µm", lambda: 1e6 * thinner("vibration", 1)),
    ),
    "4-adaptation": (
        (r"grows to (\S+) mm RMS", lambda: 1e3 * strays(9, 10)),
        (r"little more than (\S+) %", lambda: worse("slow-adaptation", 1, 3)),
    ),
    "5-internal-force": (
        (r"other with (\S+) N", lambda: squeeze(run("paper"), 0, 0.1)),
        (r"motion (\S+) N", lambda: squeeze(run("paper"), 1, 3)),
        (r"K = 1000 (\S+) N", lambda: squeeze(run("paper", (2.0, K, 1000.0), duration=4.0), 3, 4)),
    ),
    "6-vibration": (
        (r"takes (\S+) s", lambda: settling("paper")),
        (r"with it: (\S+) s", lambda: settling("vibration-damping")),
        (r"the ring, within (\S+) s", lambda: run_metrics(real(MEASURED)).settling_time),
        (r"jump by (\S+) N·m \(RMS\) per", lambda: jumps(real(MEASURED))),
        (r"torque acts: (\S+) s again", lambda: run_metrics(real(OBSERVED)).settling_time),
        (r"change by (\S+) N·m \(RMS\) per", lambda: jumps(real(OBSERVED))),
        (r"grows by (\S+) %", lambda: worse("vibration-damping", 0, 3)),
        (r"peaks at (\S+) N·m", lambda: moment("vibration-damping")),
        (r"instead of (\S+) N·m", lambda: moment("paper")),
        (r"observer at (\S+) N·m", lambda: float(np.abs(real(OBSERVED).internal_force[:, 0, 2]).max())),
        (r"bending of (\S+) mm", lambda: bends("vibration-damping")),
    ),
    "7-input-shaping": (
        (r"moves by (\S+) m in half", lambda: shaped("none").desired_pose[-1, 1] - shaped("none").desired_pose[0, 1]),
        (r"after the stop (\S+) mm ring", lambda: left_after("none")),
        (r"other half (\S+) ms later", lambda: 1e3 * float(shaper_impulses(shaped("zv").scenario)[-1, 1])),
        (r"mode at (\S+) Hz", lambda: 0.5 / float(shaper_impulses(shaped("zv").scenario)[1, 1])),
        (r"cancels: (\S+) mm are", lambda: left_after("zv")),
        (r"and leaves (\S+) mm", lambda: left_after("zv", 4.0)),
        (r"period, (\S+) ms", lambda: 1e3 * float(shaper_impulses(shaped("zvd").scenario)[-1, 1])),
        (r"wrong frequency (\S+) mm", lambda: left_after("zvd", 4.0)),
    ),
    "8-spillover": (
        (r"answered (\S+) ms late", lambda: 1e3 * late()),
        (r"third mode, (\S+) Hz", lambda: grows(UNDAMPED).frequency),
        (r"the mode grows at (\S+) 1/s", lambda: grows(UNDAMPED).rate),
        (r"the fifth, (\S+) Hz", lambda: 1000 + grows(UNDAMPED_OBSERVED).frequency),
        (r"shows it at (\S+) Hz", lambda: grows(UNDAMPED_OBSERVED).frequency),
        (r"feeds it: it grows at (\S+) 1/s", lambda: grows(UNDAMPED_OBSERVED).rate),
        (r"hardly helps, (\S+) 1/s", lambda: grows((*UNDAMPED_OBSERVED, ("controller.observer.observer_modes", 5))).rate),
    ),
}  # fmt: skip
"""Text → (pattern with the number, how it is computed in the number's own unit)."""

LIMITS: dict[str, tuple[tuple[str, Number], ...]] = {
    "smooth-start": ((r"under (\S+) micrometres", lambda: 1e6 * metrics("smooth-start").peak_vibration),),
    "1-ring": ((r"under (\S+) µm", lambda: 1e6 * metrics("smooth-start").peak_vibration),),
    "3-boundary-layer": (
        (r"from under (\S+) N", lambda: max(squeeze(_thinned(), 1, 2), squeeze(_thinned(), 3, 4))),
    ),
    "6-vibration": ((r"less than (\S+) µm", lambda: 1e6 * peak(run("vibration-damping"), "vibration", 1, 3)),),
}  # fmt: skip
"""Like CLAIMS, for upper limits, which the value stays under but comes close to."""

CHAOTIC: dict[str, tuple[tuple[str, Number], ...]] = {
    "fast-adaptation": (
        (r"up to (\S+) N·m", lambda: float(np.abs(np.diff(
            run("fast-adaptation", (1.0, EPSILON, 0.001)).joint_torque[1500:], axis=0)).max())),
    ),
    "3-boundary-layer": (
        (r"change by (\S+) N·m \(RMS\) at every", lambda: chatter(2)),
        (r"N to (\S+) N", lambda: squeeze(_thinned(), 5, 6)),
        (r"µm to (\S+) µm", lambda: 1e6 * thinner("vibration", 2)),
    ),
}  # fmt: skip
"""Like CLAIMS, for numbers of chatter, which amplifies rounding: another compiler gives slightly other numbers."""
CHATTER_SPREAD = 0.15
"""Relative tolerance of the numbers of chatter."""

SETTINGS = (
    r"\(1 s\)|one second|t = (0\.6|1) s|at 1 kHz|at 60 Hz|steps? of 1 ms|the 1 Hz motion|T_c|Λ = 50 1/s|RMS per step",
    r"for 4 Hz|frequency, 4 Hz|clock of 1 kHz|ratio of 0\.01 %",
    r"deflection of 5 % of its length|with 95 % intervals|\(10 s in under",
)
"""Numbers with a unit that are set, not measured."""

PAGES = "scripts", "own", "studies", "class", "runs"
"""Pages of the documentation to which README links."""
UNITS = "mm|µm|micrometres|Hz|kHz|N·m|N|s|ms|%|m/s|kg|m|rad|times"
WITH_UNIT = re.compile(rf"(?<![\w.])\d+(?:\.\d+)?\s(?:{UNITS})(?![\w·/])")


def texts() -> dict[str, str]:
    """Return every text that states numbers by name, without code, with line breaks as spaces."""
    guide = {path.stem: path.read_text(encoding="utf-8") for path in web_assets_folder().glob("guide/**/*.md")}
    found = {name: text.partition("\n## Check\n")[0] for name, text in guide.items()}
    found |= {name: f"{load_preset(name).title}. {load_preset(name).watch}" for name in preset_names(Path("/none"))}
    home = presets_folder().parent
    pages = (home / "README.md", *(home / f"web_assets/docs/pages/{page}.md" for page in PAGES))
    found["README"] = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    return {name: re.sub(r"\s+", " ", re.sub(r"```.*?```", "", text, flags=re.S)) for name, text in found.items()}


TEXTS = texts()


def stated(text: str, pattern: str) -> tuple[float, int]:
    """Return the number that a text gives and how many decimals it has."""
    found = re.search(pattern, TEXTS[text])
    assert found, f"{pattern} is not in {text}"
    words = found[1].rstrip(".,:")
    return float(words), len(words.partition(".")[2])


def cases(table: dict[str, tuple[tuple[str, Number], ...]]) -> list[tuple[str, str, Number]]:
    return [(text, pattern, number) for text, claims in table.items() for pattern, number in claims]


def short(value: str | Number) -> str:
    """Return a part of a test's name that is the same in all processes."""
    return value[:40] if isinstance(value, str) else "number"


@pytest.mark.parametrize(("text", "pattern", "number"), cases(CLAIMS), ids=short)
def test_a_number_is_right_to_its_last_digit(text: str, pattern: str, number: Number):
    value, decimals = stated(text, pattern)
    assert number() == pytest.approx(value, abs=0.51 * 10.0**-decimals)


@pytest.mark.parametrize(("text", "pattern", "number"), cases(LIMITS), ids=short)
def test_a_limit_holds_and_is_tight(text: str, pattern: str, number: Number):
    value, _ = stated(text, pattern)
    assert 0.6 * value < number() < value


@pytest.mark.parametrize(("text", "pattern", "number"), cases(CHAOTIC), ids=short)
def test_a_number_of_chatter_is_right_within_its_spread(text: str, pattern: str, number: Number):
    assert number() == pytest.approx(stated(text, pattern)[0], rel=CHATTER_SPREAD)


@pytest.mark.parametrize("text", sorted(TEXTS))
def test_no_number_is_left_unaccounted_for(text: str):
    rest = TEXTS[text]
    claimed = [pattern for table in (CLAIMS, LIMITS, CHAOTIC) for pattern, _ in table.get(text, ())]
    spans = [found.span(1) for pattern in claimed if (found := re.search(pattern, rest))]
    spans += [found.span() for pattern in SETTINGS for found in re.finditer(pattern, rest)]
    left = [
        found[0] for found in WITH_UNIT.finditer(rest) if not any(start <= found.start() < end for start, end in spans)
    ]
    assert left == []


def test_numbers_in_words_are_right():
    """Such as 'a hundred times'."""
    paper, soft = load_preset("paper"), first_mode("soft-beam")
    assert "A hundred times stiffer" in TEXTS["stiff-beam"]
    assert load_preset("stiff-beam").payload.bending_stiffness == 100 * paper.payload.bending_stiffness
    for text in ("README", "slow-adaptation", "4-adaptation"):
        assert "hundred times more slowly" in TEXTS[text]
    assert 1 / growth("slow-adaptation", "paper") == pytest.approx(100, rel=0.01)
    assert "a tenth of the feedback gain" in TEXTS["README"]
    assert load_preset("weak-feedback").controller.feedback_gain == 0.1 * paper.controller.feedback_gain
    assert "five times as fast as the path" in TEXTS["2-soft-beam"]
    assert soft / load_preset("soft-beam").trajectory.frequency[0] == pytest.approx(5, abs=0.25)
    assert "within half a second" in TEXTS["9-keys-and-tips"]
    assert 0.4 < settling("paper") < 0.5
    assert "as much as in `paper`" in TEXTS["6-vibration"]
    assert jumps(run("paper")) == pytest.approx(jumps(real(OBSERVED)), abs=0.01)
    assert "Already at a ratio of 0.01 % nothing grows" in TEXTS["8-spillover"]
    assert grows((*UNDAMPED_OBSERVED, ("payload.damping.ratio", 1e-4))).verdict == "decays"
    assert grows(UNDAMPED_OBSERVED).origin == "beam mode 5"


def test_the_vibration_that_stays_in_a_soft_beam_is_forced():
    """It repeats itself each period to one part in ten thousand; a free ring would have died down or be out of step."""
    soft = run("soft-beam", duration=8.0)
    period = 1000
    later, earlier = soft.vibration[-2 * period :], soft.vibration[-3 * period : -period]
    assert np.abs(later - earlier).max() < 1e-4 * np.abs(later).max()
    assert np.isnan(settling("soft-beam"))
