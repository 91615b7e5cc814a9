"""The numbers in sentences that explain a run, with three digits, each by a closed form or from mass points."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import eigh

from flexlab.analysis.explanations.explanation import explain_run, filled
from flexlab.analysis.lesson_measures import Look, strongest_line, torque_jump, torque_turns
from flexlab.analysis.modes import modes
from flexlab.analysis.validation.beam import LENGTH, RHO
from flexlab.analysis.validation.check import (
    DAMPING,
    PERIOD,
    STILL,
    UNEQUAL,
    Check,
    Runs,
    alike,
    close,
    run_of,
    subject,
)
from flexlab.analysis.validation.mass_points import MassPoints
from flexlab.analysis.validation.paper import desired, loop_pole
from flexlab.analysis.validation.sampled_loop import GROWTH
from flexlab.analysis.validation.sampled_sentences import sampled_sentences
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Run, Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.termination import pose_fault

DIGITS = 0.006
"""Relative error of a number with three digits."""
SOFT, TILT, SHARE = 10.0, 0.4, 0.7
"""Bending stiffness of a beam that its weight bends, N·m²; angle at which it is held, rad; the left arm's share of it."""
SPRING, BELIEVED = 2e4, {"linear_density_factor": 3.0, "length_factor": 1.1}
"""Position gain, N/m, of a law that knows no inertia; and a wrong model of the payload."""

ROUND = {"trajectory.amplitude": (0.15, 0.15, 0.3), "trajectory.phase": (0.0, 1.5, 0.7)}
"""A path that is fast where it accelerates most."""
SWING = 9.0
"""Frequency of a path near a soft beam's mode, Hz."""
PRESSING = 30.0
"""Compression of a beam, N."""
FAR = (1.0, 1.0, 0.4)
"""A pose beyond the reach of the left arm, and with -x of the right one, m, m, rad."""
PRESSED = {
    "controller.wanted_internal_force": 15.0,
    "payload.bending_stiffness": 1.2,
    "gravity": 9.81,
    "trajectory.amplitude": (0.2, 0.2, 0.7),
    "trajectory.frequency": (1.0, 1.0, 4.0),
    "trajectory.smooth_start": 0.3,
    "initial.pose_rate": None,
}
"""A soft beam that is pressed, turned fast and bent."""


@subject("Sentences on a run", 21)
def sentences(runs: Runs) -> Iterator[Check]:
    """Ring, start and error of the paper's run, error of PD, a wrong payload, weight and load share."""
    yield from sampled_sentences(runs)
    yield from _of_the_papers_run(runs.paper)
    yield from _in_lessons(runs.paper)
    yield from _out_of_reach()
    yield from _stopped()
    yield from _near_a_resonance()
    yield from _pressed()
    yield from _grows()
    yield from _drifts()
    paper = load_preset("paper")
    points, instants = MassPoints(paper), np.arange(32) / 32
    law = {"kind": "pd", "position_gain": SPRING}
    told = _told({"controller": law, **ROUND}, r"the motion's inertia, ([\d.]+) N")
    forces = []
    for x, v, change in zip(*desired(instants, paper.replace(ROUND).trajectory), strict=True):
        terms = [points.arm_terms(x, v, arm) for arm in range(2)]
        forces.append(
            (sum((M for M, _, _ in terms), points.rigid_inertia(x)) @ change + sum(C for _, C, _ in terms) @ v)[:2]
        )
    exact = max(np.linalg.norm(force) for force in forces)
    yield close("pd: force that the motion's inertia needs, B ẍ_d + C̄ ẋ_d", exact, told, "N", DIGITS)
    law = {"kind": "sliding-mode", "bound": 8.0, "model": BELIEVED}
    payload = points.payload_inertia(np.zeros(3 + points.shapes(0.0).size))[:3, :3]
    changes = {
        "payload.linear_density": RHO * BELIEVED["linear_density_factor"],
        "payload.length": LENGTH * BELIEVED["length_factor"],
    }
    believed = MassPoints(paper.replace(changes))
    along = zip(*desired(instants, paper.trajectory), strict=True)
    exact = max(np.linalg.norm((believed.rigid_inertia(x) - payload) @ change) for x, _, change in along)
    told = _told({"controller": law}, r"to the feedback grows from [\d.]+ N to ([\d.]+) N")
    yield close(
        "a wrong payload: force that it leaves to the feedback, (B_believed - B_rigid) ẍ_d", exact, told, "N", DIGITS
    )
    held = {
        "trajectory": {"kind": "hold", "pose": (0.0, 0.75, TILT)},
        "gravity": 9.81,
        "payload.bending_stiffness": SOFT,
    }
    said = _said(held | {"controller": {"kind": "pd", "load_share": SHARE}})
    exact = 5e3 * RHO * 9.81 * LENGTH**4 * np.cos(TILT) / (384 * SOFT)
    yield close(
        "the weight bends a tilted beam by 5ρgL⁴ cos θ/(384 EI)",
        exact,
        _number(said, r"beam by ([\d.]+) mm"),
        "mm",
        DIGITS,
    )
    exact = (SHARE - 0.5) * 9.81 * RHO * LENGTH
    yield close("a load share α presses with (α - ½) m g", exact, _number(said, r"and ([\d.]+) N of it"), "N", DIGITS)


def _of_the_papers_run(run: Run) -> Iterator[Check]:
    said = _sentences(run.take(slice(0, 3001)), run.scenario)
    points = MassPoints(run.scenario)
    first = loop_pole(points)
    statement = "the paper's run: its ring is that of its loop's pole: frequency"
    yield close(statement, abs(first.imag) / (2 * np.pi), _number(said, r"rings at ([\d.]+) Hz"), "Hz", 0.01)
    rate = _number(said, r"as it fades at ([\d.]+) 1/s")
    yield close("and rate", -first.real, rate, "1/s", 0.12)
    yield close("to 1 % in ln 100 over it", np.log(100) / rate, _number(said, r"to 1 % in ([\d.]+) s"), "s", 0.01)
    V = eigh(points.bending, points.payload_inertia(np.zeros(3 + points.shapes(0.0).size))[3:, 3:])[1][:, 0]
    told = _number(said, r"held it would fade at ([\d.]+) 1/s")
    yield close("with its grips held it would fade at cVᵀV/2", DAMPING / 2 * V @ V, told, "1/s", DIGITS)
    told = Look(run.scenario, run, ()).loop_frequency
    yield close(
        "frequency of the loop in lessons is that of this pole", abs(first.imag) / (2 * np.pi), told, "Hz", 1e-6
    )
    wave = 2e-3 * np.sin(2 * np.pi * 7 * run.time + 0.3)
    frequency, size = strongest_line(wave, PERIOD, 1 << 15)
    yield alike(
        "spectrum of a sine: its frequency and amplitude: relative error", 0.005, [frequency, 1e3 * size], [7.0, 2.0]
    )
    told = _number(said, r"velocity that is wrong by ([\d.]+) m/s")
    yield close("its start is wrong by 0.2·2π √2", 0.4 * np.pi * 2**0.5, told, "m/s", DIGITS)


def _out_of_reach() -> Iterator[Check]:
    """What is said of a pose that an arm cannot take."""
    scenario, (x, y, turn) = load_preset("paper").replace(UNEQUAL), FAR
    for arm, side, name in zip(scenario.arms, (-1, 1), ("left", "right"), strict=True):
        place = np.array([x, y]) * [-side, 1]
        fault = pose_fault(scenario, np.array([*place, turn]), 0.0, "the pose")
        said = "" if fault is None else fault.text
        wrist = place + side * (LENGTH / 2 + arm.link_length[2]) * np.array([np.cos(turn), np.sin(turn)]) - arm.base
        away, most = float(np.linalg.norm(wrist)), sum(arm.link_length[:2])
        told = _number(said, rf"The {name} arm .* would be ([\d.]+) m from its base")
        yield close(f"a pose that the {name} arm cannot take: distance of its wrist", away, told, "m", absolute=6e-4)
        told = _number(said, r"([\d.]+) m beyond")
        yield close("and how far that is beyond its links", away - most, told, "m", absolute=6e-4)


def _stopped() -> Iterator[Check]:
    """What is said of an arm that leaves its workspace, without motors."""
    drift = {**UNEQUAL, "controller.kind": "none", "initial.pose_rate": (0.5, 2.0, 0.3)}
    run = simulate(load_preset("paper").replace(drift), 0.5, PERIOD)
    (x, y, turn), arm = run.pose[-1], run.scenario.arms[1]
    wrist = np.array([x, y]) + (LENGTH / 2 + arm.link_length[2]) * np.array([np.cos(turn), np.sin(turn)]) - arm.base
    for words, exact, pattern in (
        ("distance of its wrist", float(np.linalg.norm(wrist)), r"The right arm .* wrist is ([\d.]+) m from its base"),
        ("what its links span", sum(arm.link_length[:2]), r"\(up to ([\d.]+) m\)"),
    ):
        told = _number(run.status.text, pattern)
        yield close(f"an arm that leaves its workspace: {words}", exact, told, "m", absolute=6e-4)


def _in_lessons(run: Run) -> Iterator[Check]:
    """Measures of lessons, from made-up signals."""
    slope = np.array([[1.0, -2.0, 3.0], [0.5, -7.0, 4.0]])
    made = run.having(
        axial_load=np.full_like(run.axial_load, -PRESSING), joint_torque=np.multiply.outer(run.time, slope)
    )
    squeeze = Look(run.scenario, made, ()).value("squeeze")
    yield close("lessons: squeeze of a beam in which N = -30 N", PRESSING, squeeze, "N", relative=1e-9)
    jump = torque_jump(torque_turns(made, 4 * PERIOD))
    yield close("lessons: change of a torque of 7 N·m/s over 4 ms", 0.028, jump, "N·m", relative=1e-9)


def _near_a_resonance() -> Iterator[Check]:
    """What is said of a path near a resonance."""
    swing = {
        "trajectory.amplitude": (0.0, 1e-3, 0.0),
        "trajectory.frequency": (SWING,) * 3,
        "trajectory.smooth_start": 0.3,
        "payload.bending_stiffness": SOFT,
        "initial.pose_rate": None,
    }
    said = _said(swing, 1.6)
    pole = loop_pole(MassPoints(load_preset("paper").replace(swing)))
    r, zeta = 2 * np.pi * SWING / abs(pole.imag), -pole.real / abs(pole)
    for words, exact, pattern in (
        ("its frequency over that of the loop's pole", r, r"Hz are ([\d.]+) times mode 1"),
        ("its resonance, 1/√((1 - r²)² + (2ζr)²)", 1 / np.hypot(1 - r * r, 2 * zeta * r), r"mode: ([\d.]+) times"),
    ):
        yield close(f"a path near a resonance: {words}", exact, _number(said, pattern), "", 0.01)


def _pressed() -> Iterator[Check]:
    """What is said of a beam that is pressed, spun and bent."""
    run = run_of("the pressed run", PRESSED, 0.6, PERIOD)
    critical = np.pi**2 * PRESSED["payload.bending_stiffness"] / LENGTH**2
    for words, exact, pattern, unit in (
        ("compression", run.axial_load_share.max() * critical, r"pressed with up to ([\d.]+) N", "N"),
        ("compression over P_cr", 100 * run.axial_load_share.max(), r"([\d.]+) % of its buckling load", "%"),
        ("stiffness taken by the spin", 100 * run.spin_share.max(), r"took up to ([\d.]+) % of the beam", "%"),
        ("deflection over length", 100 * _largest_bend(run), r"\|w\|/L was up to ([\d.]+) %", "%"),
    ):
        yield close(
            f"a beam that is pressed, spun and bent: {words}", exact, _number(run.status.text, pattern), unit, 0.02
        )


def _largest_bend(run: Run) -> float:
    """Largest deflection at the middle, which is a node, over the length."""
    return float(np.abs(run.midspan_deflection).max() / LENGTH)


def _grows() -> Iterator[Check]:
    """What is said of a loop that is nearly unstable, and of late rate feedback that feeds the 400 Hz mode."""
    fine = {"payload.element_count": 8, "payload.damping.coefficient": 0.0}
    law = {"kind": "vibration-damping", "control_period": PERIOD, "input_delay": 1}
    run = run_of("the run that grows", {**fine, "controller": law}, 0.3, PERIOD)
    said = _sentences(run, run.scenario)
    late = 1.5 * PERIOD
    law = {"control_period": 2 * PERIOD, "input_delay": 3}
    nearly = _said({f"controller.{name}": value for name, value in law.items()})
    angle, frequency = _number(nearly, r"or ±([\d.]+)°"), _number(nearly, r"unstable at ([\d.]+) Hz")
    told = _number(nearly, r"which is ([\d.]+) ms there")
    yield close("a small phase margin at its frequency, as a time", 1e3 * angle / 360 / frequency, told, "ms", 0.01)
    for words, exact, pattern, unit in (
        ("rate", GROWTH, r"grows at ([\d.]+) 1/s", "1/s"),
        (
            "frequency from which on modes are fed, 1/(4 · 1.5 T_c)",
            1 / (4 * late),
            r"feeds modes from ([\d.]+) Hz",
            "Hz",
        ),
        ("damping ratio that ends it", 100 * GROWTH / (2 * np.pi * 400), r"larger by ([\d.]+) percentage", "%"),
        ("control period that ends it", 1e3 / (6 * 400), r"control period below ([\d.]+) ms", "ms"),
    ):
        yield close(f"late rate feedback feeds a mode: {words}", exact, _number(said, pattern), unit, 0.01)


def _drifts() -> Iterator[Check]:
    """What is said of estimates that noise drives, and what is taken for granted of a payload that has been filled."""
    noise = {"controller.control_period": PERIOD, "controller.sensor_noise.pose_rate": (0.01, 0.01, 0.01), **STILL}
    run = run_of("the noisy run", noise, 3.0, PERIOD)
    said, (before, now) = _sentences(run, run.scenario), run.bound_estimates[[-1001, -1], 0]
    told = _number(said, r"N grows by ([\d.]+) N each second")
    yield close("estimates that noise drives grow by, in a second", now - before, told, "N/s", DIGITS)
    told = _number(said, r"σ = ([\d.]+) 1/s would hold")
    yield close("and leakage that would hold them, ḃ_0/b̂_0", (now - before) / now, told, "1/s", DIGITS)
    changes = {"payload.damping": {"kind": "modal", "ratio": 0.1}, "payload.mass_change.factor": 3.0}
    emptier = load_preset("paper").replace(changes)
    heavier = filled(emptier)
    fading = (
        [np.nan] * 2
        if heavier is None
        else [each.damping_ratio[0] * each.frequency[0] for each in map(modes, (emptier, heavier))]
    )
    yield close(
        "a beam that is filled to three times its mass fades at a third of the rate",
        1 / 3,
        fading[1] / fading[0],
        "",
        1e-9,
    )


def _told(changes: dict[str, Any], pattern: str) -> float:
    return _number(_said(changes), pattern)


def _said(changes: dict[str, Any], duration: float = 2.0) -> str:
    """The sentences on the paper's system with changes, after a duration, s."""
    run = run_of("the explained run", changes, duration, PERIOD)
    return _sentences(run, run.scenario)


def _sentences(samples: Samples, scenario: Scenario) -> str:
    return " ".join(each.sentence for each in explain_run(samples, scenario))


def _number(said: str, pattern: str) -> float:
    """The number in sentences that a pattern, with it as a group, finds; NaN if there is none."""
    found = re.findall(pattern, said)
    return float(found[0]) if found else np.nan
