"""The environment for learning: observations, rewards, actions and chance, by their definitions; none without Gymnasium."""

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np

from flexlab.analysis.validation.check import SWINGING, UNEQUAL, Check, Runs, alike, below, subject, true
from flexlab.analysis.validation.mass_points import MassPoints
from flexlab.analysis.validation.paper import desired
from flexlab.presets import load_preset
from flexlab.sim.samples import Samples

WORLDS, PERIOD, LIMIT, RANGE = 400, 0.002, 200.0, (20.0, 400.0)
"""Number of worlds; T_c, s; torque limit, N·m; range of EI, N·m²."""
NOISE = np.array([1e-4] * 3 + [1e-2] * 3 + [1e-3, 1e-4])
"""Standard deviations at scale 1, as documented."""
SPREAD = np.array([0.005, 0.004, 0.01])
"""Largest distance of a start from the path's, m, m, rad."""
WRENCH = np.array([600.0, 600.0, 150.0])
"""Wrench of an action of 1, N, N, N·m."""
OPTIONS = {"control_period": PERIOD, "stiffness": RANGE, "variants": 3, "threads": 1}


@subject("The environment for learning", 24)
def environment(_: Runs) -> Iterator[Check]:
    """Worlds with unequal arms on a path whose coordinates differ."""
    if find_spec("gymnasium") is None:
        return
    yield from _observed()
    yield from _moved()
    yield from _by_chance()
    yield from _ended()


def _made(count: int, **options: Any) -> Any:
    from flexlab.gym_environment import TwoArmsVector

    scenario = load_preset("paper").replace({**UNEQUAL, **SWINGING})
    return TwoArmsVector(count, scenario=scenario, **OPTIONS, **options)


def _truth(envs: Any, time: float) -> tuple[Samples, np.ndarray]:
    """Samples of all worlds, and what a law without noise would be told of them, (worlds, 14)."""
    seen, scenario = envs.worlds.samples(), envs.worlds.scenario
    goal, rate, change = desired(np.array([time]), scenario.trajectory)
    inertia = MassPoints(scenario).payload_inertia(np.zeros(3 + seen.beam_rates.shape[1]))
    moments = seen.beam_rates @ inertia[1:3, 3:].T
    parts = [seen.pose - goal, seen.pose_rate - rate, np.tile(change, (len(seen), 1)), moments, seen.pose]
    return seen, np.hstack(parts)


def _observed() -> Iterator[Check]:
    actions = np.random.default_rng(2).uniform(-0.2, 0.2, (3, 8, 6))
    for version, reward in ((1, lambda cost: np.minimum(50, np.sqrt(cost))), (0, lambda cost: np.minimum(100, cost))):
        envs = _made(8, action="torques", version=version)
        envs.reset(seed=3)
        for action in actions:
            told, given, *_ = envs.step(action)
        seen, exact = _truth(envs, len(actions) * PERIOD)
        part = np.abs(told - exact).max(axis=0) / np.abs(exact).max(axis=0)
        yield below(f"version {version}: e, ė, ẍ_d, hᵀq̇, gᵀq̇ and x are observed: relative error", 1e-5, part)
        ringing = seen.midspan_deflection - seen.quasi_static_deflection
        effort = np.sum((seen.joint_torque / LIMIT) ** 2, axis=(1, 2))
        off = np.sum(seen.tracking_error[:, :2] ** 2, axis=1) / 0.01**2 + seen.tracking_error[:, 2] ** 2 / 0.02**2
        wanted = -PERIOD * reward(off + (ringing / 1e-3) ** 2 + 0.01 * effort)
        yield alike("and rewarded by errors, vibration and effort: relative error", 1e-9, given, wanted)
        envs.close()


def _moved() -> Iterator[Check]:
    """Wrenches, and torques that come late."""
    envs = _made(60, delay=(0, 2))
    envs.reset(seed=4)
    action = np.random.default_rng(3).uniform(-0.1, 0.1, (60, 3))
    late, sums = envs.worlds.state.delay.copy(), []
    for _ in range(3):
        envs.step(action)
        sums.append(envs.worlds.samples().arm_input.sum(axis=1))
    acts = np.arange(3)[:, None] >= late
    yield true("delays are from the whole range, both ends included", set(late.tolist()) == {0, 1, 2})
    wanted = acts[:, :, None] * (WRENCH * action)
    yield alike("a wrench acts after its delay, on the payload as a whole: relative error", 0.02, sums, wanted)
    envs.close()


def _by_chance() -> Iterator[Check]:
    """Noise, starts and beams of many worlds."""
    envs, again = (_made(WORLDS, noise=1.0, start_spread=tuple(SPREAD)) for _ in range(2))
    begun = envs.reset(seed=5)[0]
    share = envs.worlds.state.noise.copy()
    away = begun[:, :3] - begun[:, :3].mean(axis=0)
    told = envs.step(np.zeros((WORLDS, 3)))[0]
    _, exact = _truth(envs, PERIOD)
    noise = (told - exact)[:, [0, 1, 2, 3, 4, 5, 9, 10]] / (share[:, None] * NOISE)
    noise = noise[share > 0.1]
    unit = np.abs(noise.T @ noise / len(noise) - np.eye(8))
    yield below("noise: deviation from what is documented, and correlation between measurements", 0.25, unit)
    same = np.abs((told - exact)[:, 11:] - (told - exact)[:, :3]).max()
    yield below("the pose is told with the noise of its error: difference", 1e-6, same)
    chance = np.array([share.mean() - 0.5, share.min(), 1 - share.max()])
    yield below("each world has a random share of it, from 0 to 1: mean less ½, least, most", 0.06, chance)
    part = np.abs(away).max(axis=0) / SPREAD, away.std(axis=0) / SPREAD * np.sqrt(3)
    yield below("starts are spread evenly, up to the largest distance: from 1", 0.1, np.array(part) - 1)
    stiffness, variant = envs.worlds.stiffness, envs.worlds.state.variant
    yield alike("beams: equal ratios: relative error", 1e-12, stiffness, [20.0, 20.0 * 20**0.5, 400.0])
    yield below("each as often: share less ⅓", 0.1, np.bincount(variant, minlength=3) / WORLDS - 1 / 3)
    yield true("the same seed gives the same worlds", np.array_equal(again.reset(seed=5)[0], begun))
    for each in (envs, again):
        each.close()


def _ended() -> Iterator[Check]:
    """Episodes that last, and some that fail."""
    duration, ends = 0.5, {}
    for words, action in (("last", 0.0), ("fail", 1.0)):
        envs = _made(1, action="torques", duration=duration, torque_limit=1e4)
        envs.reset(seed=6)
        left, given = duration, (np.zeros(1), np.zeros(1, bool), np.zeros(1, bool))
        while not (given[1][0] or given[2][0]) and left > 0:
            _, *given, _ = envs.step(np.full((1, 6), action))
            left -= PERIOD
        ends[words] = [float(given[0][0]), bool(given[1][0]), bool(given[2][0]), left]
        envs.close()
    last, fail = ends["last"], ends["fail"]
    yield true("an episode is over after its duration", not last[1] and last[2] and abs(last[3]) < 1e-9)
    cost = -50 * (fail[3] + PERIOD)
    yield true(
        "one that fails costs 50 for each second left",
        fail[1] and fail[3] > PERIOD and abs(fail[0] / cost - 1) < 1e-9,
        str(fail),
    )
