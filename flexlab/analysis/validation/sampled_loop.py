"""The sampled loop: clock, delay, limits, noise and strain gauges, each against an independent answer."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexlab.analysis.modes import modes
from flexlab.analysis.validation.beam import GAUGES
from flexlab.analysis.validation.check import CENTER, STILL, Check, Runs, above, below, close, run_of, subject, true
from flexlab.analysis.validation.mass_points import MassPoints, slopes
from flexlab.analysis.validation.paper import paper_law
from flexlab.control.conditions import stability_limit
from flexlab.physics.sensors import strain_rows
from flexlab.presets import load_preset

PERIOD, DELAY = 1e-3, 2
"""T_c, s, and input delay in control periods."""
FINER = 4
"""Samples of a run per control period."""
LIMIT, LOWER = (300.0, 150.0, 60.0), (500.0, 400.0, 250.0)
"""Torque limits, N·m; under `LOWER` torques reach their lower limits alone, and all leave them within 10 ms."""
MEASURED = 2000
"""Control instants of a noisy run, which give the standard deviation to 1.6 %."""
SIGMA = (1e-4, 2e-4, 3e-4)
"""Standard deviation of the noise of x, y, θ, m, m, rad, and of their rates, per second."""
STRAIN = 1e-6
MOMENT_RATE = (2e-3, 3e-3)
"""Standard deviation of the noise of hᵀq̇, kg·m/s, and gᵀq̇, kg·m²/s."""
GROWTH = 2.65
"""Growth of the 400 Hz mode of 8 undamped elements under rate feedback k_v = 100 at 1 kHz, one sample late, 1/s."""


@subject("The sampled loop and its sensors", 8)
def sampled_loop(runs: Runs) -> Iterator[Check]:
    """The clock, torque limits, noise, gauges, the delay that a loop allows, sampled poles."""
    yield from _clock()
    yield from _limits()
    told: dict[str, np.ndarray] = {}
    yield from _noise(told)
    yield from _strain_noise(told)
    yield from _independent(told)
    yield from _gauges()
    for delay in (0, 1, 3):
        integrator, feedback = np.zeros((2, delay + 2))
        integrator[:2], feedback[-1] = (1.0, -1.0), stability_limit(delay)
        fastest, slower = (np.abs(np.roots(integrator + part * feedback)).max() for part in (1.0, 0.9))
        statement = f"the fastest loop that {delay} samples of delay allow neither grows nor decays: largest |z|"
        yield close(statement, 1.0, fastest, absolute=1e-9)
        yield below("and one that is slower by a tenth decays: largest |z|", 0.999, slower)
    changes = {
        "payload.element_count": 8,
        "payload.damping.coefficient": 0.0,
        "controller": {"kind": "vibration-damping", "control_period": PERIOD, "input_delay": 1},
    }
    poles = modes(load_preset("paper").replace(changes)).poles
    near = poles[np.abs(np.abs(poles.imag) / (2 * np.pi) - 400) < 5]
    yield close("rate feedback one sample late feeds the 400 Hz mode: rate", GROWTH, near.real.max(), "1/s", 0.005)


def joint_torques(points: MassPoints, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Joint torques (2, 3) of arm inputs (2, 3): u = 𝒥ᵀτ."""
    J = [slopes(lambda at, arm=arm: points.joint_angles(at, arm), x).T for arm in range(2)]
    return np.array([np.linalg.solve(J[arm].T, u[arm]) for arm in range(2)])


def _clock() -> Iterator[Check]:
    clock = {"controller.control_period": PERIOD, "controller.input_delay": DELAY}
    run = run_of("the clocked run", {**clock, "controller.torque_limit": LOWER}, 0.02, PERIOD / FINER)
    points, instants = MassPoints(run.scenario), len(run) // FINER
    held = run.joint_torque[: instants * FINER].reshape(instants, FINER, 2, 3)
    scale = float(np.abs(held).max())
    jitter = np.ptp(held, axis=1).max() / scale
    yield below("torques are held for a control period: largest change, as a part", 1e-9, jitter)
    yield below(f"until the first arrive, {DELAY} periods, motors are off, N·m", 1e-12, held[:DELAY])
    errors, steps, b_hat = [], [], np.zeros(3)
    for instant in range(instants - DELAY - 1):
        k = instant * FINER
        u, rate = paper_law(points, run, k, b_hat)
        wanted = np.clip(joint_torques(points, run.pose[k], u), -np.array(LOWER), LOWER)
        errors.append(np.abs(wanted - held[instant + DELAY, -1]).max())
        b_hat = b_hat + PERIOD * rate
        steps.append(np.abs(run.bound_estimates[k + 1] - b_hat).max())
    statement = f"torques of an instant, clipped to their limits, act {DELAY} periods later: largest error, as a part"
    yield below(statement, 1e-8, max(errors) / scale)
    yield below("b̂ advances by T_c times its rate: largest error, as a part", 1e-8, max(steps) / float(b_hat.max()))


def _limits() -> Iterator[Check]:
    for words, limit in (("limits", LIMIT), ("lower limits alone", LOWER)):
        run = run_of("the limited run", {"controller.torque_limit": limit}, 0.01, 2.5e-4)
        points, most, errors, clipped = MassPoints(run.scenario), np.array(limit), [], []
        for k in range(len(run)):
            u, _ = paper_law(points, run, k, run.bound_estimates[k])
            wanted = joint_torques(points, run.pose[k], u)
            errors.append(np.abs(np.clip(wanted, -most, most) - run.joint_torque[k]).max())
            clipped.append((np.abs(wanted) > most).any())
        yield below(f"torques are clipped to their {words}: largest error, as a part", 1e-9, max(errors) / limit[0])
        yield above("instants at which one stands there", 5, sum(clipped))
        yield true("which the run says at each instant", np.array_equal(run.saturated, clipped))


def _noise(told: dict[str, np.ndarray]) -> Iterator[Check]:
    """Noise of pose and pose rate; fills `told` with the readings of seed 1, by sensor."""
    for words, sensor, gain in (("pose", "pose", "position_gain"), ("pose rate", "pose_rate", "velocity_gain")):
        readings = {}
        for seed in (1, 2):
            gains = {"position_gain": 0.0, "velocity_gain": 0.0, gain: 1.0}
            law = {"kind": "pd", **gains, "control_period": PERIOD, "sensor_noise": {sensor: SIGMA, "seed": seed}}
            run = run_of("the noisy run", {**STILL, "controller": law}, MEASURED * PERIOD, PERIOD)
            readings[seed] = -run.arm_input.sum(axis=1)[1:]
        told[sensor] = noise = readings[1]
        for name, sigma, found in zip("xyθ", SIGMA, noise.std(axis=0), strict=True):
            statement = f"noise of {words}, {name}: deviation as a part of what is asked for"
            yield close(statement, 1.0, found / sigma, absolute=0.06)
        mean = np.abs(noise.mean(axis=0)) / SIGMA * np.sqrt(len(noise))
        yield below(f"noise of {words}: mean, in its own standard errors", 4.5, mean.max())
        unit = noise / noise.std(axis=0)
        yield below(f"noise of {words}: correlation from instant to instant", 0.1, (unit[1:] * unit[:-1]).mean(axis=0))
        other = np.stack([np.roll(unit, 1, axis=1), readings[2] / readings[2].std(axis=0)])
        statement = f"noise of {words}: correlation between coordinates and between seeds, of values and of squares"
        yield below(statement, 0.1, [(unit * other).mean(axis=1), ((unit**2 - 1) * (other**2 - 1)).mean(axis=1) / 2])


def _strain_noise(told: dict[str, np.ndarray]) -> Iterator[Check]:
    """Noise of hᵀq̇ from gauges: √2 σ W_j / T_c each, W_j = (2/t) M(s_j) · weight of s_j, M the moment of ρ or ρs."""
    payload, told["moment_rate"] = load_preset("paper").payload, told_rates({"moment_rate": MOMENT_RATE, "seed": 1})
    for name, sigma, found in zip(("hᵀq̇", "gᵀq̇"), MOMENT_RATE, told["moment_rate"].std(axis=0), strict=True):
        statement = f"noise of {name}: deviation as a part of what is asked for"
        yield close(statement, 1.0, found / sigma, absolute=0.06)
    told["strain"] = by_gauges = told_rates({"strain": STRAIN, "seed": 1})
    places = payload.length * np.array(GAUGES)
    moment = payload.linear_density / 2 * (payload.length**2 / 4 - places**2)
    for name, loaded, rates in (("hᵀq̇", moment, by_gauges[:, 0]), ("gᵀq̇", places / 3 * moment, by_gauges[:, 1])):
        weights = 2 / payload.thickness * loaded * payload.length / 4
        wanted = np.sqrt(2) * STRAIN * np.linalg.norm(weights) / PERIOD
        yield close(f"noise of {name} from gauges: deviation, SI", wanted, rates.std(), relative=0.06)
    rates = by_gauges[:, 0]
    unit = rates / rates.std()
    alternating = (unit[1:] * unit[:-1]).mean()
    yield close("and each reading enters twice, with both signs: correlation", -0.5, alternating, absolute=0.06)


def _independent(told: dict[str, np.ndarray]) -> Iterator[Check]:
    """Correlations between the noises of several sensors with one seed; those from gauges are differences of two instants."""
    white = np.hstack([told[sensor] for sensor in ("pose", "pose_rate", "moment_rate")])
    white, strain = white / white.std(axis=0), told["strain"] / told["strain"].std(axis=0)
    found = [white.T @ white / len(white) - np.eye(8)]
    found += [np.diff(white, axis=0).T @ part / len(white) / np.sqrt(2) for part in (strain[1:], strain[:-1])]
    yield below(
        "noise of several sensors: correlation between them", 0.1, np.vstack([part.reshape(-1, 2) for part in found])
    )


def told_rates(noise: dict[str, Any], observer: dict[str, Any] | None = None) -> np.ndarray:
    """hᵀq̇ and gᵀq̇ of a resting beam as a law is told them, by an observer or, with None, by its sensors, (N, 2)."""
    gain = 1e-3
    law = {
        "kind": "composite", "slow": {"kind": "none"}, "lateral_vibration_gain": gain, "angular_vibration_gain": gain,
        "control_period": PERIOD, "sensor_noise": noise, "observer": observer or {"kind": "measured"},
    }  # fmt: skip
    run = run_of("the run with a noisy beam", {**STILL, "controller": law}, MEASURED * PERIOD, PERIOD)
    points = MassPoints(run.scenario)
    inertia = sum(points.arm_inertia(np.array(CENTER), arm) for arm in range(2))
    return np.linalg.solve(inertia, run.arm_input.sum(axis=1)[1:].T)[1:].T / gain


def _gauges() -> Iterator[Check]:
    length, thickness, n = 0.5, 0.005, 32
    places = np.array([-0.21, -0.08, 0.0, 0.13])
    nodes = np.linspace(-length / 2, length / 2, n + 1)
    wave = np.pi / length
    sine, slope = np.cos(wave * nodes), -wave * np.sin(wave * nodes)
    q = np.delete(np.stack([sine, slope], axis=1).ravel(), [0, 2 * n])
    found = strain_rows(places, length, thickness, n, "pinned-pinned") @ q
    wanted = thickness / 2 * wave**2 * np.cos(wave * places)
    yield below("a gauge reads -½ t w''(s): relative error on half a sine", 2e-3, found / wanted - 1)
