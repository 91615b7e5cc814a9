"""The numbers that sentences on a run take from its samples, to their last digits, each by its definition in plain NumPy."""

import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexlab.analysis.explanations.explanation import explain_run
from flexlab.analysis.law_conditions import circumstances
from flexlab.analysis.validation.check import PERIOD, STILL, UNEQUAL, Check, Runs, below, run_of, true
from flexlab.analysis.validation.mass_points import MassPoints
from flexlab.analysis.validation.paper import GAIN, SLOPE, desired, loop_pole
from flexlab.sim.samples import Run

SECOND = slice(-1001, None)
"""The newest second of a run."""
STOP, LIMIT, SQUEEZE, CLOCK, LEAKAGE = 0.2, (300.0, 150.0, 60.0), 20.0, 0.02, 2.0
"""End of a motion, s; torque limits, N·m; wanted squeeze, N; control period, s; leakage, 1/s."""
DIGITS = "⁰¹²³⁴⁵⁶⁷⁸⁹"
MOVE = {"trajectory": {"kind": "rest-to-rest", "duration": STOP}, "payload.bending_stiffness": 5.0}


class _Sentence(NamedTuple):
    words: str
    """What it says, in the report."""
    changes: dict[str, Any]
    """Of the paper's system."""
    duration: float
    """s."""
    pattern: str
    """With a group for each number."""
    exact: Callable[[Run], Sequence[float]]
    """The numbers, as they should be."""


def _shaken(run: Run, rows: slice = slice(None)) -> float:
    """Largest vibration, mm."""
    return 1e3 * float(np.abs(run.vibration[rows]).max())


def _after(run: Run, time: float) -> slice:
    """The samples from a time on, s."""
    return slice(int(np.searchsorted(run.time, time - PERIOD / 2)), None)


def _rings_on(run: Run) -> list[float]:
    """Vibration after the stop, mm, and its share of the largest, %, and the delay of a zv shaper, ms."""
    left = _shaken(run, _after(run, STOP))
    return [left, 100 * left / _shaken(run), 1e3 * np.pi / abs(loop_pole(MassPoints(run.scenario)).imag)]


def _shaped(run: Run) -> list[float]:
    """Half a period of the loop's first mode, ms, the largest vibration and the largest after the stop, mm."""
    later = np.pi / abs(loop_pole(MassPoints(run.scenario)).imag)
    return [1e3 * later, _shaken(run), _shaken(run, _after(run, STOP + later))]


def _reaction(run: Run) -> list[float]:
    """Error, ‖Ψ‖ = ‖(Ā - A11) ẍ_d‖, K, Λ and ‖Ψ‖/(K Λ) of a bent beam under the paper's law."""
    points, (poses, _, changes) = MassPoints(run.scenario), desired(np.arange(32) / 32, run.scenario.trajectory)
    rigid = points.payload_inertia(np.zeros(3 + run.beam_rates.shape[1]))[:3, :3]
    force = max(
        float(np.linalg.norm((points.rigid_inertia(x) - rigid) @ a)) for x, a in zip(poses, changes, strict=True)
    )
    off = 1e3 * float(np.linalg.norm(run.tracking_error[SECOND, :2], axis=1).max())
    return [off, force, GAIN, SLOPE, 1e3 * force / (GAIN * SLOPE)]


def _limited(run: Run) -> list[float]:
    """Joint, its limit, share of the time at it, %, and error."""
    shares = np.mean(np.abs(run.joint_torque) >= np.array(LIMIT) * (1 - 1e-6), axis=0)
    joint = int(np.argmax(shares.max(axis=0)))
    return [joint + 1, LIMIT[joint], 100 * float(shares.max()), 1e3 * float(np.abs(run.tracking_error[:, :2]).max())]


def _squeezed(run: Run) -> list[float]:
    """Mean internal force of the left arm along the link, and the wanted one, N."""
    angle, (x, y) = run.pose[SECOND, 2], run.internal_force[SECOND, 0, :2].T
    return [float(np.mean(x * np.cos(angle) + y * np.sin(angle))), SQUEEZE]


def _runs_away(run: Run) -> list[float]:
    """λ, λT_c, its limit 2, and the largest T_c, ms."""
    rate = circumstances(run.scenario).fastest_rate
    return [rate, rate * CLOCK, 2.0, 2e3 / rate]


def _random(run: Run) -> list[float]:
    """RMS of a torque's changes, N·m, their correlation, less its sign, b̂_0, N, and σ b̂_0, N/s."""
    turns, estimate = np.diff(run.joint_torque[SECOND].reshape(-1, 6), axis=0), float(run.bound_estimates[-1, 0])
    likeness = np.sum(turns[1:] * turns[:-1]) / np.sum(turns**2)
    return [float(np.sqrt(np.mean(turns**2, axis=0)).max()), -likeness, estimate, LEAKAGE * estimate]


def _folded(run: Run) -> list[float]:
    """The elbow that comes closest to straight, °, 1/sin θ₂, and the largest torque of its arm, N·m."""
    sines = np.abs(np.sin(run.joint_angle[:, :, 1])).min(axis=0)
    return [
        np.degrees(np.arcsin(float(sines.min()))),
        1 / float(sines.min()),
        float(np.abs(run.joint_torque[:, int(np.argmin(sines))]).max()),
    ]


def _forced(run: Run) -> list[float]:
    """Vibration in the newest period of the path, this period, s, the loop's first frequency, Hz, and their product."""
    hertz = abs(loop_pole(MassPoints(run.scenario)).imag) / (2 * np.pi)
    return [_shaken(run, slice(-1000, None)), 1.0, hertz, hertz]


SENTENCES = (
    _Sentence("the paper's ring: its size", {}, 3.0, r"Hz by up to ([\d.]+) mm", lambda run: [_shaken(run)]),
    _Sentence("its start", {}, 3.0, r"bends the beam by ([\d.]+) mm", lambda run: [_shaken(run, slice(101))]),
    _Sentence(
        "its error, by the beam's reaction and the feedback",
        {},
        3.0,
        r"error of ([\d.]+) mm .* ([\d.]+) N divided by ([\d.]+) N·s/m and Λ = ([\d.]+) 1/s give ([\d.]+) mm",
        _reaction,
    ),
    _Sentence(
        "a ring after a stop, and its share of the largest",
        MOVE,
        0.9,
        r"rings on by ([\d.]+) mm, ([\d.]+) % .* ends the motion ([\d.]+) ms later",
        _rings_on,
    ),
    _Sentence(
        "a motion without a shaper's vibration",
        {**MOVE, "trajectory": {**MOVE["trajectory"], "shaper": "zv"}},
        0.9,
        r"ends the motion ([\d.]+) ms later; of a vibration of up to ([\d.]+) mm, ([\d.]+) mm",
        _shaped,
    ),
    _Sentence(
        "a torque at its limit",
        {"controller.torque_limit": LIMIT},
        0.3,
        r"Joint (\d) of .* limit of ([\d.]+) N·m for ([\d.]+) % .* error reaches ([\d.]+) mm",
        _limited,
    ),
    _Sentence(
        "a wanted squeeze",
        {"controller.wanted_internal_force": SQUEEZE},
        1.6,
        r"with ([\d.]+) N along the link because F_d = ([\d.]+) N",
        _squeezed,
    ),
    _Sentence(
        "a clock that is too slow",
        {"controller.control_period": CLOCK},
        0.1,
        r"feedback at ([\d.]+) 1/s .* λT_c = ([\d.]+) above ([\d.]+)\. A control period below ([\d.]+) ms",
        _runs_away,
    ),
    _Sentence(
        "noise in the torques, and estimates that leak",
        {
            "controller.control_period": PERIOD,
            "controller.leakage": LEAKAGE,
            "controller.sensor_noise.pose_rate": (0.01,) * 3,
            **STILL,
        },
        3.0,
        r"jump by ([\d.]+) N·m .* correlation −([\d.]+)\).* stands at ([\d.]+) N .* adds, ([\d.]+) N each second",
        _random,
    ),
    _Sentence(
        "an arm that is nearly stretched",
        {**UNEQUAL, "trajectory": {"kind": "hold", "pose": (0.05, 1.2, 0.1)}, "gravity": 9.81},
        0.2,
        r"comes within ([\d.]+)° .*sin θ₂ = ([\d.]+), and its torques reach ([\d.]+) N·m",
        _folded,
    ),
    _Sentence(
        "a forced vibration",
        {"payload.bending_stiffness": 1.27, "initial.pose_rate": None, "trajectory.smooth_start": 0.3},
        3.0,
        r"vibration of ([\d.]+) mm repeats with .* of ([\d.]+) s.* mode 1 \(([\d.]+) Hz\) is only ([\d.]+) times",
        _forced,
    ),
)


def sampled_sentences(runs: Runs) -> Iterator[Check]:
    """Each sentence on its run; several may be on the same one."""
    known: dict[str, tuple[Run, str]] = {}
    for words, changes, duration, pattern, exact in SENTENCES:
        if (key := f"{duration} {changes}") not in known:
            run = run_of("the explained run", changes, duration, PERIOD)
            known[key] = run, " ".join(each.sentence for each in explain_run(run, run.scenario))
        run, said = known[key]
        found, wanted = re.search(pattern, said), exact(run)
        told = found.groups() if found else ("nan",) * len(wanted)
        off = [
            (float(text) - value) * 10 ** len(text.partition(".")[2]) for text, value in zip(told, wanted, strict=True)
        ]
        yield below(f"{words}: difference, in units of the last digits that are told", 0.51, off)
    yield _accuracy(runs.paper)


def _accuracy(exact: Run) -> Check:
    """How far the paper's run in coarse steps is said to be off, beside how far it is."""
    coarse = {"simulation.integrator": "generalized-alpha", "simulation.step": 1e-4}
    run = run_of("the run in coarse steps", coarse, 1.0, PERIOD)
    said = re.search(r"pose may be off by (?:(\d) · )?10⁻(.) m .* force may be off by ([\d.]+) %", run.status.text)
    told = np.array([float(said[1] or 1) / 10.0 ** DIGITS.index(said[2]), float(said[3]) / 100] if said else [0.0, 0.0])
    force = exact.internal_force[: len(run)]
    off = [
        np.abs(run.pose - exact.pose[: len(run)]).max(),
        np.abs(run.internal_force - force).max() / np.abs(force).max(),
    ]
    return true(
        "errors of pose and force are at most those that a run tells, and a fifth at least",
        bool(np.all((told > off) & (told < np.multiply(5, off)))),
        f"{told / off} times as large",
    )
