"""The paper: its statements on Section IV, its law and internal force computed from mass points, and both theorems."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from flexlab.analysis.lesson_measures import bound_terms
from flexlab.analysis.metrics.vibration import settling_time
from flexlab.analysis.paper_equations import internal_force_eq_26, tracking_energy
from flexlab.analysis.validation.check import CENTER, FINE, PERIOD, Check, Runs, above, alike, below, close, subject
from flexlab.analysis.validation.mass_points import MassPoints, christoffel, linear_plant, time_derivative
from flexlab.sim.samples import Run

REFERENCE_TOLERANCE = 5e-4
"""Relative tolerance: the numbers of an independent solution of the same model have four digits."""


@subject("Section IV again", 0)
def section_iv(runs: Runs) -> Iterator[Check]:
    """The paper's statements on its simulation, then the numbers of an independent solution."""
    run = runs.paper
    late = np.abs(run.tracking_error[_rows(1, 6)])
    statement = "“The trajectory tracks the planning trajectory quickly”: error x, y from 1 s on"
    yield below(statement, 1.0, 1e3 * late[:, :2].max(), "mm")
    yield below("the same: error θ from 1 s on", 0.1, 1e3 * late[:, 2].max(), "mrad")
    gone = settling_time(run.time, run.vibration)
    statement = "“At about t = 0.5 s the original vibration disappears”: below 1 % of its peak after"
    yield close(statement, 0.5, gone, "s", absolute=0.1)
    frequency, amplitude = spectrum(run.vibration[_rows(0.05, 0.45)][:-1])
    ring = float(frequency[10 + np.argmax(amplitude[10:])])
    statement = "it rings with “the physical characteristic of the flexible payload”: first mode"
    yield close(statement, 44.4288, ring, "Hz", relative=0.08)
    frequency, amplitude = spectrum(run.midspan_deflection[_rows(2, 6)][:-1])
    compelled = float(frequency[1 + np.argmax(amplitude[1:])])
    statement = "“then the vibration is compelled by the rigid motion”: its frequency after 2 s"
    yield close(statement, 1.0, compelled, "Hz", absolute=1e-9)
    share = float(np.abs(run.vibration[_rows(1, 6)]).max() / np.abs(run.midspan_deflection[_rows(1, 6)]).max())
    yield below("and the beam bends quasi-statically: what else there is of its deflection", 5e-3, share)
    window = np.hanning(300)[:, None]
    fast = []
    for signal in (run.internal_force[:, 0], run.pose):
        part = signal[_rows(0.03, 0.33)][:300]
        frequency, amplitude = spectrum((part - part.mean(axis=0)) * window)
        fast.append(float((amplitude[frequency > 20].max(axis=0) / amplitude.max(axis=0)).max()))
    statement = "“the effect of vibration to internal force is more distinct than to rigid position”: by a factor of"
    yield above(statement, 30, fast[0] / fast[1])
    yield from _numbers(runs)


def _rows(start: float, stop: float) -> slice:
    return slice(round(start / PERIOD), round(stop / PERIOD) + 1)


def spectrum(signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and amplitudes of a signal that lasts a whole number of periods."""
    return np.fft.rfftfreq(len(signal), PERIOD), np.abs(np.fft.rfft(signal, axis=0)) * 2 / len(signal)


def _numbers(runs: Runs) -> Iterator[Check]:
    run = runs.paper
    wanted = {
        "largest error over 0 to 0.1 s": (_rows(0, 0.1), (1.674e-2, 1.704e-2, 7.005e-3)),
        "largest error over 2 to 3 s": (_rows(2, 3), (1.409e-4, 7.094e-4, 4.090e-5)),
    }
    for words, (rows, values) in wanted.items():
        found = np.abs(run.tracking_error[rows]).max(axis=0)
        for name, unit, value, here in zip("xyθ", ("m", "m", "rad"), values, found, strict=True):
            yield close(f"{words}, {name}", value, here, unit, relative=REFERENCE_TOLERANCE)
    for words, rows, value in (("0 to 0.1 s", _rows(0, 0.1), 1.770e-3), ("1 to 2 s", _rows(1, 2), 1.519e-4)):
        found = float(np.abs(run.midspan_deflection[rows]).max())
        yield close(f"largest deflection at mid-span over {words}", value, found, "m", relative=REFERENCE_TOLERANCE)
    force, torque = run.internal_force[0, 0], run.joint_torque[0, 0]
    for words, found, values, units in (
        ("internal force", force, (-48.368, 306.939, 50.920), ("N", "N", "N·m")),
        ("joint torque", torque, (-638.890, 284.855, 200.605), ("N·m",) * 3),
    ):
        for part, unit, value, here in zip("123", units, values, found, strict=True):
            yield close(f"{words} of the left arm at t = 0, part {part}", value, here, unit, absolute=5e-4)
    learnt = run.bound_estimates[round(3 / PERIOD)]
    for j, value in enumerate((0.02539, 0.02095, 0.06735)):
        yield close(f"bound estimate b̂{j} at t = 3 s", value, learnt[j], absolute=5e-6)


LAW_EVERY = 60
"""Every 60th sample of the fine runs is compared."""
GAIN, SLOPE, LAYER, ADAPTATION = 200.0, 50.0, 0.1, 10.0
"""K, Λ, ε and k_j of Section IV."""


def desired(t: np.ndarray, path: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x_d, ẋ_d, ẍ_d of a sine such as that of Section IV, (N, 3) each."""
    w, size = 2 * np.pi * np.array(path.frequency), np.array(path.amplitude)
    angle = np.multiply.outer(t, w) + path.phase
    return np.array(path.center) + size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle)


def paper_law(points: MassPoints, run: Run, k: int, b_hat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """u_i (2, 3) and the rate of b̂ (3,) of Eqs. (23), (25) at sample k."""
    x, v, payload = run.pose[k], run.pose_rate[k], run.scenario.payload
    goal, rate, acceleration = (part[0] for part in desired(run.time[k : k + 1], run.scenario.trajectory))
    r, r_dot = rate - SLOPE * (x - goal), acceleration - SLOPE * (v - rate)
    s = v - r
    size, growth = np.linalg.norm(s), bound_terms(x, v)
    weight = np.array([0.0, payload.linear_density * payload.length * points.gravity, 0.0])
    common = points.rigid_inertia(x) @ r_dot + weight - GAIN * s - b_hat @ growth * s / max(size, LAYER)
    terms = [points.arm_terms(x, v, arm) for arm in range(2)]
    return np.array([M @ r_dot + C @ r + G + common / 2 for M, C, G in terms]), size * growth / ADAPTATION


def loop_pole(points: MassPoints) -> complex:
    """The pole of the beam's first mode under the paper's law with b̂ = 0 at the middle of its path, 1/s."""
    (M, _, A), x = linear_plant(points), np.array(CENTER)
    B = sum((points.arm_inertia(x, arm) for arm in range(2)), points.rigid_inertia(x))
    by_pose, by_rate = GAIN * SLOPE * np.eye(3), GAIN * np.eye(3) + SLOPE * B
    n = len(M)
    A[n:, :3] -= np.linalg.inv(M)[:, :3] @ by_pose
    A[n:, n : n + 3] -= np.linalg.inv(M)[:, :3] @ by_rate
    poles = np.linalg.eigvals(A)
    return complex(poles[np.argmin(np.abs(poles.imag - points.softest() ** 0.5))])


@subject("Control law and internal force", 3)
def control_law(runs: Runs) -> Iterator[Check]:
    """Eqs. (23), (25) and (13)-(15), (26) from mass points, for the paper's boundary and for one without symmetry."""
    for run in (runs.general_pinned, runs.general):
        for check in _of(run):
            yield replace(check, statement=f"{run.scenario.payload.boundary}: {check.statement}")


def _of(run: Run) -> Iterator[Check]:
    """Error, sliding variable, adaptation, inputs arm by arm, and the internal force by both routes."""
    points = MassPoints(run.scenario)
    goal, goal_rate, _ = desired(run.time, run.scenario.trajectory)
    e, e_dot = run.pose - goal, run.pose_rate - goal_rate
    s = e_dot + SLOPE * e
    yield below("e = x - x_d: largest error", 1e-12, run.tracking_error - e, "m")
    yield below("s = ẋ - r, r = ẋ_d - Λe: largest error", 1e-10, run.sliding_variable - s, "m/s")
    rates, size = time_derivative(run.bound_estimates, FINE), np.linalg.norm(s, axis=1)
    wanted = (size[:, None] * bound_terms(run.pose, run.pose_rate) / ADAPTATION)[2:-2]
    yield alike("b̂ adapts by ‖s‖/k0, ‖s‖‖x‖/k1, ‖s‖‖ẋ‖²/k2: relative error", 1e-6, rates, wanted)

    inputs, forces = [], []
    rows = range(0, len(run), LAW_EVERY)
    for k in rows:
        x, v, a = run.pose[k], run.pose_rate[k], run.pose_acceleration[k]
        inputs.append(paper_law(points, run, k, run.bound_estimates[k])[0])
        terms = [points.arm_terms(x, v, arm) for arm in range(2)]
        pushes = [u - M @ a - C @ v - G for u, (M, C, G) in zip(run.arm_input[k], terms, strict=True)]
        forces.append([push - sum(pushes) / 2 for push in pushes])
    found, u = run.internal_force[rows], run.arm_input
    yield alike("u_i of Eqs. (23), (25), arm by arm: relative error", 1e-7, inputs, u[rows], u)
    yield alike("internal force of Eqs. (13)-(15): error as a part of u", 1e-7, forces, found, u)
    by_eq_26 = internal_force_eq_26(run, LAW_EVERY)
    yield alike("internal force by Eq. (26), without ẍ: difference as a part of u", 1e-9, by_eq_26, found, u)
    yield alike("F_1 + F_2 = 0: sum as a part of u", 1e-12, run.internal_force.sum(axis=1), 0.0, u)


THEOREM_EVERY = 25
"""Every 25th sample of the run's first second is checked."""


@subject("Theorems 1 and 2 along the run", 5)
def theorems(runs: Runs) -> Iterator[Check]:
    """The assumptions of both theorems, and their conclusions."""
    run = runs.paper
    second = slice(round(1 / PERIOD), None)
    for words, signal in (("x", run.pose), ("ẋ", run.pose_rate), ("ẍ", run.pose_acceleration)):
        sizes = np.linalg.norm(signal, axis=1)
        later, first = float(sizes[second].max()), float(sizes[: second.start].max())
        yield below(f"Theorem 1 assumes {words} bounded: largest after 1 s, as a part of before", 1.01, later / first)
    for words, signal in (("q", run.beam_coordinates), ("q̇", run.beam_rates)):
        part = float((np.abs(signal[second]).max(axis=0) / np.abs(signal).max(axis=0)).max())
        yield below(f"Theorem 1: {words} stays bounded: largest after 1 s, as a part of all", 0.5, part)
        again = np.abs(signal[3000:5000] - signal[4000:6000]).max(axis=0) / np.abs(signal).max(axis=0)
        yield below(f"and {words} repeats itself every second from 3 s on: relative change", 1e-5, again.max())
    yield from _theorem_2(runs)


def _theorem_2(runs: Runs) -> Iterator[Check]:
    run, points = runs.paper, MassPoints(runs.paper.scenario)
    rows = np.arange(0, round(1 / PERIOD), THEOREM_EVERY)
    bound, stored = [], []
    for k in rows:
        x, v, a, s = run.pose[k], run.pose_rate[k], run.pose_acceleration[k], run.sliding_variable[k]

        def inertia(at: np.ndarray) -> np.ndarray:
            return points.rigid_inertia(at) + points.arm_inertia(at, 0) + points.arm_inertia(at, 1)

        M, C = inertia(x), christoffel(inertia, x, v)
        disturbance = M @ a + C @ v - run.arm_input[k].sum(axis=0)
        bound.append(np.linalg.norm(disturbance) / (1 + np.linalg.norm(x) + np.linalg.norm(v) ** 2))
        stored.append(0.5 * s @ M @ s)
    yield alike("½ sᵀM̄s as the lab draws it: relative error", 1e-9, tracking_energy(run.scenario, run)[rows], stored)
    yield below("Theorem 2 assumes ‖Ψ‖ ≤ b0 + b1‖x‖ + b2‖ẋ‖²: holds with equal b of", 1e3, max(bound), "N")
    learnt = np.diff(run.bound_estimates, axis=0)
    yield above("b̂ never falls: least change", -1e-15, learnt.min())
    size = np.linalg.norm(run.sliding_variable, axis=1)
    spent = float(GAIN * np.sum(size[: round(1 / PERIOD)] ** 2) * PERIOD)
    yield below("Theorem 2: ½ sᵀM̄s at 1 s, as a part of its start", 1e-3, stored[-1] / stored[0])
    rises = np.diff(stored)
    yield below("it falls all the way: largest rise, as a part of its start", 0.02, rises.max() / stored[0])
    statement = "∫ sᵀKs over the first second stays finite: as a part of the energy at the start"
    yield below(statement, 10.0, spent / float(stored[0]))
    late = float(size[round(2 / PERIOD) :].max() / size[0])
    yield below("s ends in a small neighbourhood of 0: largest after 2 s, as a part of its start", 0.05, late)
