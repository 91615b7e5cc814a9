"""The numbers in sentences that explain a run, with three digits, each by a closed form or from mass points."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import eigh

from flexlab.analysis.explanations.explanation import explain_run
from flexlab.analysis.validation.beam import LENGTH, RHO
from flexlab.analysis.validation.check import DAMPING, PERIOD, Check, Runs, close, run_of, subject
from flexlab.analysis.validation.mass_points import MassPoints
from flexlab.analysis.validation.paper import desired, loop_pole
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Run, Samples

DIGITS = 0.006
"""Relative error of a number with three digits."""
SOFT, TILT, SHARE = 10.0, 0.4, 0.7
"""Bending stiffness of a beam that its weight bends, N·m²; angle at which it is held, rad; the left arm's share of it."""
SPRING, BELIEVED = 2e4, {"linear_density_factor": 3.0, "length_factor": 1.1}
"""Position gain, N/m, of a law that knows no inertia; and a wrong model of the payload."""

ROUND = {"trajectory.amplitude": (0.15, 0.15, 0.3), "trajectory.phase": (0.0, 1.5, 0.7)}
"""A path that is fast where it accelerates most."""


@subject("Sentences on a run", 21)
def sentences(runs: Runs) -> Iterator[Check]:
    """Ring, start and error of the paper's run, error of PD, a wrong payload, weight and load share."""
    yield from _of_the_papers_run(runs.paper)
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
    told = _number(said, r"velocity that is wrong by ([\d.]+) m/s")
    yield close("its start is wrong by 0.2·2π √2", 0.4 * np.pi * 2**0.5, told, "m/s", DIGITS)


def _told(changes: dict[str, Any], pattern: str) -> float:
    return _number(_said(changes), pattern)


def _said(changes: dict[str, Any]) -> str:
    """The sentences on 3 s of the paper's system with changes."""
    run = run_of("the explained run", changes, 3.0, PERIOD)
    return _sentences(run, run.scenario)


def _sentences(samples: Samples, scenario: Scenario) -> str:
    return " ".join(each.sentence for each in explain_run(samples, scenario))


def _number(said: str, pattern: str) -> float:
    """The number in sentences that a pattern, with it as a group, finds; NaN if there is none."""
    found = re.findall(pattern, said)
    return float(found[0]) if found else np.nan
