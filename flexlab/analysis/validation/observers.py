"""Observers and the regulator in the sampled loop, each against an independent answer."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import eigh, expm, solve_discrete_are, solve_discrete_lyapunov

from flexlab.analysis.law_conditions import circumstances, law_conditions
from flexlab.analysis.modes import modes
from flexlab.analysis.validation.beam import GAUGES
from flexlab.analysis.validation.check import CENTER, STILL, Check, Runs, alike, below, close, run_of, subject
from flexlab.analysis.validation.mass_points import MassPoints, linear_plant, slopes
from flexlab.analysis.validation.sampled_loop import FINER, MEASURED, PERIOD, STRAIN, told_rates
from flexlab.control.observers.believed_plant import believed_plant
from flexlab.control.observers.kalman import POSE_FLOOR, RATE_FLOOR, KalmanObserver
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Run

BENT = (0.001, 0.00016, 0.0, -0.001)
"""Initial beam coordinates, half a sine of 0.16 mm, for which the linear model holds."""
SHAKING = {"kind": "sine", "center": CENTER, "amplitude": 1e-3, "frequency": 15.0}
"""A small motion that bends the beam, whose torques change from instant to instant."""
HEAVIER = 1.3
"""Mass of the payload that a law believes in, over the true one."""
TILTED = (0.0, 0.75, 0.6)
"""Pose of a beam that its arms let sink."""
COMPUTED = {"kind": "computed-torque", "position_gain": 900.0, "velocity_gain": 60.0}
LATE = 3
"""Input delay of the regulator on a path, control periods."""
BEGUN, CHANGED, ENDED = 6, 16, 24
"""Instants of a disturbance observer: its first, its first with other settings, and its last one."""


@subject("Observers and the regulator", 9)
def observers(_: Runs) -> Iterator[Check]:
    """The Kalman observer, the regulator with it, and the momentum observer."""
    # Arms that sink excite the beam by forces that the observer knows, even if it hardly trusts its gauges.
    trusting = {"unknown_force": (0.01, 0.01, 0.01), "unknown_modal_force": 1e-4}
    tilted = {"kind": "hold", "pose": TILTED}
    sinking = {"gravity": 0.5, "initial.beam_coordinates": None, "trajectory": tilted, "initial.pose": TILTED}
    statement = "the Kalman observer predicts hᵀq̇ by the delay and half a period, to where its torque acts"
    yield below(f"{statement}: relative error", 0.02, _observed("the observed run", {}, {}))
    statement = "one that trusts its model more than its gauges predicts the ring of a tilted beam whose arms sink"
    yield below(f"{statement}: relative error", 0.02, _observed("the run of sinking arms", trusting, sinking))
    driven = {"trajectory": SHAKING, "initial.beam_coordinates": None, "initial.pose_rate": None}
    statement = "one beside computed torque, whose new torques act within its horizon, on a path that shakes the beam"
    yield below(f"{statement}: relative error", 0.02, _observed("the shaken run", {}, driven, COMPUTED))
    yield from _regulator()
    yield from _observer_noise()
    yield from _believed_beam()
    yield from _believed_load()
    yield from _disturbance_observer()
    law = {"kind": "disturbance-observer", "observer_gain": 60.0, "control_period": PERIOD}
    poles = modes(load_preset("paper").replace({"trajectory": {"kind": "hold"}, "controller": law})).poles
    rate = np.log(1 - 60.0 * PERIOD) / PERIOD
    slowed = poles.real[np.argmin(np.abs(poles - rate))]
    yield close("a sampled momentum observer forgets by 1 - ℓT_c in a period: rate", rate, slowed, "1/s", 1e-6)


def _held(name: str, law: dict[str, Any], **changes: Any) -> Run:
    """A sampled run, one period late, at a constant desired pose with a bent beam; `changes`: further changes."""
    controller = {"control_period": PERIOD, "input_delay": 1, **law}
    bent = {**STILL, "initial.beam_coordinates": BENT, **changes, "controller": controller}
    return run_of(name, bent, 0.06, PERIOD / FINER)


def _observed(
    name: str, observer: dict[str, Any], changes: dict[str, Any], slow: dict[str, Any] | None = None
) -> float:
    """Largest error of the predicted hᵀq̇ over its largest value; `slow`: computed torque beside it, or None."""
    gain = 20.0
    law = {"kind": "composite", "slow": slow or {"kind": "none"}, "lateral_vibration_gain": gain}
    law["observer"] = {"kind": "kalman", "observer_modes": 4, **observer}
    run = _held(name, law, **changes)
    points = MassPoints(run.scenario)
    h = points.payload_inertia(np.zeros(3 + run.beam_rates.shape[1]))[1, 3:]
    center = np.array(run.scenario.trajectory.middle)
    inertia = sum(points.arm_inertia(center, arm) for arm in range(2))
    across = np.array([-np.sin(center[2]), np.cos(center[2]), 0.0])
    rate = run.beam_rates @ h
    # Torques of instant k are held from instant k + 1 on.
    acting = np.arange(30, 58) * FINER + FINER // 2
    asked = run.arm_input.sum(axis=1)[acting]
    if slow is not None:
        asked = asked - [_computed_torque(points, run, k, slow) for k in acting - FINER - FINER // 2]
    told = across @ np.linalg.solve(inertia, asked.T) / gain
    return float(np.abs(told - rate[acting]).max() / np.abs(rate[acting]).max())


def _computed_torque(points: MassPoints, run: Run, k: int, law: dict[str, Any]) -> np.ndarray:
    """Σu_i (3,) of computed torque on the path `SHAKING` at sample k."""
    x, v = run.pose[k], run.pose_rate[k]
    target, rate, acceleration = _sine(run.time[k], SHAKING)
    terms = [points.arm_terms(x, v, arm) for arm in range(2)]
    inertia = sum((M for M, _, _ in terms), points.rigid_inertia(x))
    wanted = acceleration - law["velocity_gain"] * (v - rate) - law["position_gain"] * (x - target)
    return inertia @ wanted + sum(C for _, C, _ in terms) @ v


def held_over(A: np.ndarray, B: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """State and input matrix over `period` s of dz/dt = A z + B f with f held."""
    n, inputs = B.shape
    over = expm(period * np.block([[A, B], [np.zeros((inputs, n + inputs))]]))
    return over[:n, :n], over[:n, n:]


def _regulator_gain(scenario: Scenario) -> tuple[np.ndarray, float]:
    """K (3, 2n) in nodal coordinates, and how fast its loop decays, 1/s, by scipy's Riccati solver."""
    settings = scenario.controller
    M, K, A = linear_plant(MassPoints(scenario))
    n, beam = len(M), np.s_[3:]
    Phi, Gamma = held_over(A, np.vstack([np.zeros((n, 3)), np.linalg.inv(M)[:, :3]]), PERIOD)
    Q = np.zeros((2 * n, 2 * n))
    Q[:3, :3], Q[n : n + 3, n : n + 3] = np.diag(settings.pose_weight), np.diag(settings.pose_rate_weight)
    Q[beam, beam][: n - 3, : n - 3] = settings.vibration_weight * K[beam, beam]
    Q[n + 3 :, n + 3 :] = settings.vibration_weight * M[beam, beam]
    R = np.diag(settings.force_weight)
    P = solve_discrete_are(Phi, Gamma, Q, R)
    gain = np.linalg.solve(R + Gamma.T @ P @ Gamma, Gamma.T @ P @ Phi)
    return gain, -np.log(np.abs(np.linalg.eigvals(Phi - Gamma @ gain)).max()) / PERIOD


def _regulator() -> Iterator[Check]:
    """K from matrices of mass points in nodal coordinates, and the target d periods ahead."""
    law = {"kind": "lqr", "observer": {"kind": "kalman", "observer_modes": 4}}
    run = _held("the regulated run", law)
    gain, decay = _regulator_gain(run.scenario)
    state = np.hstack([run.pose - CENTER, run.beam_coordinates, run.pose_rate, run.beam_rates])
    acting = np.arange(30, 58) * FINER
    wanted, found = -state[acting] @ gain.T, run.arm_input.sum(axis=1)[acting + 1]
    statement = "lqr asks for -K z of its own Riccati equation, z as it will be when the torques act: relative error"
    yield alike(statement, 0.02, found, wanted)
    yield from _farther(gain)
    said = " ".join(condition.sentence for condition in law_conditions(run.scenario))
    told = float(re.findall(r"decays with ([\d.]+) 1/s", said)[0])
    yield close("and its condition tells how fast the loop decays", decay, told, "1/s", 0.01)
    M, n = (
        MassPoints(run.scenario).inertia(np.array([*CENTER, *np.zeros(gain.shape[1] // 2 - 3)]))[:3, :3],
        gain.shape[1] // 2,
    )
    fading, ringing = (np.linalg.norm(np.linalg.solve(M, gain[:, at : at + 3]), 2) for at in (n, 0))
    told = circumstances(run.scenario).fastest_rate
    yield close("lqr: fastest rate of its loop", fading + np.sqrt(ringing), told, "1/s", 1e-3)
    path = {"kind": "sine", "center": CENTER, "amplitude": 0.005, "frequency": 3.0}
    late = {**law, "control_period": PERIOD, "input_delay": LATE}
    run = run_of("the regulated run on a path", {"trajectory": path, "controller": late}, 0.06, PERIOD / FINER)
    points, wanted = MassPoints(run.scenario), []
    for k in range(30 * FINER, 55 * FINER, FINER):
        x, acting = run.pose[k], k + LATE * FINER
        _, rate, acceleration = _sine(run.time[k], path)
        terms = [points.arm_terms(x, run.pose_rate[k], arm) for arm in range(2)]
        inertia = sum((M for M, _, _ in terms), points.rigid_inertia(x))
        target, target_rate, _ = _sine(run.time[acting], path)
        error, error_rate = run.pose[acting] - target, run.pose_rate[acting] - target_rate
        state = np.concatenate([error, run.beam_coordinates[acting], error_rate, run.beam_rates[acting]])
        wanted.append(inertia @ acceleration + sum(C for _, C, _ in terms) @ rate - gain @ state)
    found = run.arm_input.sum(axis=1)[np.arange(30, 55) * FINER + LATE * FINER + 1]
    yield alike(f"on a path it aims at the target {LATE} periods ahead: relative error", 0.02, found, wanted)


def _farther(gain: np.ndarray) -> Iterator[Check]:
    """A regulator that predicts two periods more than its torques are late, over which it foresees no force."""
    law = {"kind": "lqr", "observer": {"kind": "kalman", "observer_modes": 4, "horizon": 3}}
    run = _held("the farsighted run", law)
    _, _, A = linear_plant(MassPoints(run.scenario))
    state = np.hstack([run.pose - CENTER, run.beam_coordinates, run.pose_rate, run.beam_rates])
    acting = np.arange(30, 58) * FINER
    wanted = -state[acting] @ (gain @ expm(2 * PERIOD * A)).T
    statement = "one that looks two periods farther asks for -K z as it will be then without a force: relative error"
    yield alike(statement, 0.02, run.arm_input.sum(axis=1)[acting + 1], wanted)


def _sine(t: float, path: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x_d, ẋ_d, ẍ_d (3,) of a sine with one amplitude and one frequency for all coordinates."""
    omega, ones = 2 * np.pi * path["frequency"], path["amplitude"] * np.ones(3)
    sine, cosine = np.sin(omega * t), np.cos(omega * t)
    return path["center"] + sine * ones, omega * cosine * ones, -(omega**2) * sine * ones


def _observer_noise() -> Iterator[Check]:
    """The deviation of a resting beam's predicted hᵀq̇, by the covariance of a filter that scipy's Riccati solver finds."""
    observer = {"kind": "kalman", "observer_modes": 4, "gauges": GAUGES}
    told = told_rates({"strain": STRAIN}, observer)[MEASURED // 10 :, 0]
    scenario = load_preset("paper").replace({"controller": {"kind": "composite", "control_period": PERIOD}})
    points, known = MassPoints(scenario), KalmanObserver()
    M, _, A = linear_plant(points)
    n = len(M)
    Phi, Gamma = held_over(A, np.vstack([np.zeros((n, n)), np.linalg.inv(M)]), PERIOD)
    unknown = np.zeros((n, n))
    unknown[:3, :3] = np.diag(np.square(known.unknown_force))
    unknown[3:, 3:] = known.unknown_modal_force**2 * M[3:, 3:]
    length, thickness = scenario.payload.length, scenario.payload.thickness
    C = np.zeros((6 + len(GAUGES), 2 * n))
    C[:3, :3], C[3:6, n : n + 3] = np.eye(3), np.eye(3)
    C[6:, 3:n] = -thickness / 2 * points.shapes(length * np.array(GAUGES), 2)
    R = np.diag(np.square([POSE_FLOOR] * 3 + [RATE_FLOOR] * 3 + [STRAIN] * len(GAUGES)))
    P = solve_discrete_are(Phi.T, C.T, Gamma @ unknown @ Gamma.T, R)
    gain = np.linalg.solve(C @ P @ C.T + R, C @ P).T
    read = STRAIN**2 * gain[:, 6:] @ gain[:, 6:].T
    covariance = solve_discrete_lyapunov(Phi - gain @ C @ Phi, read)
    rate = np.concatenate([np.zeros(n + 3), points.payload_inertia(np.zeros(n))[1, 3:]]) @ expm(A * PERIOD / 2)
    statement = "the Kalman observer reads gauges with their noise: deviation of its hᵀq̇"
    yield close(statement, np.sqrt(rate @ covariance @ rate), told.std(), "kg·m/s", 0.1)


def _disturbance_observer() -> Iterator[Check]:
    """d̂ of a law that begins between two instants, and whose ℓ and believed payload change between two others."""
    heavier, gains = 1.3, (60.0, 25.0)
    first = {"controller.kind": "disturbance-observer", "controller.observer_gain": gains[0]}
    then = {"controller.observer_gain": gains[1], "controller.model.linear_density_factor": heavier}
    commands = [(t * PERIOD, ChangeScenario(to)) for t, to in ((BEGUN - 0.5, first), (CHANGED - 0.5, then))]
    law = {"kind": "pd", "control_period": PERIOD}
    changes = {"gravity": 9.81, "initial.pose_rate": (0.3, -0.4, 0.5), "controller": law}
    run = run_of("the run with an observed disturbance", changes, (ENDED + 0.5) * PERIOD, PERIOD / FINER, commands)
    points = MassPoints(run.scenario)
    payload, gain, straight = points, gains[0], np.zeros(run.beam_rates.shape[1])

    def momentum(k: int) -> np.ndarray:
        """p = Bẋ at sample k, with the believed payload."""
        x = run.pose[k]
        return sum((points.arm_inertia(x, arm) for arm in range(2)), payload.rigid_inertia(x)) @ run.pose_rate[k]

    def momentum_later(k: int, after: float) -> np.ndarray:
        """p that the rigid model foresees `after` s from sample k, with the torques that are held then."""
        x, v = run.pose[k], run.pose_rate[k]
        rate = -slopes(lambda at: np.array(payload.payload_potential(np.concatenate([at, straight]))), x)
        for arm in range(2):
            J = slopes(lambda at, arm=arm: points.joint_angles(at, arm), x).T
            _, C, G = points.arm_terms(x, v, arm)
            rate += J.T @ run.joint_torque[k + 1, arm] + C.T @ v - G
        return momentum(k) + after * rate

    d_hat, wanted = np.zeros(3), []
    for instant in range(BEGUN, ENDED + 1):
        k, middle, last = (round((instant - back) * FINER) for back in (0, 0.5, 1))
        foreseen = momentum_later(middle if instant == BEGUN else last, PERIOD / (2 if instant == BEGUN else 1))
        if instant == CHANGED:
            d_hat = d_hat + gain * (momentum_later(middle, PERIOD / 2) - foreseen - PERIOD * d_hat)
            payload, gain = points.filled(heavier), gains[1]
            d_hat = d_hat + gain * (momentum(k) - momentum_later(middle, PERIOD / 2))
        else:
            d_hat = d_hat + gain * (momentum(k) - foreseen - PERIOD * d_hat)
        wanted.append(d_hat)
    found = run.disturbance_estimate[np.arange(BEGUN, ENDED + 1) * FINER + 1]
    statement = "d̂ follows from the momentum, even if the law begins or changes between two instants: relative error"
    yield alike(statement, 1e-6, found, wanted)


def _believed_beam() -> Iterator[Check]:
    """Frequencies, and strains at gauges, of the modes of a beam that a law takes to be longer, heavier and softer."""
    longer, heavier, softer = 1.2, 1.3, 0.7
    model = {"length_factor": longer, "linear_density_factor": heavier, "stiffness_factor": softer}
    scenario = load_preset("paper").replace({"controller": {"kind": "lqr", "control_period": PERIOD, "model": model}})
    told, true = believed_plant(scenario, 4, GAUGES), scenario.payload
    changes = {
        "payload.length": longer * true.length,
        "payload.linear_density": heavier * true.linear_density,
        "payload.bending_stiffness": softer * true.bending_stiffness,
    }
    points = MassPoints(load_preset("paper").replace(changes))
    square, V = eigh(points.bending, points.payload_inertia(np.zeros(3 + points.shapes(0.0).size))[3:, 3:])
    yield alike(
        "lqr: frequencies of a beam with another length, density and stiffness: relative error",
        1e-9,
        told.omega,
        square**0.5,
    )
    strain = true.thickness / 2 * points.shapes(longer * true.length * np.array(GAUGES), 2) @ V
    yield alike("and strains of its modes at the gauges: relative error", 1e-9, np.abs(told.strain), np.abs(strain))


def _believed_load() -> Iterator[Check]:
    """The axial-load stiffness in a linear law's model, compared with that of such a payload held at rest."""
    pressing = {"wanted_internal_force": 40.0, "load_share": 0.3}
    for words, preset, law in (
        ("stiffens its modes", "paper", pressing),
        ("of a hanging beam does so", "single-arm", {}),
    ):
        pose = (0.0, 0.75, 0.4)
        at_rest = {"payload.axial_load": "first-order", "gravity": 9.81, "initial.pose": None}
        at_rest |= {"trajectory": {"kind": "hold", "pose": pose}, "payload.bending_stiffness": 100.0}
        holding = {"kind": "computed-torque", "position_gain": 1e6, **law}
        model = {"linear_density_factor": HEAVIER, "axial_load": "first-order"}
        paper = load_preset(preset).replace(at_rest)
        held = modes(
            paper.replace({"controller": holding, "payload.linear_density": HEAVIER * paper.payload.linear_density})
        ).linearization
        assert held is not None
        believing = {"kind": "lqr", "control_period": PERIOD, "model": model, **law}
        told = believed_plant(paper.replace({"controller": believing}), len(held.omega), ())
        order = np.argsort(held.omega)
        wanted = held.probe.axial_stiffness(held.rest.motion, held.rest.torque)[np.ix_(order, order)]
        found = told.stiffness - np.diag(told.omega**2)
        error = np.abs(found - wanted).max() / np.abs(wanted).max()
        yield below(f"the axial load that lqr believes in {words} as at rest: relative error", 1e-3, error)
